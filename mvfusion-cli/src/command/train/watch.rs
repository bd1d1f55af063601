//! Observers of a training: when a checkpoint is due, progress and pace.

use std::time::{Duration, Instant};

use mvfusion_model::ModelError;
use mvfusion_model::config::TrainConfig;
use mvfusion_model::evaluation::decibels;
use mvfusion_model::train::{Losses, Position, Trainer};
use serde::Serialize;

use super::session::Session;
use crate::progress::{Pace, Progress};
use crate::run::{GaussianCounts, MetricsLine, MetricsLog, milliseconds};
use crate::tensorboard::{self, EventFile};

/// When the next checkpoint is due.
pub(super) struct CheckpointClock {
    /// Steps between checkpoints; 0 goes by the time.
    every: usize,
    /// Time between checkpoints; none if `None`.
    pause: Option<Duration>,
    /// When the last one was written; `None` before the first.
    last: Option<Instant>,
}

impl CheckpointClock {
    /// A clock for a training that begins after `done` steps.
    pub(super) fn new(config: &TrainConfig, done: usize) -> Self {
        let pause = (config.checkpoint_minutes > 0.0).then_some(60.0 * config.checkpoint_minutes);
        // More than centuries of minutes is never.
        let pause = pause.and_then(|seconds| Duration::try_from_secs_f64(seconds).ok());
        Self { every: config.checkpoint_interval.0, pause, last: (done > 0).then(Instant::now) }
    }

    pub(super) fn is_due(&self, done: usize) -> bool {
        match self.every {
            // The first step has one, too: a disk that has no room for it is best known at once.
            0 => self.pause.is_some_and(|pause| self.last.is_none_or(|last| last.elapsed() >= pause)),
            every => done.is_multiple_of(every),
        }
    }

    pub(super) fn saved(&mut self) {
        self.last = Some(Instant::now());
    }
}

/// What a log step tells beside its number, for `--progress json`.
#[derive(Serialize)]
struct Numbers {
    stage: &'static str,
    loss: f32,
    #[serde(skip_serializing_if = "Option::is_none")]
    psnr: Option<f64>,
    gaussians: GaussianCounts,
}

impl Numbers {
    fn of(line: &MetricsLine) -> Self {
        let MetricsLine { stage, loss, psnr, gaussians, .. } = *line;
        Self { stage, loss, psnr, gaussians }
    }
}

/// Observers of a training: progress and pace.
pub(super) struct Watch {
    pub(super) progress: Progress,
    pace: Pace,
    /// Seconds of training before this process.
    before: f64,
    /// Steps done at the last line.
    logged: usize,
    total: usize,
}

impl Watch {
    pub(super) fn new(session: &Session, total: usize) -> Self {
        let done = session.trainer.state().completed;
        let progress = Progress::new("training", total, session.verbosity).after(done);
        let mut pace = Pace::default();
        pace.mark(done);
        Self { progress, pace, before: session.elapsed, logged: done, total }
    }

    /// Seconds of training in all processes.
    pub(super) fn elapsed(&self) -> f64 {
        self.before + self.pace.elapsed()
    }

    /// Leaves out some time that was not spent on training.
    pub(super) fn exclude(&mut self, time: Duration) {
        self.pace.exclude(time);
    }

    /// Reads the losses of a step, which waits for the device, and logs them.
    pub(super) fn log_step(
        &mut self,
        trainer: &Trainer,
        log: &mut MetricsLog,
        events: Option<&EventFile>,
        position: &Position,
        loss: &Losses,
    ) -> anyhow::Result<MetricsLine> {
        let (loss, squared_error) = read(loss)?;
        let state = trainer.state();
        let done = state.completed;
        self.pace.mark(done);
        let line = MetricsLine {
            step: done,
            stage: position.stage.name(),
            stage_step: position.stage_step,
            loss,
            psnr: decibels(f64::from(squared_error)),
            gaussians: GaussianCounts::of(&state.model),
            skipped: state.bad_steps.total,
            steps_per_second: self.pace.steps_per_second(),
            elapsed: self.elapsed(),
            ms: milliseconds(done - self.logged),
        };
        self.logged = done;
        log.add(&line)?;
        if let Some(events) = events {
            events.add(done, tensorboard::of_step(&line, &trainer.rates(position)))?;
        }
        self.progress.say(self.sentence(&line));
        self.progress.record(&Numbers::of(&line), line.steps_per_second);
        Ok(line)
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
