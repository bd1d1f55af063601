//! `mvfusion train`.

use std::io::Write;
use std::path::{Path, PathBuf};
use std::time::{Duration, Instant};

use anyhow::{Context, anyhow};
use mvfusion_data::{BuiltinKind, Scene};
use mvfusion_model::config::TrainConfig;
use mvfusion_model::evaluation::{Evaluator, Protocol};
use mvfusion_model::files::sha256;
use mvfusion_model::train::{Losses, Position, TrainState, TrainedModel, Trainer};
use mvfusion_model::{Config, ModelError};
use tracing::{info, warn};

use super::score::{self, Scoring};
use crate::args::TrainArgs;
use crate::config::{self, Resolved};
use crate::device::{self, OpenDevice};
use crate::failure::UsageError;
use crate::interrupt::{Interrupted, Signals, resume_command};
use crate::progress::{Pace, Progress, Verbosity};
use crate::run::{
    self, Existing, GaussianCounts, MetricsLine, MetricsLog, PicturesWriter, RunFolder, RunPlan, RunRecord, TrainTime,
    milliseconds, write_ply,
};
use crate::{atomic, report, scene, table};

/// How often a checkpoint is tried to be written, and the pause in between.
const SAVE_ATTEMPTS: usize = 3;
const SAVE_PAUSE: Duration = Duration::from_secs(2);

/// Parent folder of the runs, unless `--out` is given.
const RUNS: &str = "runs";

/// Trains on a scene, evaluates, and writes a run folder.
///
/// # Errors
/// For an invalid command line, before anything is written. Later, if the device fails, the loss is not finite, or a
/// file cannot be written. [`Interrupted`] after a signal, once the run is saved.
pub fn train(args: &TrainArgs, verbosity: Verbosity, out: &mut dyn Write) -> anyhow::Result<()> {
    let signals = Signals::watch().context("cannot watch for signals")?;
    match &args.resume {
        Some(run) => resumed(args, run, signals, verbosity)?.run(out),
        None => begun(args, signals, verbosity)?.run(out),
    }
}

/// A training that begins.
fn begun(args: &TrainArgs, signals: Signals, verbosity: Verbosity) -> anyhow::Result<Session> {
    let mut resolved = config::resolve(&args.sources, args.data.as_deref())?;
    if let Some(note) = &resolved.note {
        verbosity.note(note);
    }
    if let Some(weights) = &args.lpips_weights {
        resolved.config.eval.lpips_weights = Some(std::path::absolute(weights)?);
    }
    let device = device::open(&args.compute.device)?;
    let path = args.out.clone().unwrap_or_else(|| default_folder(&resolved));
    let existing = if args.force { Existing::Replace } else { Existing::Keep };
    let plan = RunPlan::new(&path, existing)?;
    let scene = scene::open(&resolved.config)?;
    // Adapted before it is written: the trained configuration must stay valid even if the scene gains a photo.
    let given = std::mem::take(&mut resolved.config);
    let config = given.for_times_of(&scene);
    let trainer =
        Trainer::new(config.scaled(), &scene, &device.device)?.with_image_cache(&scene, args.image_cache.as_u64())?;
    let evaluator = evaluator(&config, &device)?;
    verbosity.note(&format!("device: {}", device.reason));
    verbosity.note(&format!("scene:  {}", scene::describe(&scene)));
    if let Some(sentence) = times_sentence(&given, &config) {
        verbosity.note(&format!("times:  {sentence}"));
    }
    if let Some(seeding) = trainer.seeding() {
        verbosity.note(&format!("motion: {seeding}"));
    }
    verbosity.note(&format!("run:    {}", path.display()));
    warn_of_placement(&trainer, &scene)?;

    let folder = plan.create()?;
    let record = RunRecord::begin(resolved.preset.name, &scene, config.seed, &device.name);
    let log = MetricsLog::create(&folder.place(&[run::METRICS])?)?;
    Ok(Session { config, record, device, scene, trainer, evaluator, folder, log, elapsed: 0.0, signals, verbosity })
}

