//! `mvfusion synth`.

use std::io::Write;

use mvfusion_data::{BuiltinKind, BuiltinOptions, Capture, builtin};

use crate::args::SynthArgs;
use crate::progress::Verbosity;
use crate::scene;

/// Writes a built-in scene in a dataset layout, together with its ground truth.
///
/// # Errors
/// If the layout is not for such a scene, the folder is not empty, or a file cannot be written.
pub fn synth(args: &SynthArgs, verbosity: Verbosity, out: &mut dyn Write) -> anyhow::Result<()> {
    let kind = args.scene.unwrap_or(match args.layout.capture() {
        Capture::Video => BuiltinKind::Video,
        Capture::Photos => BuiltinKind::Casual,
    });
    let (width, height) = args.size;
    let defaults = BuiltinOptions::of_kind(kind);
    let options = BuiltinOptions {
        seed: args.seed,
        width,
        height,
        frames: args.frames.map_or(defaults.frames, usize::from),
        photos: args.photos.map_or(defaults.photos, usize::from),
        ..defaults
    };
    let scene = builtin::builtin(&options);
    verbosity.note(&format!("scene:  {}", scene::describe(&scene)));
    mvfusion_data::write::write(&scene, args.layout, &args.out)?;
    verbosity.wrote("scene", &args.out);
    writeln!(out, "{}", args.out.display())?;
    Ok(())
}
