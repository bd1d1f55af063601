//! `mvfusion eval`.

use std::io::Write;
use std::path::{Path, PathBuf};

use anyhow::{Context, bail};
use mvfusion_model::Config;
use mvfusion_model::train::TrainState;

use super::score::{Scored, Trained};
use crate::args::EvalArgs;
use crate::progress::Talk;
use crate::run::{self, PerView, PicturesWriter, Results};
use crate::{atomic, config, device, scene, table};

/// Scores a run again from its checkpoint and compares with what it had found.
///
/// # Errors
/// If the run is not complete, its data are gone, the device fails, or a file cannot be written.
pub fn eval(args: &EvalArgs, talk: Talk, out: &mut dyn Write) -> anyhow::Result<()> {
    let checkpoint = find_checkpoint(&args.run)?;
    let config = configuration(args)?;
    let device = device::open(&args.compute.device)?;
    let scene = scene::open(&config).context(
        "cannot open the scene of the run; if it has moved, give its folder with --data and that of the masks with --masks",
    )?;
    talk.note(&format!("device: {}", device.reason));
    talk.note(&format!("scene:  {}", scene::describe(&scene)));

    let scaled = config.scaled();
    let state = TrainState::load(&checkpoint, &scaled, &device.device.clone().autodiff())?;
    let before = earlier_results(&args.run)?;
    let trained = Trained {
        model: &state.model,
        scene: &scene,
        config: &scaled,
        time: before.as_ref().and_then(|results| results.train),
        device: &device.name,
    };
    let pictures = args.write.then(|| PicturesWriter::new(&args.run, &scaled.eval, scene.test.len()));
    let scored = trained.score(pictures.as_ref(), talk)?;
    if args.write {
        write(&args.run, &scored)?;
    }
    table::write(&scored.results, out)?;
    if let Some(strip) = pictures.and_then(|pictures| pictures.strip_to_see()) {
        writeln!(out, "{:16}{} ({})", "look first at", strip.display(), run::legend(&state.model))?;
    }
    compare(&scored.results, before.as_ref(), out)
}

fn find_checkpoint(run: &Path) -> anyhow::Result<PathBuf> {
    let checkpoint = run.join(run::CHECKPOINTS).join(run::FINAL);
    if !run.is_dir() {
        bail!("there is no folder {}. Give the folder of a run, such as runs/quickstart-0.", run.display());
    }
    if !checkpoint.is_file() {
        bail!(
            "{} holds no {}/{}: it is no run, or its training did not end.",
            run.display(),
            run::CHECKPOINTS,
            run::FINAL
        );
    }
    Ok(checkpoint)
}

/// The run's configuration, with what has moved since.
fn configuration(args: &EvalArgs) -> anyhow::Result<Config> {
    let mut config = config::read(&args.run.join(run::CONFIG))?;
    if args.data.is_some() {
        config.scene.data = args.data.clone();
    }
    if args.masks.is_some() {
        config.eval.dynamic_masks = args.masks.clone();
    }
    Ok(config)
}

fn earlier_results(run: &Path) -> anyhow::Result<Option<Results>> {
    let path = run.join(run::RESULTS);
    if !path.is_file() {
        return Ok(None);
    }
    let read = || -> anyhow::Result<Results> { Ok(serde_json::from_str(&std::fs::read_to_string(&path)?)?) };
    read()
        .map(Some)
        .with_context(|| format!("cannot read {}; remove it to evaluate without comparison", path.display()))
}

fn write(run: &Path, scored: &Scored) -> anyhow::Result<()> {
    atomic::write_json(&run.join(run::PER_VIEW), &PerView::of(&scored.results.protocol, &scored.evaluation))?;
    atomic::write_json(&run.join(run::RESULTS), &scored.results)
}

/// Says whether the figures are those that the run had found.
fn compare(now: &Results, before: Option<&Results>, out: &mut dyn Write) -> anyhow::Result<()> {
    let Some(before) = before else {
        return Ok(writeln!(out, "The run has no {} to compare with.", run::RESULTS)?);
    };
    let differences = now.differences(before);
    if differences.is_empty() {
        return Ok(writeln!(out, "The figures are those of {}.", run::RESULTS)?);
    }
    writeln!(out, "These figures differ from {}:", run::RESULTS)?;
    for difference in differences {
        writeln!(out, "  {difference}")?;
    }
    if now.device != before.device {
        writeln!(out, "It was made on {}, this on {}; sums may round differently.", before.device, now.device)?;
    }
    if now.protocol != before.protocol {
        writeln!(out, "It follows another protocol: {}", before.protocol)?;
    }
    if now.params_sha256 != before.params_sha256 {
        writeln!(out, "The checkpoint holds other parameters than those that were scored.")?;
    }
    Ok(())
}
