//! The viewer of a training: pictures and orders between two steps.

use std::time::{Duration, Instant};

use mvfusion_model::model::DeformationLevel;
use mvfusion_model::profile;
use mvfusion_model::train::Trainer;

use super::session::Session;
use super::watch::Watch;
use crate::args::TrainArgs;
use crate::progress::print_line;
use crate::run::{self, MetricsLine};
use crate::viewer::Viewer;
use crate::viewer::address::Listening;
use crate::viewer::board::{Activity, Status};
use crate::viewer::budget::Budget;
use crate::viewer::facts::RunFacts;
use crate::viewer::painter::{MotionSource, Painter, Shown, lacking};

/// Time from one look at signals and orders to the next, during a pause.
const PATIENCE: Duration = Duration::from_millis(100);
/// Time between two words about the step.
const NEWS: Duration = Duration::from_millis(250);

/// A socket that listens, if `--view` is given.
pub(super) type Door = Option<Listening>;

/// Listens if `--view` is given. Done first, because it is quick to fail.
///
/// # Errors
/// If the port is taken.
pub(super) fn open_door(args: &TrainArgs) -> anyhow::Result<Door> {
    args.viewer.view.map(|port| Listening::at(&args.viewer.host, port)).transpose()
}

/// The viewer of a training.
pub(super) struct Live {
    viewer: Viewer,
    painter: Painter,
    budget: Budget,
    /// When the pages were last told the step.
    told: Instant,
    /// When the last step ended.
    ended: Instant,
}

impl Live {
    /// Starts to serve, if `--view` is given.
    ///
    /// # Errors
    /// If the system refuses a thread.
    pub(super) fn start(door: Door, session: &Session) -> anyhow::Result<Option<Self>> {
        let Some(listening) = door else { return Ok(None) };
        let lines = listening.lines();
        let Session { trainer, scene, folder, .. } = session;
        let painter = Painter::new(trainer.render_context().clone(), scene.clone(), MotionSource::Training);
        let facts = facts(trainer, folder.path());
        let viewer = Viewer::start(listening, scene, &facts, status(trainer))?;
        // With `--quiet`, too: the token is written nowhere else.
        lines.iter().for_each(|(name, line)| print_line(&format!("{:7} {line}", format!("{name}:"))));
        let now = Instant::now();
        Ok(Some(Self { viewer, painter, budget: Budget::default(), told: now, ended: now }))
    }

    /// Adds a log step to the curves.
    pub(super) fn log(&mut self, line: &MetricsLine) {
        let loss = if line.loss.is_finite() { line.loss } else { f32::MAX };
        self.viewer.board.add((line.step, loss, line.psnr));
        self.viewer.board.change(|status| {
            (status.step, status.stage) = (line.step, Some(line.stage));
            status.steps_per_second = Some(line.steps_per_second);
        });
    }

    /// The training is done.
    pub(super) fn score(&self) {
        self.viewer.board.change(|status| status.activity = Activity::Scores);
    }

    /// Renders what the account of time allows.
    fn serve(&mut self, trainer: &Trainer) {
        self.budget.earn(self.ended.elapsed());
        if self.viewer.desk.pages() > 0 && self.told.elapsed() >= NEWS {
            self.tell(trainer);
        }
        while self.budget.allows() && self.viewer.desk.is_asked() {
            let started = Instant::now();
            self.paint(trainer, Duration::ZERO);
            self.budget.spend(started.elapsed());
        }
        self.painter.forget();
    }

    fn paint(&mut self, trainer: &Trainer, patience: Duration) {
        let (viewer, painter) = (&self.viewer, &mut self.painter);
        painter.show(trainer.state().completed, || shown(trainer));
        // Its time belongs to no part of a step.
        profile::uncounted(|| viewer.serve_next(painter, patience));
    }

