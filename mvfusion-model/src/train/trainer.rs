//! The trainer, for every device.

use burn::tensor::Device;
use mvfusion_data::inspect::{Problem, obstacle};
use mvfusion_data::motion::MotionFinder;
use mvfusion_data::{Capture, Scene};
use mvfusion_render::splat::SplatRules;

use super::{Losses, Position, Stage, TrainState, TrainingViews, Visits};
use crate::ModelError;
use crate::config::Config;
use crate::initial::{Placement, SceneMotion, Seeding};
use crate::model::gaussians::BackgroundLevels;
use crate::model::{DeformationLevel, RenderContext};
use crate::timeline::Timeline;
use crate::train::loss::Windows;

/// Default budget of decoded images, in bytes: 4 GiB.
pub const IMAGE_CACHE: u64 = 4 << 30;

/// Number of images to decode ahead, beyond those of the current step.
const LOOK_AHEAD: usize = 32;

/// Trains a model on a scene, step by step.
#[derive(Debug)]
pub struct Trainer {
    pub(super) config: Config,
    pub(super) context: RenderContext,
    pub(super) photos: TrainingViews,
    /// Visits of each view per round.
    visits: Visits,
    pub(super) windows: Windows,
    pub(super) device: Device,
    pub(super) state: TrainState,
    /// Whether Gaussians are born for objects in single photos.
    pub(super) has_births: bool,
    /// Whether the scene is a video.
    pub(super) is_video: bool,
    /// Finds positions for births in videos with fixed cameras.
    pub(super) finder: Option<MotionFinder>,
    /// The result of the search for points on moving objects, if this trainer searched.
    seeding: Option<Seeding>,
    /// The views that were drawn last, for messages.
    pub(super) shown: Vec<usize>,
}

impl Trainer {
    /// A trainer before its first step. `config` is the result of [`Config::scaled`]. [`Config::for_times_of`] is
    /// applied here if necessary; [`Trainer::config`] returns the result.
    ///
    /// # Errors
    /// If the configuration is invalid or not scaled, [`Scene::check`] rejects the scene, it has too few training
    /// cameras or all of them at one place, or it or a file cannot be read.
    pub fn new(config: Config, scene: &Scene, device: &Device) -> Result<Self, ModelError> {
        config.check()?;
        check_start(&config, scene)?;
        let config = config.for_times_of(scene);
        let device = device.clone().autodiff();
        let motion = SceneMotion::find(scene, &config)?;
        let state = TrainState::new(&config, scene, motion.points.as_ref(), &device)?;
        Ok(Self::assembled(config, scene, motion, &device, state))
    }

    /// A trainer that continues from a state, with the configuration that [`Trainer::config`] returned.
    ///
    /// # Errors
    /// Those of [`Trainer::new`], and if the state belongs to a scene with other cameras, or to one with so many views
    /// that this one lacks some of the current round.
    pub fn with_state(config: Config, scene: &Scene, device: &Device, state: TrainState) -> Result<Self, ModelError> {
        state.check_scene(scene)?;
        config.check_of_run()?;
        check_start(&config, scene)?;
        state.warn_of_excess(&config);
        let motion = SceneMotion::of_training(scene, &config)?;
        Ok(Self::assembled(config, scene, motion, device, state))
    }

    fn assembled(config: Config, scene: &Scene, motion: SceneMotion, device: &Device, state: TrainState) -> Self {
        let context = RenderContext::new(&config, scene);
        let photos = TrainingViews::new(scene, IMAGE_CACHE).with_motion(motion.moving);
        let visits = photos.visits(&context.timeline, config.train.lonely_visits);
        let (windows, finder, seeding) = (Windows::default(), motion.finder, motion.seeding);
        let (has_births, is_video) = (config.has_births(scene), scene.capture == Capture::Video);
        if !(has_births || is_video)
            && config.init.photo_points > 0
            && config.init.dynamic_ply.is_none()
            && config.model.lifetime
        {
            tracing::warn!(
                "`init.photo_points` has no effect: {} training photos have {} distinct times, and births need photos with \
                 times of their own and a first stage",
                scene.train.len(),
                scene.training_times().len()
            );
        }
        let (device, shown) = (device.clone(), Vec::new());
        Self { config, context, photos, visits, windows, device, state, has_births, is_video, finder, seeding, shown }
    }

