//! `mvfusion prepare`.

use std::io::Write;
use std::ops::ControlFlow;

use anyhow::Context;
use mvfusion_data::prepare::{ColmapOptions, Event, Footage, PrepareError, PrepareOptions, Prepared, prepare as make};
use mvfusion_data::{ReadOptions, open, recognise};

use super::check;
use crate::args::{CheckArgs, ComputeArgs, ConfigSourceArgs, PrepareArgs};
use crate::failure::UsageError;
use crate::interrupt::{Abandoned, Signals, path_for_shell};
use crate::progress::{Progress, Verbosity};

/// Makes a scene from photos or videos, and checks it as `mvfusion check` does.
///
/// # Errors
/// If there is no COLMAP, the footage cannot be used, COLMAP cannot place it, or training could not start on the scene.
/// [`Abandoned`] after a signal.
pub fn prepare(args: &PrepareArgs, verbosity: Verbosity, out: &mut dyn Write) -> anyhow::Result<()> {
    let signals = Signals::watch().context("cannot watch for signals")?;
    // A folder of videos looks like Neu3D until its poses are missed.
    if let (Ok(format), Ok(_)) = (recognise(&args.input, None), open(&args.input, &ReadOptions::default())) {
        let (input, format) = (args.input.display(), format.name());
        verbosity.note(&format!(
            "note:   {input} has poses already ({format}): `mvfusion train --data {}` reads it as it is",
            path_for_shell(&args.input)
        ));
    }
    let mut progress = None;
    let mut listen = |event: Event| {
        match event {
            Event::Note(note) => verbosity.note(&format!("note:   {note}")),
            Event::Begins { what, total } => progress = Some(Progress::new(what, total, verbosity)),
            Event::Advances => {
                if let Some(progress) = &mut progress {
                    progress.advance();
                }
            }
            Event::Ends => {
                if let Some(mut progress) = progress.take() {
                    progress.finish();
                }
            }
            Event::Continues => {}
        }
        match signals.exit_code() {
            Some(_) => ControlFlow::Break(()),
            None => ControlFlow::Continue(()),
        }
    };
    let made = make(&args.input, &args.out, &options(args), &mut listen);
    drop(progress);
    let made = made.map_err(|error| failure(error, &signals))?;
    // The scene is complete. What follows can be done again with `mvfusion check`.
    signals.end_at_once();
    verbosity.wrote("scene", &args.out);
    tell(&made, args, out)?;
    check(&check_of(args), verbosity, out)
}

fn failure(error: PrepareError, signals: &Signals) -> anyhow::Error {
    match (&error, signals.exit_code()) {
        (PrepareError::Interrupted, Some(code)) => Abandoned { code, what: "scene" }.into(),
        _ if error.is_usage() => UsageError::new(error.to_string()).into(),
        _ => error.into(),
    }
}

fn options(args: &PrepareArgs) -> PrepareOptions {
    PrepareOptions {
        fps: args.fps,
        masks: args.masks.clone(),
        offsets: args.offset.iter().cloned().collect(),
        sync: args.sync.into(),
        colmap: ColmapOptions {
            program: args.colmap.clone(),
            matcher: args.matcher.into(),
            camera_model: args.camera_model.clone(),
            one_lens: args.one_lens,
            gpu: args.gpu.into(),
            threads: args.threads.map(usize::from),
            seed: args.seed,
            model: args.model,
        },
        replace: args.force,
    }
}

/// What was made, and how to go on.
fn tell(made: &Prepared, args: &PrepareArgs, out: &mut dyn Write) -> std::io::Result<()> {
    let (placed, total) = (made.placed.placed.len(), made.placed.total);
    let (what, hint) = match &made.footage {
        Footage::Photos { .. } => ("photos", String::new()),
        // Without these keys, the frames are photos; as a video, the preset of one camera halves them.
        Footage::Video { .. } => ("frames", " --set scene.capture=video --set scene.downscale=1".to_owned()),
        Footage::Rig { cameras, .. } => {
            let name = cameras.iter().find(|camera| camera.placed).map_or("cam00", |camera| camera.name.as_str());
            ("cameras", format!(" --set 'scene.test_cameras=[\"{name}\"]'"))
        }
    };
    let scene = path_for_shell(&args.out);
    writeln!(out, "placed      {placed} of {total} {what}")?;
    writeln!(out, "train       mvfusion train --data {scene}{hint}")
}

/// `mvfusion check SCENE`, with its picture in the scene. The time is not predicted: nobody has chosen a device.
fn check_of(args: &PrepareArgs) -> CheckArgs {
    CheckArgs {
        folder: args.out.clone(),
        sources: ConfigSourceArgs::default(),
        json: false,
        quick: false,
        picture: Some(args.out.join("check.png")),
        no_picture: false,
        no_time: true,
        compute: ComputeArgs { device: "auto".into(), threads: args.threads },
    }
}
