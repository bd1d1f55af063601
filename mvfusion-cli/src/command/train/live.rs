//! The viewer of a training: pictures and commands between two steps.

use std::time::{Duration, Instant};

use mvfusion_model::model::DeformationLevel;
use mvfusion_model::profile;
use mvfusion_model::train::Trainer;

use super::session::Session;
use super::watch::Watch;
use crate::args::TrainArgs;
use crate::run::{self, MetricsLine};
use crate::viewer::Viewer;
use crate::viewer::address::BoundSocket;
use crate::viewer::budget::Budget;
use crate::viewer::facts::RunFacts;
use crate::viewer::renderer::{FrameRenderer, MotionSource, Shown, unavailable_layers};
use crate::viewer::status::{Activity, Status};

/// Time from one look at signals and commands to the next, during a pause.
const TIMEOUT: Duration = Duration::from_millis(100);
/// Time between two states with nothing new but the step.
const STATUS_INTERVAL: Duration = Duration::from_millis(250);

/// A socket that listens, if `--view` is given.
pub(super) type ViewerSocket = Option<BoundSocket>;

/// Listens if `--view` is given. Done first, because it is quick to fail.
///
/// # Errors
/// If the port is taken.
pub(super) fn bind_viewer(args: &TrainArgs) -> anyhow::Result<ViewerSocket> {
    args.viewer.view.map(|port| BoundSocket::bind(&args.viewer.host, port)).transpose()
}

/// The viewer of a training.
pub(super) struct Live {
    viewer: Viewer,
    renderer: FrameRenderer,
    budget: Budget,
    /// When the step was last sent to the pages.
    last_sent: Instant,
    /// When the last step ended.
    ended: Instant,
}

impl Live {
    /// Starts to serve, if `--view` is given.
    ///
    /// # Errors
    /// If the system refuses a thread.
    pub(super) fn start(socket: ViewerSocket, session: &Session) -> anyhow::Result<Option<Self>> {
        let Some(socket) = socket else { return Ok(None) };
        let lines = socket.lines(true);
        let Session { trainer, scene, folder, verbosity, .. } = session;
        let renderer = FrameRenderer::new(trainer.render_context().clone(), scene.clone(), MotionSource::Training);
        let facts = facts(trainer, folder.path());
        let viewer = Viewer::start(socket, scene, &facts, status(trainer))?;
        // With `--quiet`, too: the token is written nowhere else.
        lines.iter().for_each(|(name, line)| verbosity.say(&format!("{:7} {line}", format!("{name}:"))));
        let now = Instant::now();
        Ok(Some(Self { viewer, renderer, budget: Budget::default(), last_sent: now, ended: now }))
    }

    /// Adds a log step to the curves.
    pub(super) fn log(&mut self, line: &MetricsLine) {
        let loss = if line.loss.is_finite() { line.loss } else { f32::MAX };
        self.viewer.status.add((line.step, loss, line.psnr));
        self.viewer.status.change(|status| {
            (status.step, status.stage) = (line.step, Some(line.stage));
            status.steps_per_second = Some(line.steps_per_second);
        });
    }

    /// The training is done.
    pub(super) fn training_done(&self) {
        self.viewer.status.change(|status| status.activity = Activity::Scores);
    }

    /// Renders what the account of time allows.
    fn serve(&mut self, trainer: &Trainer) {
        self.budget.earn(self.ended.elapsed());
        if self.viewer.requests.pages() > 0 && self.last_sent.elapsed() >= STATUS_INTERVAL {
            self.send_status(trainer);
        }
        while self.budget.allows() && self.viewer.requests.is_asked() {
            let started = Instant::now();
            self.render(trainer, Duration::ZERO);
            self.budget.spend(started.elapsed());
        }
        self.renderer.forget();
    }

    fn render(&mut self, trainer: &Trainer, timeout: Duration) {
        let (viewer, renderer) = (&self.viewer, &mut self.renderer);
        renderer.show(trainer.state().completed, || shown(trainer));
        // Its time belongs to no part of a step.
        profile::uncounted(|| viewer.serve_next(renderer, timeout));
    }

    /// Sends the step, and which layers there are.
    fn send_status(&mut self, trainer: &Trainer) {
        self.last_sent = Instant::now();
        let new = status(trainer);
        self.viewer.status.change(|status| {
            let (stage, steps_per_second, saved) = (new.stage.or(status.stage), status.steps_per_second, &status.saved);
            *status = Status { stage, steps_per_second, saved: saved.clone(), activity: status.activity, ..new };
        });
    }
}

impl Session {
    /// Serves the viewer between two steps: pictures within its account of time, commands at once. Stays here during a
    /// pause, until it is over or a signal comes.
    pub(super) fn serve_viewer(&mut self, watch: &mut Watch) {
        let Some(mut live) = self.live.take() else { return };
        live.serve(&self.trainer);
        self.run_commands(&mut live, watch);
        live.ended = Instant::now();
        self.live = Some(live);
    }

    /// Tells the terminal of a pause: the page that asked for it may be gone, and the training waits all the same.
    fn note_pause(&self, watch: &Watch, is_paused: bool) {
        let step = self.trainer.state().completed;
        watch.progress.note(&match is_paused {
            true => format!("note:   a page pauses the training after step {step}. Go on there, or end it with Ctrl-C"),
            false => format!("note:   a page lets the training go on after step {step}"),
        });
    }

    fn run_commands(&self, live: &mut Live, watch: &mut Watch) {
        let started = Instant::now();
        let mut is_paused = false;
        loop {
            let commands = live.viewer.requests.take_commands();
            if let Some(pause) = commands.pause.filter(|&pause| pause != is_paused) {
                is_paused = pause;
                let activity = if pause { Activity::Pauses } else { Activity::Trains };
                live.send_status(&self.trainer);
                live.viewer.status.change(|status| {
                    // A training that stands still has no speed.
                    (status.activity, status.steps_per_second) = (activity, None);
                });
                self.note_pause(watch, pause);
            }
            if commands.checkpoint {
                let name = run::step_file(self.trainer.state().completed);
                match self.save(&name) {
                    Ok(()) => {
                        self.thin_out();
                        live.viewer.status.change(|status| status.saved = Some(name));
                    }
                    // What a page asks for must not end a training.
                    Err(error) => tracing::warn!("the checkpoint that a page asked for is not written: {error:#}"),
                }
            }
            if !is_paused || self.signals.exit_code().is_some() {
                break;
            }
            live.render(&self.trainer, TIMEOUT);
        }
        live.renderer.forget();
        if live.viewer.status.activity() == Activity::Pauses {
            live.viewer.status.change(|status| status.activity = Activity::Trains);
        }
        // Neither a pause nor a checkpoint that a page asks for is training.
        watch.exclude(started.elapsed());
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
        has_static: trainer.state().model.static_.is_some(),
        background: trainer.render_context().background.grey,
    }
}

fn status(trainer: &Trainer) -> Status {
    Status {
        activity: Activity::Trains,
        step: trainer.state().completed,
        total: trainer.config().train.stages.total(),
        stage: trainer.position().map(|position| position.stage.name()),
        steps_per_second: None,
        unavailable: unavailable_layers(&trainer.state().model, level(trainer), MotionSource::Training),
        saved: None,
    }
}
