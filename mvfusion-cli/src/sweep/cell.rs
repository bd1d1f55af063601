//! One cell as a process: what a job of this machine and a task of SLURM both run.

use std::fs;
use std::io::{self, Write};
use std::path::{Path, PathBuf};

use anyhow::{Context, bail, ensure};
use bytesize::ByteSize;
use mvfusion_model::evaluation::Protocol;
use mvfusion_model::train::IMAGE_CACHE;
use mvfusion_model::{Config, ModelError};
use toml::{Table, Value};
use tracing::warn;

use super::folder::{Order, State, SweepFolder};
use crate::args::{ComputeArgs, ConfigSourceArgs, EvalArgs, RunCellArgs, TrainArgs};
use crate::interrupt::Interrupted;
use crate::progress::Verbosity;
use crate::run;
use crate::{command, config, lpips};

/// Trains a cell, evaluates it, and measures what else is wanted; does nothing if it is finished.
///
/// # Errors
/// If another process works on it; what training or evaluation fails with, in words that are left beside the cell's
/// folder as well.
pub fn run_cell(args: &RunCellArgs, verbosity: Verbosity, out: &mut dyn Write) -> anyhow::Result<()> {
    let (folder, id) = (SweepFolder::new(&args.out)?, args.cell.as_str());
    let order = folder.order(id)?;
    let name = &order.name;
    // A task that ended well for this reason would never be run again.
    let Some(_lock) = folder.lock(id)? else { bail!("{name}: another process works on it") };
    if folder.is_finished(id, &order.wanted) {
        return Ok(writeln!(out, "{name}: {}", State::Finished.word())?);
    }
    writeln!(out, "{name}")?;
    folder.forget_failure(id)?;
    let result = work(&folder, id, &order, &args.compute, verbosity, out);
    if let Err(error) = &result
        // An interrupted cell has not failed.
        && !error.is::<Interrupted>()
        && let Err(note) = folder.note_failure(id, &format!("{error:#}"))
    {
        warn!("{note:#}");
    }
    result
}

fn work(
    folder: &SweepFolder,
    id: &str,
    order: &Order,
    compute: &ComputeArgs,
    verbosity: Verbosity,
    out: &mut dyn Write,
) -> anyhow::Result<()> {
    // Where the data lie now: they may have moved since the run's own configuration was written.
    let places = config::read(&folder.config(id))?;
    if !folder.is_trained(id) {
        let sources = ConfigSourceArgs {
            preset: Some(order.preset.clone()),
            config: Some(folder.config(id)),
            ..ConfigSourceArgs::default()
        };
        let run = TrainArgs {
            data: None,
            sources,
            compute: compute.clone(),
            image_cache: ByteSize(IMAGE_CACHE),
            force_memory: false,
            lpips_weights: None,
            out: Some(folder.run(id)),
            // What is there is the rest of a run that has no checkpoint.
            force: true,
            #[cfg(feature = "viewer")]
            viewer: crate::args::TrainViewArgs::default(),
            init_from: None,
            resume: None,
        };
        train(&folder.run(id), run, &places, verbosity, out)?;
    }
    if !folder.is_finished(id, &order.wanted) {
        let eval = EvalArgs {
            run: folder.run(id),
            data: places.scene.data,
            masks: places.eval.dynamic_masks,
            lpips_weights: weights_of_option(order),
            protocol: Protocol::Mvfusion,
            speed_frames: order.wanted.speed_frames,
            replace: Vec::new(),
            compute: compute.clone(),
            write: true,
            json: false,
        };
        command::eval(&eval, verbosity, out)?;
        ensure!(
            folder.is_finished(id, &order.wanted),
            "it was evaluated, but without its speed, or not by the weights of LPIPS that the sweep began with; {} \
             tells more. Start the sweep again",
            folder.log(id).display()
        );
    }
    Ok(())
}

/// The folder of weights as an option of the evaluation, which refuses an empty one. A sweep also begins with an empty
/// folder that nobody asked for; the run's configuration then names it.
fn weights_of_option(order: &Order) -> Option<PathBuf> {
    let is_used = |folder: &PathBuf| lpips::is_none(folder) || lpips::has_weights(folder) || !folder.is_dir();
    order.wanted.lpips_weights.clone().filter(is_used)
}

/// Trains a cell: continues the run of its folder if that has a checkpoint that can be read and belongs to the scene as it
/// is now, else begins anew.
fn train(
    path: &Path,
    anew: TrainArgs,
    places: &Config,
    verbosity: Verbosity,
    out: &mut dyn Write,
) -> anyhow::Result<()> {
    if !run::checkpoints(path)?.is_empty() {
        if run::is_finished(path) {
            return put_results_away(path);
        }
        let resumed = TrainArgs {
            data: places.scene.data.clone(),
            sources: ConfigSourceArgs { table: Some(table_of(places)), ..ConfigSourceArgs::default() },
            out: None,
            force: false,
            resume: Some(path.to_owned()),
            ..anew.clone()
        };
        match command::train(&resumed, verbosity, out) {
            Err(error) if is_of_checkpoint(&error) => warn!("{error:#}"),
            result => return result,
        }
    }
    command::train(&anew, verbosity, out)
}

