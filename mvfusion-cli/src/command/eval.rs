//! `mvfusion eval`.

use std::io::Write;
use std::path::{Path, PathBuf};

use anyhow::{Context, bail};
use mvfusion_model::Config;
use mvfusion_model::evaluation::Protocol;
use mvfusion_model::train::parameter_hash;
use tracing::warn;

use super::score::{self, Scoring};
use super::{json, replace};
use crate::args::EvalArgs;
use crate::progress::Verbosity;
use crate::run::{
    self, Change, Evidence, MasksRequest, OpenRun, Part, PicturesHash, PicturesWriter, Results, RunRequest, SceneFile,
    TrainCost,
};
use crate::{atomic, lpips, report, table};

/// Evaluates a run again from its checkpoint and compares the metrics with its earlier ones.
///
/// # Errors
/// If the run has no checkpoint, its data are gone, the device fails, or a file cannot be written. If the parameters
/// are not those of the run's results: with `--write` before anything is written, otherwise after the table. With
/// `--write`, also if there are results, and the configuration or the held-out photos are not theirs, or the cameras,
/// times or points are not those of the training.
pub fn eval(args: &EvalArgs, verbosity: Verbosity, out: &mut dyn Write) -> anyhow::Result<()> {
    let masks = args.masks.as_deref().map_or(MasksRequest::AsConfigured, MasksRequest::Folder);
    let request = RunRequest { run: &args.run, data: args.data.as_deref(), masks, device: &args.compute.device };
    let folder = metrics_folder(&args.run, args.protocol);
    let weights = args.lpips_weights.as_deref().map(|weights| lpips::of_option(weights, args.protocol)).transpose()?;
    let _lock = args.write.then(|| run::lock(&args.run)).transpose()?;
    let before = earlier_results(&folder)?;
    let OpenRun { config, device, scene, trained } = OpenRun::open(&request, verbosity)?;
    let mut now = Evidence {
        params_sha256: parameter_hash(&trained.model)?,
        config_sha256: run::config_hash(&args.run)?,
        photos_sha256: None,
    };
    let changes = now.changes(with_results(&args.run, &folder))?;
    if args.write {
        refuse_to_write(&changes)?;
        if with_results(&args.run, &folder).any(|folder| folder.join(run::RESULTS).is_file()) {
            now.photos_sha256 = Some(PicturesHash::of_photos(&scene.test)?.finish());
            refuse_to_write(&now.changes(with_results(&args.run, &folder))?)?;
            if let Some(what) = run::changed_geometry(&args.run, &scene) {
                bail!(
                    "{what} of the scene have changed since the training. Nothing was written. Give the scene of the run \
                     with --data, or evaluate without --write. To evaluate it as it is now, move {} away first",
                    folder.join(run::RESULTS).display()
                );
            }
        }
    }
    let weights = lpips::find(weights.as_deref().or_else(|| configured_weights(&config, verbosity)))?;
    if let Some(weights) = &weights {
        verbosity.note(&format!("lpips:  {weights}"));
    }
    let scoring = Scoring {
        trained: &trained,
        scene: &scene,
        config: &config,
        config_sha256: now.config_sha256,
        evaluator: &score::evaluator(args.protocol, weights.as_ref(), &device.device)?,
        speed_frames: args.speed_frames,
        lpips_folder: weights,
        cost: training_cost(&args.run, before.as_ref())?,
        device: &device,
        run: &args.run,
        go_on: &|| Ok(()),
    };
    if !args.replace.is_empty() {
        refuse_others(&changes)?;
        return replace::replace(args, &scoring, verbosity, out);
    }
    // The images do not depend on the protocol.
    let is_own = args.protocol == Protocol::Mvfusion;
    let pictures = (args.write && is_own).then(|| PicturesWriter::new(&args.run, &config.eval, scene.test.len()));
    let mut scored = scoring.score(pictures.as_ref(), verbosity)?;
    if args.speed_frames == 0 {
        scored.results.speed = before.as_ref().and_then(|before| before.speed_of(&scored.results));
    }
    if args.write {
        std::fs::create_dir_all(&folder).with_context(|| format!("cannot create the folder {}", folder.display()))?;
        scored.write(&folder)?;
        atomic::write_json(&args.run.join(run::SCENE), &SceneFile::of(&scene))?;
        verbosity.wrote("results", &folder.join(run::RESULTS));
        verbosity.wrote("report", &report::write(&args.run)?);
    }
    if args.json {
        json::print(&scored.results, out)?;
        let mut words = Vec::new();
        compare(&scored.results, before.as_ref(), &folder, &mut words)?;
        String::from_utf8_lossy(&words).lines().for_each(|line| verbosity.note(line));
        return refuse_others(&changes);
    }
    table::write(&scored.results, args.protocol, verbosity, out)?;
    if let Some(strip) = pictures.and_then(|pictures| pictures.strip_to_see()) {
        writeln!(out, "{:16}{} ({})", "start with", strip.display(), run::legend(&trained.model))?;
    }
    compare(&scored.results, before.as_ref(), &folder, out)?;
    refuse_others(&changes)
}