    /// Keeps at most `budget` bytes of decoded images instead of [`IMAGE_CACHE`]. If all images fit, they are decoded
    /// now.
    ///
    /// # Errors
    /// If one of them cannot be read.
    pub fn with_image_cache(self, budget: u64) -> Result<Self, ModelError> {
        self.photos.pictures().set_budget(budget);
        self.photos.pictures().fill()?;
        Ok(self)
    }

    /// The next step, or `None` at the end of training.
    pub fn position(&self) -> Option<Position> {
        Position::after(self.state.completed, &self.config.train.stages)
    }

    /// Performs the next step. Returns its losses without autodiff, or `None` at the end of training. With
    /// `train.on_bad_step = "skip"`, the losses of a skipped step are returned as they are.
    ///
    /// # Errors
    /// If the device fails, an op rejects its input, or a number is not finite.
    pub fn step(&mut self) -> Result<Option<Losses>, ModelError> {
        let Some(position) = self.begin_step()? else { return Ok(None) };
        let views = self.draw_views();
        let rendered = self.render_batch(&views, &position)?;
        let losses = self.losses(&rendered, &position)?;
        let found = losses.detached();
        let rates = self.rates(&position);
        self.learn(rendered, losses, &rates, &position)?;
        self.finish_step(&position)?;
        Ok(Some(found))
    }

    /// Completes a step: checks parameters, performs births and measures motion when due, and counts the step.
    ///
    /// # Errors
    /// If a parameter is not finite, a photo cannot be read, or the device fails.
    pub fn finish_step(&mut self, position: &Position) -> Result<(), ModelError> {
        if self.log_due(position) {
            self.check_parameters(position)?;
        }
        if self.photo_births_due(position) {
            self.give_birth_in_photos()?;
        }
        if self.refresh_due(position) {
            self.refresh_motion()?;
            if position.step < self.config.densify.until.0 {
                self.sort_out_still_ones(position)?;
            }
        }
        if self.film_births_due(position) {
            self.give_birth_in_film(position)?;
        }
        self.state.completed += 1;
        Ok(())
    }

    /// Announces the training views of this step, which your program chose instead of [`Trainer::draw_views`]. They
    /// are named in messages, and counted: rules of densification wait until every view was shown as often as a round
    /// has it (METHOD §4.10). A view that is never shown lets them wait for ever.
    ///
    /// # Errors
    /// [`ModelError::Views`] if there is none, or the scene does not have one of them.
    pub fn show_views(&mut self, views: &[usize]) -> Result<(), ModelError> {
        self.photos.check(views)?;
        self.photos.pictures().announce(views);
        let TrainState { sampler, streams, .. } = &mut self.state;
        sampler.strike(views, &self.visits, &mut streams.sampling);
        self.shown = views.to_vec();
        Ok(())
    }

    /// Draws the training views of the next step. Meanwhile, the views after them are decoded.
    pub fn draw_views(&mut self) -> Vec<usize> {
        let (size, visits) = (self.config.train.batch_size, &self.visits);
        let TrainState { sampler, streams, .. } = &mut self.state;
        self.photos.pictures().announce(&sampler.upcoming(size + LOOK_AHEAD, visits, &streams.sampling));
        self.shown = sampler.draw(size, visits, &mut streams.sampling);
        self.shown.clone()
    }

    /// Starts the next step. Call it once per step: a stage may start, and SH degrees may increase. Returns `None` at
    /// the end of training.
    ///
    /// # Errors
    /// If the device fails.
    pub fn begin_step(&mut self) -> Result<Option<Position>, ModelError> {
        let Some(position) = self.position() else { return Ok(None) };
        if position.restarts() {
            self.state.restart();
        }
        let refined = position.stage.level(self.config.model.deformation) == DeformationLevel::Refined;
        if refined && self.state.model.motion.is_none() {
            self.refresh_motion()?;
        }
        let highest = self.config.model.sh_degree;
        let model = &mut self.state.model;
        let intervals = (self.config.train.dynamic_sh_interval, self.config.train.static_sh_interval);
        let dynamic = std::iter::once((&mut model.dynamic, intervals.0));
        for (branch, interval) in dynamic.chain(model.static_.iter_mut().map(|branch| (branch, intervals.1))) {
            if interval.is_due(position.step) && branch.sh_degree < highest {
                branch.sh_degree += 1;
            }
        }
        Ok(Some(position))
    }

