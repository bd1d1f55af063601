//! A training that goes on from a checkpoint.

use std::path::Path;

use anyhow::{Context, anyhow};
use mvfusion_model::evaluation::Protocol;
use mvfusion_model::train::{TrainState, Trainer};
use mvfusion_model::{Config, ModelError};
use tracing::warn;

use super::session::{RunFiles, Session};
use super::setup::{self, Setup};
use crate::args::TrainArgs;
use crate::config;
use crate::device::{self, OpenDevice};
use crate::failure::UsageError;
use crate::interrupt::Signals;
use crate::lpips;
use crate::progress::Verbosity;
use crate::run::{self, Checkpoint, MetricsLog, RunFolder, RunRecord};

/// A training that continues from the newest checkpoint of a run.
///
/// # Errors
/// If there is none, or the configuration, the scene or the device does not fit it.
pub(super) fn resumed(
    args: &TrainArgs,
    path: &Path,
    signals: Signals,
    verbosity: Verbosity,
) -> anyhow::Result<Session> {
    let folder = RunFolder::continued(path)?;
    if let Some(note) = run::waiting_note(path) {
        verbosity.note(&format!("note:   {note}"));
    }
    let record: RunRecord = run::read_json(&path.join(run::RECORD))
        .with_context(|| format!("{} is not a run that can be continued", path.display()))?;
    if record.config_sha256.as_ref().is_some_and(|written| run::config_hash(path).is_ok_and(|now| now != *written)) {
        warn!(
            "{} was changed since the run began; it goes on with the new values, so its end is not that of a run without \
             a break",
            path.join(run::CONFIG).display()
        );
    }
    let mut config = config::resume(&path.join(run::CONFIG), &args.sources, args.data.as_deref())?;
    if record.finished.is_some() && config.train.stages == config::read(&path.join(run::CONFIG))?.train.stages {
        let (key, steps) = config::last_stage(&config);
        return Err(UsageError::new(format!(
            "the run in {} is finished: there is nothing to resume. To train it longer, add for example --set \
             {key}={}.",
            path.display(),
            2 * steps
        ))
        .into());
    }
    if let Some(weights) = &args.lpips_weights {
        config.eval.lpips_weights = Some(lpips::of_option(weights, Protocol::Mvfusion)?);
    }
    let device = device_of_run(&args.compute.device, &record.device)?;
    let scene = config.open_scene().context(
        "cannot open the scene of the run; if it has moved, give its folder with --data and the folder of the masks \
         with --set eval.dynamic_masks=DIR",
    )?;
    record.scene.check(&scene)?;
    // The checkpoint has the Gaussians: the files that the run began with may be gone.
    let mut without_files = config.clone();
    (without_files.init.static_ply, without_files.init.dynamic_ply) = (None, None);
    setup::check_memory(args, &without_files, &scene, &device)?;
    let (checkpoint, state) = newest_state(path, &config.scaled(), &device, verbosity)?;
    let step = state.completed;
    let trainer = Trainer::with_state(config.scaled(), &scene, &device.device.clone().autodiff(), state)?;
    let setup = Setup::new(args, config, device, scene, trainer)?;
    setup.tell(verbosity);
    let total = setup.config.scaled().train.stages.total();
    verbosity.note(&format!("run:    {}, continued after step {step} of {total}", path.display()));

    if step < total {
        run::make_intermediate(&checkpoint, step)?;
    }
    let (log, elapsed) = MetricsLog::resume(&folder.place(&[run::METRICS])?, step)?;
    Session::new(setup, RunFiles { folder, record: record.continued(step), log, elapsed }, signals, verbosity)
}

/// The device on which a run goes on: its own, unless another one is asked for, or this machine does not have it.
fn device_of_run(asked: &str, own: &str) -> Result<OpenDevice, UsageError> {
    if asked == device::AUTO {
        match device::open(own) {
            Ok(device) => return Ok(device),
            Err(error) => warn!("the run was trained on `{own}`, which is not here: {error}"),
        }
    }
    let device = device::open(asked)?;
    if device.name != own {
        warn!(
            "the run was trained on `{own}` and goes on on `{}`, where sums have another order: its end is not exactly \
             that of a run without a break",
            device.name
        );
    }
    Ok(device)
}

/// The newest checkpoint of a run that can be read, and its state. Newer ones are put out of the way.
fn newest_state(
    path: &Path,
    config: &Config,
    device: &OpenDevice,
    verbosity: Verbosity,
) -> anyhow::Result<(Checkpoint, TrainState)> {
    let device = device.device.clone().autodiff();
    let mut refusal = anyhow!("{} contains no checkpoint: train it again with --out and --force", path.display());
    let mut refused = Vec::new();
    for checkpoint in run::checkpoints(path)? {
        match TrainState::load(&checkpoint.path, config, &device) {
            Ok(state) => {
                refused.iter().try_for_each(run::put_away)?;
                return Ok((checkpoint, state));
            }
            Err(error @ ModelError::Checkpoint { .. }) => {
                verbosity.note(&format!("note:   {error}"));
                refusal = error.into();
                refused.push(checkpoint);
            }
            // It may be as good as ever: a disk that does not answer, or a full device.
            Err(error) => return Err(error.into()),
        }
    }
    Err(refusal)
}
