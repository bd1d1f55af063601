//! A training in progress, from the first step to the report.

use std::io::Write;
use std::ops::ControlFlow;
use std::time::{Duration, Instant};

use mvfusion_data::Scene;
use mvfusion_model::Config;
use mvfusion_model::evaluation::Evaluator;
use mvfusion_model::files::sha256;
use mvfusion_model::train::Trainer;
use tracing::{info, warn};

use super::live::{Live, ViewerSocket};
use super::setup::Setup;
use super::watch::{CheckpointClock, Watch};
use crate::device::OpenDevice;
use crate::interrupt::{Interrupted, Signals, resume_command};
use crate::lpips::LpipsFolder;
use crate::progress::Verbosity;
use crate::run::{self, MetricsLine, MetricsLog, RunFolder, RunRecord, TrainCost};
use crate::tensorboard::EventFile;
use crate::{atomic, config, memory, report};

/// How often a checkpoint is tried to be written, and the pause in between.
const SAVE_ATTEMPTS: usize = 3;
const SAVE_PAUSE: Duration = Duration::from_secs(2);

/// Is told of each logged step, and may end the training: it is then saved, as after a signal. The time that an observer
/// takes is no part of the training's.
pub type Observer = Box<dyn FnMut(&MetricsLine) -> ControlFlow<()> + Send>;

/// The files that a training writes.
pub(super) struct RunFiles {
    pub(super) folder: RunFolder,
    pub(super) record: RunRecord,
    pub(super) log: MetricsLog,
    /// Seconds of training before this process, by the log.
    pub(super) elapsed: f64,
}

/// A training in progress.
pub(super) struct Session {
    /// The configuration as it is written: `train.scale` is not applied.
    pub(super) config: Config,
    pub(super) record: RunRecord,
    pub(super) device: OpenDevice,
    pub(super) scene: Scene,
    pub(super) trainer: Trainer,
    pub(super) lpips_folder: Option<LpipsFolder>,
    pub(super) evaluator: Evaluator,
    pub(super) folder: RunFolder,
    pub(super) log: MetricsLog,
    /// For TensorBoard, with `train.tensorboard`.
    pub(super) events: Option<EventFile>,
    /// Seconds of training before this process.
    pub(super) elapsed: f64,
    pub(super) signals: Signals,
    pub(super) verbosity: Verbosity,
    /// The program that embeds this one.
    pub(super) observer: Option<Observer>,
    /// Those who watch.
    pub(super) live: Option<Live>,
}