/// Whether the checkpoint cannot be read, or is of a scene with other cameras. Neither keeps a new run from beginning.
fn is_of_checkpoint(error: &anyhow::Error) -> bool {
    matches!(error.downcast_ref(), Some(ModelError::Checkpoint { .. } | ModelError::OtherScene { .. }))
}

/// Moves the metrics of a finished run, which cannot be read, beside it, if they are there at all. The evaluation
/// writes them anew from the last checkpoint, without the cost of the training.
fn put_results_away(path: &Path) -> anyhow::Result<()> {
    let results = path.join(run::RESULTS);
    warn!("{} is missing or cannot be read, and is written anew", results.display());
    match fs::rename(&results, path.with_extension("results.unreadable")) {
        Err(error) if error.kind() != io::ErrorKind::NotFound => {
            Err(error).with_context(|| format!("cannot move {}", results.display()))
        }
        _ => Ok(()),
    }
}

/// The paths of a configuration that a resumed run may change, except for that of the scene.
fn table_of(config: &Config) -> Table {
    let Config { scene, eval, .. } = config;
    let table = |paths: &[(&str, &Option<PathBuf>)]| {
        let given = paths.iter().filter_map(|(key, path)| Some((*key, path.as_deref()?)));
        // Nothing is lost: the paths come from TOML, which is UTF-8.
        let values = given.map(|(key, path)| (key.to_owned(), Value::String(path.to_string_lossy().into_owned())));
        values.collect::<Table>()
    };
    let tables = [
        ("scene", table(&[("frame_store", &scene.frame_store)])),
        ("eval", table(&[("dynamic_masks", &eval.dynamic_masks), ("lpips_weights", &eval.lpips_weights)])),
    ];
    let given = tables.into_iter().filter(|(_, table)| !table.is_empty());
    given.map(|(key, table)| (key.to_owned(), Value::Table(table))).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_resumed_cell_looks_for_its_data_where_the_sweep_says() {
        let folder = tempfile::tempdir().expect("folder");
        let path = folder.path().join("config.toml");
        let mut old = Config::default();
        let place = |name: &str| Some(folder.path().join(name));
        (old.scene.data, old.eval.dynamic_masks) = (place("old/scene"), place("old/masks"));
        fs::write(&path, config::to_toml(&old).expect("written as TOML")).expect("written");
        let mut new = old.clone();
        (new.scene.data, new.eval.dynamic_masks) = (place("new/scene"), place("new/masks"));
        let sources = ConfigSourceArgs { table: Some(table_of(&new)), ..ConfigSourceArgs::default() };
        assert_eq!(config::resume(&path, &sources, new.scene.data.as_deref()).expect("resumed"), new);
    }

    #[test]
    fn a_cell_begins_anew_only_if_its_checkpoint_is_at_fault() {
        let other_scene = || ModelError::OtherScene { reason: "a camera was removed".to_owned() };
        assert!(is_of_checkpoint(&other_scene().into()));
        assert!(is_of_checkpoint(&anyhow::Error::from(other_scene()).context("cannot resume")));
        assert!(!is_of_checkpoint(&anyhow::anyhow!("the GPU's memory is used by another program")));
    }

    #[test]
    fn a_failure_is_forgotten_once_and_none_is_no_error() {
        let folder = tempfile::tempdir().expect("folder");
        let sweep = SweepFolder::new(folder.path()).expect("a path");
        fs::create_dir(sweep.cells()).expect("made");
        sweep.note_failure("a", "no data").expect("written");
        let notes = || fs::read_dir(sweep.cells()).expect("listed").count();
        assert_eq!(notes(), 1);
        for _ in 0..2 {
            sweep.forget_failure("a").expect("removed");
            assert_eq!(notes(), 0);
        }
    }

    #[test]
    fn metrics_that_cannot_be_read_are_kept_beside_the_run_and_none_are_no_error() {
        let folder = tempfile::tempdir().expect("folder");
        let run = folder.path().join("a");
        fs::create_dir(&run).expect("made");
        fs::write(run.join(run::RESULTS), "{").expect("written");
        for _ in 0..2 {
            put_results_away(&run).expect("moved");
            assert!(!run.join(run::RESULTS).exists());
        }
        assert_eq!(fs::read(folder.path().join("a.results.unreadable")).expect("kept"), b"{");
    }
}
