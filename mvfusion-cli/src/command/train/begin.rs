//! A training before its first step: the weights of another run, and what is said before the run folder is made.

use std::path::{Path, PathBuf};

use anyhow::Context;
use mvfusion_data::{BuiltinKind, Scene};
use mvfusion_model::evaluation::Protocol;
use mvfusion_model::train::{TrainState, Trainer};
use mvfusion_model::{Config, ModelError};
use tracing::{info, warn};

use super::session::{RunFiles, Session};
use super::setup::{self, Setup};
use crate::args::TrainArgs;
use crate::config::{self, Resolved};
use crate::device::{self, OpenDevice};
use crate::interrupt::{Signals, path_for_shell};
use crate::lpips;
use crate::progress::Verbosity;
use crate::run::{self, Existing, InitialWeights, MetricsLog, RunPlan, RunRecord};

/// Parent folder of the runs, unless `--out` is given.
const RUNS: &str = "runs";

/// A training that begins.
///
/// # Errors
/// Before anything is written, unless a file of the run cannot be.
pub(super) fn begun(args: &TrainArgs, signals: Signals, verbosity: Verbosity) -> anyhow::Result<Session> {
    let mut resolved = config::resolve(&args.sources, args.data.as_deref())?;
    if let Some(note) = &resolved.note {
        verbosity.note(note);
    }
    if let Some(weights) = &args.lpips_weights {
        resolved.config.eval.lpips_weights = Some(lpips::of_option(weights, Protocol::Mvfusion)?);
    }
    let device = device::open(&args.compute.device)?;
    let path = args.out.clone().unwrap_or_else(|| default_folder(&resolved));
    let existing = if args.force { Existing::Replace } else { Existing::Keep };
    let plan = RunPlan::new(&path, existing)?;
    let scene = resolved.config.open_scene()?;
    // Adapted before it is written: the trained configuration must stay valid even if the scene gains a photo.
    let given = std::mem::take(&mut resolved.config);
    let config = given.for_times_of(&scene);
    setup::check_memory(args, &config, &scene, &device)?;
    let (trainer, weights) = match &args.init_from {
        Some(run) => {
            let (trainer, weights) = initialised_trainer(run, &config.scaled(), &scene, &device)?;
            (trainer, Some(weights))
        }
        None => (Trainer::new(config.scaled(), &scene, &device.device)?, None),
    };
    let setup = Setup::new(args, config, device, scene, trainer)?;
    setup.tell(verbosity);
    if let Some(sentence) = times_sentence(&given, &setup.config) {
        verbosity.note(&format!("times:  {sentence}"));
    }
    if let Some(seeding) = setup.trainer.seeding() {
        verbosity.note(&format!("motion: {seeding}"));
    }
    if let Some(weights) = &weights {
        verbosity.note(&format!("init:   {weights}"));
    }
    verbosity.note(&format!("run:    {}", path.display()));
    warn_of_placement(&setup.trainer, &setup.scene)?;

    let folder = plan.create()?;
    let Setup { config, device, scene, .. } = &setup;
    let record = RunRecord::begin(resolved.preset.name, scene, config.seed, &device.name)?.initialised(weights);
    let log = MetricsLog::create(&folder.place(&[run::METRICS])?)?;
    Session::new(setup, RunFiles { folder, record, log, elapsed: 0.0 }, signals, verbosity)
}

/// A trainer before its first step, with the weights of another run.
fn initialised_trainer(
    run: &Path,
    config: &Config,
    scene: &Scene,
    device: &OpenDevice,
) -> anyhow::Result<(Trainer, InitialWeights)> {
    let autodiff = device.device.clone().autodiff();
    let source = run::newest_checkpoint(run)?;
    let trained = TrainState::load_weights(&source.path, config, &autodiff).with_context(|| {
        format!(
            "the weights of {} do not fit this configuration; --config {} uses its own",
            run.display(),
            path_for_shell(&run.join(run::CONFIG)),
        )
    })?;
    let weights = InitialWeights::of(run, &trained)?;
    let state = TrainState::with_weights(trained, config, scene);
    Ok((Trainer::with_state(config.clone(), scene, &autodiff, state)?, weights))
}

/// Warns if too few dynamic Gaussians start on moving pixels: the result of such a run would be blurred.
fn warn_of_placement(trainer: &Trainer, scene: &Scene) -> Result<(), ModelError> {
    let Some(placement) = trainer.placement(scene)? else { return Ok(()) };
    match placement.advice() {
        Some(advice) => warn!("{placement}; {advice}"),
        None => info!("{placement}"),
    }
    Ok(())
}

/// The keys that were adapted to the scene's times, with both values; `None` if there are none.
fn times_sentence(given: &Config, fitted: &Config) -> Option<String> {
    let numbers = |config: &Config| {
        let Config { model, motion, .. } = config;
        [
            ("model.grid.resolution[3]", model.grid.resolution[3]),
            ("motion.window", motion.window),
            ("motion.knots", motion.knots),
        ]
    };
    let changed = numbers(given).into_iter().zip(numbers(fitted)).filter(|(given, fitted)| given != fitted);
    let said: Vec<String> = changed.map(|((key, given), (_, fitted))| format!("{key} {given} -> {fitted}")).collect();
    (!said.is_empty()).then(|| said.join(", "))
}

/// `runs/NAME-SEED`. NAME is the name of the scene folder, or of the preset, followed by the kind of the built-in scene
/// unless that is the default one.
fn default_folder(resolved: &Resolved) -> PathBuf {
    let options = &resolved.config.scene;
    let name = match &options.data {
        Some(folder) => folder.file_name().map_or("scene".into(), |name| name.to_string_lossy().into_owned()),
        None => match options.kind {
            BuiltinKind::Video => resolved.preset.name.to_owned(),
            kind => format!("{}-{}", resolved.preset.name, kind.key()),
        },
    };
    Path::new(RUNS).join(format!("{name}-{}", resolved.config.seed))
}