impl Session {
    /// A training that goes on from the trainer's state, without observers.
    ///
    /// # Errors
    /// If the event file cannot be written.
    pub(super) fn new(setup: Setup, files: RunFiles, signals: Signals, verbosity: Verbosity) -> anyhow::Result<Self> {
        let Setup { config, device, scene, trainer, lpips_folder, evaluator } = setup;
        let RunFiles { folder, record, log, elapsed } = files;
        let next = trainer.state().completed + 1;
        let create = || EventFile::create(&folder.path().join(run::TENSORBOARD), next);
        let events = config.train.tensorboard.then(create).transpose()?;
        Ok(Self {
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

    /// The same, watched at a socket if there is one.
    pub(super) fn watched(self, socket: ViewerSocket) -> anyhow::Result<Self> {
        Ok(Self { live: Live::start(socket, &self)?, ..self })
    }

    pub(super) fn run(mut self, out: &mut dyn Write) -> anyhow::Result<()> {
        let written = config::to_toml(&self.config)?;
        self.record.config_sha256 = Some(sha256(written.as_bytes()));
        // The record first: a finished run that is lengthened must not seem finished with the new configuration.
        atomic::write_json(&self.folder.place(&[run::RECORD])?, &self.record)?;
        atomic::write(&self.folder.place(&[run::CONFIG])?, written.as_bytes())?;

        let trained = self.train();
        if let (Some(live), Ok(_), None) = (&self.live, &trained, self.signals.exit_code()) {
            live.training_done();
        }
        let cost = trained.inspect_err(|error| self.tell_what_is_kept(error))?;
        self.save(run::FINAL)?;
        self.thin_out();
        if let Some(code) = self.signals.exit_code() {
            return Err(self.interrupted(code).into());
        }
        let mut words = Vec::new();
        self.device.guarded(|| {
            self.write_gaussians(cost.steps)?;
            self.evaluate(cost, sha256(written.as_bytes()), &mut words)
        })?;
        let finished = self.record.clone().finished();
        atomic::write_json(&self.folder.place(&[run::RECORD])?, &finished)?;
        self.folder.finish();
        // Last, because the report is built from all other files.
        let report = report::write(self.folder.path())?;
        self.verbosity.wrote("report", &report);
        // Files first: whoever reads stdout may have left.
        out.write_all(&words)?;
        Ok(writeln!(out, "{:16}{}", "report", report.display())?)
    }

    /// All remaining steps of all stages.
    fn train(&mut self) -> anyhow::Result<TrainCost> {
        let total = self.trainer.config().train.stages.total();
        let mut checkpoints = CheckpointClock::new(&self.config.scaled().train, self.trainer.state().completed);
        let mut watch = Watch::new(self, total);
        while let Some(position) = self.trainer.position() {
            let step = self.device.guarded(|| Ok(self.trainer.step()?));
            let Some(loss) = step? else { break };
            // From the first step on there is something to lose.
            self.folder.keep();
            let done = self.trainer.state().completed;
            if self.trainer.log_due(&position) {
                let line = watch.log_step(&self.trainer, &mut self.log, self.events.as_ref(), &position, &loss)?;
                if let Some(live) = &mut self.live {
                    live.log(&line);
                }
                self.tell_observer(&line, &mut watch);
            }
            watch.progress.advance();
            if done == total {
                break;
            }
            self.serve_viewer(&mut watch);
            if let Some(code) = self.signals.exit_code() {
                self.save(&run::step_file(done))?;
                self.thin_out();
                watch.progress.finish();
                return Err(self.interrupted(code).into());
            }
            if checkpoints.is_due(done) {
                self.save(&run::step_file(done))?;
                checkpoints.saved();
                self.thin_out();
            }
        }
        watch.progress.finish();
        let state = self.trainer.state();
        Ok(TrainCost {
            seconds: watch.elapsed(),
            steps: state.completed,
            skipped: state.bad_steps.total,
            peak_memory: memory::peak(),
        })
    }

    fn tell_observer(&mut self, line: &MetricsLine, watch: &mut Watch) {
        let Some(observer) = &mut self.observer else { return };
        let started = Instant::now();
        if observer(line).is_break() {
            self.signals.raise();
        }
        watch.exclude(started.elapsed());
    }

    /// Removes old checkpoints. One that stays is no reason to stop.
    pub(super) fn thin_out(&self) {
        let config = &self.config.train;
        // By time, the checkpoint after the first step is of no use beside any other.
        let least = if config.checkpoint_interval.0 == 0 { 2 } else { 0 };
        if let Err(error) = run::thin_out(self.folder.path(), config.keep_checkpoints, least) {
            warn!("{error:#}");
        }
    }

    /// The error of a run that was interrupted and saved.
    pub(super) fn interrupted(&self, code: u8) -> Interrupted {
        let total = self.trainer.config().train.stages.total();
        Interrupted { code, done: self.trainer.state().completed, total, run: self.folder.path().to_owned() }
    }

    /// Writes the state. What fails is tried again: a disk may be full for a moment.
    pub(super) fn save(&self, name: &str) -> anyhow::Result<()> {
        let path = self.folder.place(&[run::CHECKPOINTS, name])?;
        let started = Instant::now();
        let mut attempt = 1;
        while let Err(error) = self.device.guarded(|| Ok(self.trainer.state().save(&path)?)) {
            if attempt == SAVE_ATTEMPTS {
                return Err(error);
            }
            warn!("{error:#}; attempt {attempt} of {SAVE_ATTEMPTS}");
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
}
