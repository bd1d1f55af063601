//! `mvfusion train`.

#[cfg(feature = "viewer")]
mod live;
#[cfg(not(feature = "viewer"))]
#[path = "no_live.rs"]
mod live;
mod session;
mod watch;

use std::io::{self, Write};
use std::path::{Path, PathBuf};

use anyhow::{Context, anyhow};
use mvfusion_data::{BuiltinKind, Scene};
use mvfusion_model::evaluation::{Evaluator, Protocol};
use mvfusion_model::train::{TrainState, Trainer};
use mvfusion_model::{Config, ModelError};
use tracing::{info, warn};

use super::score;
use crate::args::TrainArgs;
use crate::config::{self, Resolved};
use crate::device::{self, OpenDevice};
use crate::failure::UsageError;
use crate::interrupt::Signals;
use crate::lpips::LpipsFolder;
use crate::memory::MemoryRule;
use crate::progress::Verbosity;
use crate::run::{self, Checkpoint, Existing, InitialWeights, MetricsLog, RunFolder, RunPlan, RunRecord};
use crate::tensorboard::EventFile;
#[cfg(feature = "viewer")]
use crate::viewer::address::BoundSocket;
use crate::{lpips, memory, scene};
use session::Session;

pub use session::Observer;

/// Parent folder of the runs, unless `--out` is given.
const RUNS: &str = "runs";

/// Trains on a scene, evaluates, and writes a run folder.
///
/// # Errors
/// For an invalid command line, before anything is written. Later, if the device fails, the loss is not finite, or a
/// file cannot be written. [`Interrupted`](crate::interrupt::Interrupted) after a signal, once the run is saved.
pub fn train(args: &TrainArgs, verbosity: Verbosity, out: &mut dyn Write) -> anyhow::Result<()> {
    let signals = Signals::watch().context("cannot watch for signals")?;
    let socket = live::bind_viewer(args)?;
    trained(args, signals, socket, verbosity, out)
}

/// The same in a thread of a program: with signals of its own, and a viewer at a socket that listens already.
///
/// # Errors
/// As [`train`].
#[cfg(feature = "viewer")]
pub fn train_in_thread(
    args: &TrainArgs,
    signals: Signals,
    viewer: Option<BoundSocket>,
    verbosity: Verbosity,
    out: &mut dyn Write,
) -> anyhow::Result<()> {
    trained(args, signals, viewer, verbosity, out)
}

/// The same for a program that embeds this one: with signals of its own, and an observer. Returns the run folder.
///
/// # Errors
/// As [`train`]; [`Interrupted`](crate::interrupt::Interrupted) also if the observer ended it.
pub fn train_observed(
    args: &TrainArgs,
    signals: Signals,
    observer: Option<Observer>,
    verbosity: Verbosity,
) -> anyhow::Result<PathBuf> {
    let session = opened(args, signals, verbosity)?;
    let folder = session.folder.path().to_owned();
    Session { observer, ..session }.run(&mut io::sink())?;
    Ok(folder)
}

fn trained(
    args: &TrainArgs,
    signals: Signals,
    socket: live::ViewerSocket,
    verbosity: Verbosity,
    out: &mut dyn Write,
) -> anyhow::Result<()> {
    let session = opened(args, signals, verbosity)?;
    let path = session.folder.path().to_owned();
    let ended = session.watched(socket).and_then(|session| session.run(out));
    // A run that fails at its first step takes its folder with it.
    if path.is_dir() {
        verbosity.wrote("run", &path);
    }
    ended
}

/// A training before its first step in this process.
fn opened(args: &TrainArgs, signals: Signals, verbosity: Verbosity) -> anyhow::Result<Session> {
    match &args.resume {
        Some(run) => resumed(args, run, signals, verbosity),
        None => begun(args, signals, verbosity),
    }
}

/// A training that begins.
fn begun(args: &TrainArgs, signals: Signals, verbosity: Verbosity) -> anyhow::Result<Session> {
    let mut resolved = config::resolve(&args.sources, args.data.as_deref())?;
    if let Some(note) = &resolved.note {
        verbosity.note(note);
    }
    if let Some(weights) = &args.lpips_weights {
        resolved.config.eval.lpips_weights = Some(lpips::kept(weights)?);
    }
    let device = device::open(&args.compute.device)?;
    let path = args.out.clone().unwrap_or_else(|| default_folder(&resolved));
    let existing = if args.force { Existing::Replace } else { Existing::Keep };
    let plan = RunPlan::new(&path, existing)?;
    let scene = scene::open(&resolved.config)?;
    // Adapted before it is written: the trained configuration must stay valid even if the scene gains a photo.
    let given = std::mem::take(&mut resolved.config);
    let config = given.for_times_of(&scene);
    check_memory(args, &config, &scene, &device)?;
    let (trainer, weights) = match &args.init_from {
        Some(run) => {
            let (trainer, weights) = initialised_trainer(run, &config.scaled(), &scene, &device)?;
            (trainer, Some(weights))
        }
        None => (Trainer::new(config.scaled(), &scene, &device.device)?, None),
    };
    let trainer = trainer.with_image_cache(&scene, args.image_cache.as_u64())?;
    let (lpips_folder, evaluator) = evaluator(&config, &device)?;
    verbosity.note(&format!("device: {}", device.reason));
    verbosity.note(&format!("scene:  {}", scene::describe(&scene)));
    if let Some(folder) = &lpips_folder {
        verbosity.note(&format!("lpips:  {folder}"));
    }
    if let Some(sentence) = times_sentence(&given, &config) {
        verbosity.note(&format!("times:  {sentence}"));
    }
    if let Some(seeding) = trainer.seeding() {
        verbosity.note(&format!("motion: {seeding}"));
    }
    if let Some(weights) = &weights {
        verbosity.note(&format!("init:   {weights}"));
    }
    verbosity.note(&format!("run:    {}", path.display()));
    warn_of_placement(&trainer, &scene)?;

    let folder = plan.create()?;
    let record = RunRecord::begin(resolved.preset.name, &scene, config.seed, &device.name).initialised(weights);
    let log = MetricsLog::create(&folder.place(&[run::METRICS])?)?;
    let events = event_file(&config, &folder, 0)?;
    Ok(Session {
        config,
        record,
        device,
        scene,
        trainer,
        lpips_folder,
        evaluator,
        folder,
        log,
        events,
        elapsed: 0.0,
        signals,
        verbosity,
        observer: None,
        live: None,
    })
}