    /// Whether the step is logged.
    pub fn log_due(&self, position: &Position) -> bool {
        position.run_step.is_multiple_of(self.config.train.log_interval)
            || position.run_step == self.config.train.stages.total()
    }

    /// Whether the motion statistics are measured after this step: at the end of the deformation stage, then every `E`
    /// steps of the last stage (A2).
    fn refresh_due(&self, position: &Position) -> bool {
        self.config.model.deformation
            && match position.stage {
                Stage::Geometry => false,
                Stage::Deformation => position.ends_stage() && self.config.train.stages.refinement.0 > 0,
                Stage::Refinement => self.config.motion.interval.is_due(position.stage_step) && !position.ends_stage(),
            }
    }

    /// The deformation level of the finished model: that of the last stage.
    pub fn final_level(&self) -> DeformationLevel {
        let stages = &self.config.train.stages;
        Stage::of_last(stages.total(), stages).level(self.config.model.deformation)
    }

    /// The configuration of the state, which loading a checkpoint requires.
    pub fn config(&self) -> &Config {
        &self.config
    }

    /// The result of the search for points on moving objects. `None` without `init.motion_points`, and for a trainer
    /// that continues a run.
    pub fn seeding(&self) -> Option<&Seeding> {
        self.seeding.as_ref()
    }

    /// The placement of the dynamic Gaussians in the images, before deformation. `None` if no motion is known, and for
    /// a model with one branch, whose Gaussians show the whole scene. Reads some images.
    ///
    /// # Errors
    /// If an image cannot be read, or the device fails.
    pub fn placement(&self, scene: &Scene) -> Result<Option<Placement>, ModelError> {
        match self.state.model.static_ {
            Some(_) => Placement::of(&self.state.model.dynamic, scene),
            None => Ok(None),
        }
    }

    /// The state.
    pub fn state(&self) -> &TrainState {
        &self.state
    }

    /// The data of scene and run that the model needs for rendering.
    pub fn render_context(&self) -> &RenderContext {
        &self.context
    }
}

/// Rejects what cannot be trained, of a valid configuration.
fn check_start(config: &Config, scene: &Scene) -> Result<(), ModelError> {
    config.check_scaled()?;
    let refusal = |what, remedy| Err(ModelError::Scene { name: scene.name.clone(), what, remedy });
    if let Some(Problem { what, remedy, .. }) = obstacle(scene) {
        return refusal(what, remedy);
    }
    scene.check()?;
    if scene.extent() > 0.0 {
        return Ok(());
    }
    // Losses divide by the extent, and rates are in units of it.
    refusal(
        "all training cameras are at one place, so no distance is known".to_owned(),
        "Train on pictures from several places.".to_owned(),
    )
}

impl RenderContext {
    /// The render context of a model trained with `config` on `scene`.
    pub fn new(config: &Config, scene: &Scene) -> Self {
        Self {
            timeline: Timeline::new(scene.training_times()),
            extent: scene.extent(),
            motion: config.motion.clone(),
            mask_gradient: config.densify.mask_gradient,
            background: BackgroundLevels {
                grey: config.model.background.level(),
                masks: config.model.uncovered.masks(),
            },
            near: SplatRules::inria().near.max(config.model.near_share * scene.near.unwrap_or(0.0)),
        }
    }
}

#[cfg(all(test, feature = "flex"))]
mod tests {
    use mvfusion_data::BuiltinOptions;
    use mvfusion_data::builtin::builtin;

    use super::*;
    use crate::device;

    /// What a trainer says that is not created.
    fn refusal(config: Config, scene: &Scene) -> String {
        Trainer::new(config, scene, &device::flex()).expect_err("it is refused").to_string()
    }

    #[test]
    fn a_scale_that_is_not_applied_and_cameras_at_one_place_are_refused() {
        let mut scene = builtin(&BuiltinOptions { width: 16, height: 12, frames: 2, ..BuiltinOptions::default() });
        let mut config = Config::default();
        config.train.scale = 0.5;
        let said = refusal(config.clone(), &scene);
        assert!(said.starts_with("`train.scale` is 0.5:") && said.contains("`Config::scaled`"), "{said}");
        // Cameras that only turn.
        scene.train.iter_mut().for_each(|view| view.camera.translation = glam::DVec3::ZERO);
        let said = refusal(config.scaled(), &scene);
        assert!(said.contains("at one place"), "{said}");
    }
}