/// The folders whose results must describe the same model: the run's own, and that of the protocol.
fn with_results<'a>(run: &'a Path, folder: &'a Path) -> impl Iterator<Item = &'a Path> {
    std::iter::once(run).chain((folder != run).then_some(folder))
}

/// The error for results that describe something else, which `--write` would replace.
fn refuse_to_write(changes: &[Change]) -> anyhow::Result<()> {
    let Some(change) = changes.first() else { return Ok(()) };
    let remedy = match change.part {
        Part::Parameters | Part::Configuration => "To evaluate the run as it is now, move that file away first",
        Part::Photos => {
            "Give the scene of the run with --data, or evaluate without --write. To keep only the metrics of these \
             photos, move that file away first"
        }
    };
    bail!("{change}. Nothing was written. {remedy}")
}

/// The error for other parameters than those of the results. A changed configuration was warned of.
fn refuse_others(changes: &[Change]) -> anyhow::Result<()> {
    let mut others = changes.iter().filter(|change| change.part == Part::Parameters);
    match others.next() {
        None => Ok(()),
        Some(change) => {
            others.for_each(|other| warn!("{other}"));
            bail!("{change}")
        }
    }
}

/// The folder of a run's metrics under a protocol.
fn metrics_folder(run: &Path, protocol: Protocol) -> PathBuf {
    match protocol {
        Protocol::Mvfusion => run.to_owned(),
        other => run.join(run::PROTOCOLS).join(other.name()),
    }
}

/// The setting of the LPIPS weights in the training, if they still exist.
fn configured_weights(config: &Config, verbosity: Verbosity) -> Option<&Path> {
    let folder = config.eval.lpips_weights.as_deref()?;
    if !lpips::is_none(folder) && !folder.is_dir() {
        let folder = folder.display();
        verbosity.note(&format!(
            "note:   the LPIPS weights are no longer in {folder}; give their folder with --lpips-weights"
        ));
        return None;
    }
    Some(folder)
}

/// The cost of the run's training: from the metrics of the protocol if they exist, otherwise from the run's own.
fn training_cost(run: &Path, before: Option<&Results>) -> anyhow::Result<Option<TrainCost>> {
    match before {
        Some(results) => Ok(results.train),
        None => Ok(earlier_results(run)?.and_then(|results| results.train)),
    }
}

fn earlier_results(folder: &Path) -> anyhow::Result<Option<Results>> {
    let path = folder.join(run::RESULTS);
    if !path.is_file() {
        return Ok(None);
    }
    run::read_json(&path).map(Some).context("remove the earlier metrics to evaluate without comparison")
}

/// Reports whether the metrics equal the run's earlier ones.
fn compare(now: &Results, before: Option<&Results>, folder: &Path, out: &mut dyn Write) -> anyhow::Result<()> {
    let path = folder.join(run::RESULTS);
    let Some(before) = before else {
        return Ok(writeln!(out, "There is no {} to compare with.", path.display())?);
    };
    let differences = now.differences(before);
    if differences.is_empty() {
        return Ok(writeln!(out, "The metrics equal those of {}.", path.display())?);
    }
    writeln!(out, "These metrics differ from {}:", path.display())?;
    for difference in differences {
        writeln!(out, "  {difference}")?;
    }
    if now.device != before.device {
        writeln!(
            out,
            "The earlier ones were computed on {}, these on {}; sums may round differently.",
            before.device, now.device
        )?;
    }
    if !before.photos_sha256.is_empty() && now.photos_sha256 != before.photos_sha256 {
        writeln!(out, "The earlier ones were computed on other photos: photos_sha256 was {}.", before.photos_sha256)?;
    }
    if before.masks_sha256.as_ref().is_some_and(|before| now.masks_sha256.as_ref() != Some(before)) {
        writeln!(out, "The earlier ones were computed with other masks of moving objects.")?;
    }
    if now.protocol != before.protocol {
        writeln!(out, "The earlier ones follow another protocol: {}", before.protocol)?;
    }
    Ok(())
}
