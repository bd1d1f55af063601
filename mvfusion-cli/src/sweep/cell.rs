//! One cell as a process: what a job of this machine and a task of SLURM both run.

use std::io::Write;
use std::path::Path;

use anyhow::{bail, ensure};
use bytesize::ByteSize;
use mvfusion_model::ModelError;
use mvfusion_model::evaluation::Protocol;
use mvfusion_model::train::IMAGE_CACHE;
use tracing::warn;

use super::folder::{Order, State, SweepFolder};
use crate::args::{ComputeArgs, ConfigSourceArgs, EvalArgs, RunCellArgs, TrainArgs};
use crate::command;
use crate::interrupt::Interrupted;
use crate::progress::Verbosity;
use crate::run;

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
        // An interrupted cell has not failed: it goes on from its checkpoint.
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
            // What is there is the rest of an interrupted run.
            force: true,
            #[cfg(feature = "viewer")]
            viewer: crate::args::TrainViewArgs::default(),
            init_from: None,
            resume: None,
        };
        train(&folder.run(id), run, verbosity, out)?;
    }
    if !folder.is_finished(id, &order.wanted) {
        let eval = EvalArgs {
            run: folder.run(id),
            data: None,
            masks: None,
            lpips_weights: order.wanted.lpips_weights.clone(),
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

/// Trains a cell: continues the run of its folder if that has a checkpoint that can be read, else begins anew.
fn train(path: &Path, anew: TrainArgs, verbosity: Verbosity, out: &mut dyn Write) -> anyhow::Result<()> {
    if !run::checkpoints(path)?.is_empty() {
        let resumed = TrainArgs {
            sources: ConfigSourceArgs::default(),
            out: None,
            force: false,
            resume: Some(path.to_owned()),
            ..anew.clone()
        };
        match command::train(&resumed, verbosity, out) {
            Err(error) if matches!(error.downcast_ref(), Some(ModelError::Checkpoint { .. })) => warn!("{error:#}"),
            result => return result,
        }
    }
    command::train(&anew, verbosity, out)
}