/// The event file of a training that has done so many steps, if the configuration asks for one.
fn event_file(config: &Config, folder: &RunFolder, done: usize) -> anyhow::Result<Option<EventFile>> {
    let create = || EventFile::create(&folder.path().join(run::TENSORBOARD), done + 1);
    config.train.tensorboard.then(create).transpose()
}

/// Refuses what does not fit into the memory, unless `--force-memory` is given.
fn check_memory(args: &TrainArgs, config: &Config, scene: &Scene, device: &OpenDevice) -> anyhow::Result<()> {
    let rule = MemoryRule::of_flag(args.force_memory);
    memory::check_training(&config.scaled(), scene, args.image_cache.as_u64(), device, rule)
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
            "the weights of {run} do not fit this configuration; --config {run}/{} uses its own",
            run::CONFIG,
            run = run.display(),
        )
    })?;
    let weights = InitialWeights::of(run, &trained)?;
    let state = TrainState::with_weights(trained, config, scene);
    Ok((Trainer::with_state(config.clone(), scene, &autodiff, state)?, weights))
}

/// A training that continues from the newest checkpoint of a run.
fn resumed(args: &TrainArgs, path: &Path, signals: Signals, verbosity: Verbosity) -> anyhow::Result<Session> {
    let folder = RunFolder::continued(path)?;
    if let Some(note) = run::waiting_note(path) {
        verbosity.note(&format!("note:   {note}"));
    }
    let record: RunRecord = run::read_json(&path.join(run::RECORD))
        .with_context(|| format!("{} is not a run that can be continued", path.display()))?;
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
        config.eval.lpips_weights = Some(lpips::kept(weights)?);
    }
    let device = device_of_run(&args.compute.device, &record.device)?;
    let scene = scene::open(&config)?;
    check_memory(args, &config, &scene, &device)?;
    let (checkpoint, state) = newest_state(path, &config.scaled(), &device, verbosity)?;
    let step = state.completed;
    let trainer = Trainer::with_state(config.scaled(), &scene, &device.device.clone().autodiff(), state)?
        .with_image_cache(&scene, args.image_cache.as_u64())?;
    let (lpips_folder, evaluator) = evaluator(&config, &device)?;
    verbosity.note(&format!("device: {}", device.reason));
    verbosity.note(&format!("scene:  {}", scene::describe(&scene)));
    if let Some(folder) = &lpips_folder {
        verbosity.note(&format!("lpips:  {folder}"));
    }
    let total = config.scaled().train.stages.total();
    verbosity.note(&format!("run:    {}, continued after step {step} of {total}", path.display()));

    if step < total {
        run::make_intermediate(&checkpoint, step)?;
    }
    let (log, elapsed) = MetricsLog::resume(&folder.place(&[run::METRICS])?, step)?;
    let events = event_file(&config, &folder, step)?;
    let record = record.continued(step);
    Ok(Session {
        config,
        record,
        device,
        scene,
        trainer,
        lpips_folder,
        evaluator,
        folder,
        log,
        events,
        elapsed,
        signals,
        verbosity,
        observer: None,
        live: None,
    })
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
            Err(error) => {
                verbosity.note(&format!("note:   {error}"));
                refusal = error.into();
                refused.push(checkpoint);
            }
        }
    }
    Err(refusal)
}

/// The folder of the weights of LPIPS, and what scores with them.
fn evaluator(config: &Config, device: &OpenDevice) -> anyhow::Result<(Option<LpipsFolder>, Evaluator)> {
    let folder = lpips::find(config.eval.lpips_weights.as_deref())?;
    let evaluator = score::evaluator(Protocol::Mvfusion, folder.as_ref(), &device.device)?;
    Ok((folder, evaluator))
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
            BuiltinKind::Motion => format!("{}-motion", resolved.preset.name),
            BuiltinKind::Casual => format!("{}-casual", resolved.preset.name),
        },
    };
    Path::new(RUNS).join(format!("{name}-{}", resolved.config.seed))
}