/// A training that continues from the newest checkpoint of a run.
fn resumed(args: &TrainArgs, path: &Path, signals: Signals, verbosity: Verbosity) -> anyhow::Result<Session> {
    let record: RunRecord = run::read_json(&path.join(run::RECORD))
        .with_context(|| format!("{} is not a run that can be continued", path.display()))?;
    if record.finished.is_some() {
        return Err(
            UsageError::new(format!("the run in {} is finished: there is nothing to resume.", path.display())).into()
        );
    }
    let mut config = config::resume(&path.join(run::CONFIG), &args.sources, args.data.as_deref())?;
    if let Some(weights) = &args.lpips_weights {
        config.eval.lpips_weights = Some(std::path::absolute(weights)?);
    }
    let device = device::open(&args.compute.device)?;
    let scene = scene::open(&config)?;
    let state = newest_state(path, &config.scaled(), &device, verbosity)?;
    let step = state.completed;
    let trainer = Trainer::with_state(config.scaled(), &scene, &device.device.clone().autodiff(), state)?
        .with_image_cache(&scene, args.image_cache.as_u64())?;
    let evaluator = evaluator(&config, &device)?;
    verbosity.note(&format!("device: {}", device.reason));
    verbosity.note(&format!("scene:  {}", scene::describe(&scene)));
    let total = config.scaled().train.stages.total();
    verbosity.note(&format!("run:    {}, continued after step {step} of {total}", path.display()));

    let folder = RunFolder::continued(path)?;
    let (log, elapsed) = MetricsLog::resume(&folder.place(&[run::METRICS])?, step)?;
    let record = record.continued(step);
    Ok(Session { config, record, device, scene, trainer, evaluator, folder, log, elapsed, signals, verbosity })
}

/// The state of the newest checkpoint that can be read.
fn newest_state(path: &Path, config: &Config, device: &OpenDevice, verbosity: Verbosity) -> anyhow::Result<TrainState> {
    let device = device.device.clone().autodiff();
    let mut refusal = anyhow!("{} contains no checkpoint: train it again with --out and --force", path.display());
    for checkpoint in run::checkpoints(path)? {
        match TrainState::load(&checkpoint.path, config, &device) {
            Ok(state) => return Ok(state),
            Err(error) => {
                verbosity.note(&format!("note:   {error}"));
                refusal = error.into();
            }
        }
    }
    Err(refusal)
}