    /// Tells the pages the step, and which layers there are.
    fn tell(&mut self, trainer: &Trainer) {
        self.told = Instant::now();
        let new = status(trainer);
        self.viewer.board.change(|status| {
            let (stage, steps_per_second, saved) = (new.stage.or(status.stage), status.steps_per_second, &status.saved);
            *status = Status { stage, steps_per_second, saved: saved.clone(), activity: status.activity, ..new };
        });
    }
}

impl Session {
    /// Serves the viewer between two steps: pictures within its account of time, orders at once. Stays here during a
    /// pause, until it is over or a signal comes.
    ///
    /// # Errors
    /// If an ordered checkpoint cannot be written.
    pub(super) fn serve_viewer(&mut self, watch: &mut Watch) -> anyhow::Result<()> {
        let Some(mut live) = self.live.take() else { return Ok(()) };
        live.serve(&self.trainer);
        let served = self.obey(&mut live, watch);
        live.ended = Instant::now();
        self.live = Some(live);
        served
    }

    /// Tells the terminal of a pause: the page that ordered it may be gone, and the training waits all the same.
    fn note_pause(&self, watch: &Watch, is_paused: bool) {
        let step = self.trainer.state().completed;
        watch.progress.note(&match is_paused {
            true => format!("note:   a page pauses the training after step {step}. Go on there, or end it with Ctrl-C"),
            false => format!("note:   a page lets the training go on after step {step}"),
        });
    }

    fn obey(&mut self, live: &mut Live, watch: &mut Watch) -> anyhow::Result<()> {
        let started = Instant::now();
        let mut is_paused = false;
        loop {
            let orders = live.viewer.desk.orders();
            if let Some(pause) = orders.pause.filter(|&pause| pause != is_paused) {
                is_paused = pause;
                let activity = if pause { Activity::Pauses } else { Activity::Trains };
                live.tell(&self.trainer);
                live.viewer.board.change(|status| {
                    // A training that stands still has no speed.
                    (status.activity, status.steps_per_second) = (activity, None);
                });
                self.note_pause(watch, pause);
            }
            if orders.checkpoint {
                let name = run::step_file(self.trainer.state().completed);
                match self.save(&name) {
                    Ok(()) => {
                        self.thin_out();
                        live.viewer.board.change(|status| status.saved = Some(name));
                    }
                    // What a page orders must not end a training.
                    Err(error) => tracing::warn!("the ordered checkpoint is not written: {error:#}"),
                }
            }
            if !is_paused || self.signals.exit_code().is_some() {
                break;
            }
            live.paint(&self.trainer, PATIENCE);
        }
        live.painter.forget();
        if live.viewer.board.activity() == Activity::Pauses {
            live.viewer.board.change(|status| status.activity = Activity::Trains);
        }
        // Neither a pause nor an ordered checkpoint is training.
        watch.exclude(started.elapsed());
        Ok(())
    }
}

/// What a page is shown: the model after the last step, at the level of the next one.
fn shown(trainer: &Trainer) -> Shown {
    Shown { model: trainer.state().model.plain(), level: level(trainer), step: trainer.state().completed }
}

/// The level of deformation of the next step.
fn level(trainer: &Trainer) -> DeformationLevel {
    let deformation = trainer.config().model.deformation;
    trainer.position().map_or(trainer.final_level(), |position| position.stage.level(deformation))
}

fn facts<'a>(trainer: &Trainer, run: &'a std::path::Path) -> RunFacts<'a> {
    RunFacts {
        run,
        is_training: true,
        has_mfta: trainer.state().model.refinement.temporal.is_some(),
        background: trainer.render_context().behind.grey,
    }
}

fn status(trainer: &Trainer) -> Status {
    Status {
        activity: Activity::Trains,
        step: trainer.state().completed,
        total: trainer.config().train.stages.total(),
        stage: trainer.position().map(|position| position.stage.name()),
        steps_per_second: None,
        lacking: lacking(&trainer.state().model, level(trainer), MotionSource::Training),
        saved: None,
    }
}