fn evaluator(config: &Config, device: &OpenDevice) -> anyhow::Result<Evaluator> {
    score::evaluator(Protocol::Mvfusion, config.eval.lpips_weights.as_deref(), &device.device)
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

/// `runs/NAME-SEED`. NAME is the name of the scene folder, or of the preset, followed by `-casual` for the second
/// built-in scene.
fn default_folder(resolved: &Resolved) -> PathBuf {
    let options = &resolved.config.scene;
    let name = match &options.data {
        Some(folder) => folder.file_name().map_or("scene".into(), |name| name.to_string_lossy().into_owned()),
        None if options.kind == BuiltinKind::Casual => format!("{}-casual", resolved.preset.name),
        None => resolved.preset.name.to_owned(),
    };
    Path::new(RUNS).join(format!("{name}-{}", resolved.config.seed))
}

/// A training in progress.
struct Session {
    /// The configuration as it is written: `train.scale` is not applied.
    config: Config,
    record: RunRecord,
    device: OpenDevice,
    scene: Scene,
    trainer: Trainer,
    evaluator: Evaluator,
    folder: RunFolder,
    log: MetricsLog,
    /// Seconds of training before this process.
    elapsed: f64,
    signals: Signals,
    verbosity: Verbosity,
}

impl Session {
    fn run(mut self, out: &mut dyn Write) -> anyhow::Result<()> {
        let written = config::to_toml(&self.config)?;
        atomic::write(&self.folder.place(&[run::CONFIG])?, written.as_bytes())?;
        atomic::write_json(&self.folder.place(&[run::RECORD])?, &self.record)?;

        let trained = self.train();
        let time = trained.inspect_err(|error| self.tell_what_is_kept(error))?;
        self.save(run::FINAL)?;
        if let Some(code) = self.signals.exit_code() {
            return Err(self.interrupted(code).into());
        }
        // Nothing is lost by ending now: what follows can be done again from the final checkpoint.
        self.signals.end_at_once();
        self.write_gaussians(time.steps)?;
        let mut words = Vec::new();
        self.evaluate(time, sha256(written.as_bytes()), &mut words)?;
        let finished = self.record.clone().finished();
        atomic::write_json(&self.folder.place(&[run::RECORD])?, &finished)?;
        self.folder.finish();
        // Last, because the report is built from all other files.
        let report = report::write(self.folder.path())?;
        // Files first: whoever reads stdout may have left.
        out.write_all(&words)?;
        Ok(writeln!(out, "{:16}{}", "report", report.display())?)
    }

    /// All remaining steps of all stages.
    fn train(&mut self) -> anyhow::Result<TrainTime> {
        let total = self.trainer.config().train.stages.total();
        let mut checkpoints = CheckpointClock::new(&self.config.scaled().train);
        let mut watch = Watch::new(self, total);
        while let Some(position) = self.trainer.position() {
            let Some(loss) = self.trainer.step()? else { break };
            // From the first step on there is something to lose.
            self.folder.keep();
            let done = self.trainer.state().completed;
            if self.trainer.log_due(&position) {
                watch.log_step(&self.trainer, &mut self.log, &position, &loss)?;
            }
            watch.progress.advance();
            if done == total {
                break;
            }
            if let Some(code) = self.signals.exit_code() {
                self.save(&run::step_file(done))?;
                watch.progress.finish();
                return Err(self.interrupted(code).into());
            }
            if checkpoints.is_due(done) {
                self.save(&run::step_file(done))?;
                // An old checkpoint that stays is no reason to stop.
                if let Err(error) = run::thin_out(self.folder.path(), self.config.train.keep_checkpoints) {
                    warn!("{error:#}");
                }
                checkpoints.saved();
            }
        }
        watch.progress.finish();
        Ok(TrainTime { seconds: watch.elapsed(), steps: self.trainer.state().completed })
    }

    /// The error of a run that was interrupted and saved.
    fn interrupted(&self, code: u8) -> Interrupted {
        let total = self.trainer.config().train.stages.total();
        Interrupted { code, done: self.trainer.state().completed, total, run: self.folder.path().to_owned() }
    }

    /// Writes the state. What fails is tried again: a disk may be full for a moment.
    fn save(&self, name: &str) -> anyhow::Result<()> {
        let path = self.folder.place(&[run::CHECKPOINTS, name])?;
        let started = Instant::now();
        let mut attempt = 1;
        while let Err(error) = self.trainer.state().save(&path) {
            if attempt == SAVE_ATTEMPTS {
                return Err(error.into());
            }
            warn!("{error}; attempt {attempt} of {SAVE_ATTEMPTS}");
            std::thread::sleep(SAVE_PAUSE);
            attempt += 1;
        }
        info!("{} written in {:.2} s", path.display(), started.elapsed().as_secs_f64());
        Ok(())
    }

    /// After a failure: the folder and how to go on from it.
    fn tell_what_is_kept(&self, error: &anyhow::Error) {
        let path = self.folder.path();
        if error.is::<Interrupted>() || self.trainer.state().completed == 0 {
            return;
        }
        match run::checkpoints(path) {
            Ok(checkpoints) if !checkpoints.is_empty() => {
                self.verbosity.note(&format!("note:   the run is kept. Continue with: {}", resume_command(path)));
            }
            _ => self.verbosity.note(&format!("note:   {} is kept; it contains no checkpoint yet", path.display())),
        }
    }

    fn write_gaussians(&self, steps: usize) -> anyhow::Result<()> {
        let iteration = format!("iteration_{steps}");
        let model = self.trainer.state().model.plain();
        for (name, branch) in model.branches() {
            let file = format!("{name}.ply");
            let cloud = branch.to_cloud()?;
            write_ply(&cloud, &self.folder.place(&[run::POINT_CLOUD, &iteration, &file])?)?;
        }
        Ok(())
    }

    /// Scores the model, writes metrics and images, and prints the table.
    fn evaluate(&self, time: TrainTime, config_sha256: String, out: &mut dyn Write) -> anyhow::Result<()> {
        let config = self.trainer.config();
        let pictures = PicturesWriter::new(self.folder.path(), &config.eval, self.scene.test.len());
        let trained = TrainedModel::from(self.trainer.state());
        let scoring = Scoring {
            trained: &trained,
            scene: &self.scene,
            config,
            config_sha256,
            evaluator: &self.evaluator,
            speed_frames: 0,
            time: Some(time),
            device: &self.device.name,
        };
        let scored = scoring.score(Some(&pictures), self.verbosity)?;
        scored.write(self.folder.path())?;
        table::write(&scored.results, self.evaluator.protocol(), out)?;
        writeln!(out, "{:16}{}", "run", self.folder.path().display())?;
        if let Some(strip) = pictures.strip_to_see() {
            writeln!(out, "{:16}{}", "start with", strip.display())?;
            writeln!(out, "{:16}({})", "", run::legend(&self.trainer.state().model))?;
        }
        Ok(())
    }
}

/// When the next checkpoint is due.
struct CheckpointClock {
    /// Steps between checkpoints; 0 goes by the time.
    every: usize,
    /// Time between checkpoints; none if `None`.
    pause: Option<Duration>,
    last: Instant,
}

impl CheckpointClock {
    fn new(config: &TrainConfig) -> Self {
        let pause = (config.checkpoint_minutes > 0.0).then_some(60.0 * config.checkpoint_minutes);
        // More than centuries of minutes is never.
        let pause = pause.and_then(|seconds| Duration::try_from_secs_f64(seconds).ok());
        Self { every: config.checkpoint_interval.0, pause, last: Instant::now() }
    }

    fn is_due(&self, done: usize) -> bool {
        match self.every {
            0 => self.pause.is_some_and(|pause| self.last.elapsed() >= pause),
            every => done.is_multiple_of(every),
        }
    }

    fn saved(&mut self) {
        self.last = Instant::now();
    }
}

/// Observers of a training: progress and pace.
struct Watch {
    progress: Progress,
    pace: Pace,
    /// Seconds of training before this process.
    before: f64,
    /// Steps done at the last line.
    logged: usize,
    total: usize,
}

impl Watch {
    fn new(session: &Session, total: usize) -> Self {
        let done = session.trainer.state().completed;
        let progress = Progress::new("training", total, session.verbosity).after(done);
        let mut pace = Pace::default();
        pace.mark(done);
        Self { progress, pace, before: session.elapsed, logged: done, total }
    }

    /// Seconds of training in all processes.
    fn elapsed(&self) -> f64 {
        self.before + self.pace.elapsed()
    }

    /// Reads the losses of a step, which waits for the device, and logs them.
    fn log_step(
        &mut self,
        trainer: &Trainer,
        log: &mut MetricsLog,
        position: &Position,
        loss: &Losses,
    ) -> anyhow::Result<()> {
        let (loss, squared_error) = read(loss)?;
        let state = trainer.state();
        let done = state.completed;
        self.pace.mark(done);
        let line = MetricsLine {
            step: done,
            stage: position.stage.name(),
            stage_step: position.stage_step,
            loss,
            psnr: (squared_error > 0.0).then(|| -10.0 * f64::from(squared_error).log10()),
            gaussians: GaussianCounts::of(&state.model),
            steps_per_second: self.pace.steps_per_second(),
            elapsed: self.elapsed(),
            ms: milliseconds(done - self.logged),
        };
        self.logged = done;
        log.add(&line)?;
        self.progress.say(self.sentence(&line));
        Ok(())
    }

    /// The progress line. Parts that a narrow terminal may cut off come last.
    fn sentence(&self, line: &MetricsLine) -> String {
        let psnr = line.psnr.map_or("-".to_owned(), |psnr| format!("{psnr:.2}"));
        format!(
            "{}  {:.1} step/s  {}  loss {:.4}  PSNR {psnr} dB  {}",
            line.stage,
            line.steps_per_second,
            self.pace.left(self.total - line.step),
            line.loss,
            line.gaussians.sentence(" + "),
        )
    }
}

/// Loss and squared error of a step. Waits for the device.
fn read(loss: &Losses) -> Result<(f32, f32), ModelError> {
    let total = loss.total.clone().try_into_scalar::<f32>();
    let squared_error = loss.squared_error.clone().try_into_scalar::<f32>();
    let failed = |error: &dyn std::fmt::Display| ModelError::Device(error.to_string());
    Ok((total.map_err(|error| failed(&error))?, squared_error.map_err(|error| failed(&error))?))
}
