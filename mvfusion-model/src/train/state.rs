//! The state of a run between two steps.

use burn::tensor::{DType, Device};
use glam::DVec3;
use mvfusion_data::{GaussianCloud, Scene};
use mvfusion_render::grid::GridBounds;

use crate::ModelError;
use crate::config::{Branches, Config, GridBoundsRule};
use crate::initial::{InitialClouds, Masking, MotionPoints, gaussians_of};
use crate::model::Model;
use crate::model::exposure::Exposures;
use crate::model::motion::{MotionRefinement, Normalisers, Substitutes};
use crate::model::network::{DeformationConfig, ModuleInit};
use crate::random::Streams;
use crate::train::densify::{Branch, BranchState, DensifyCounts};
use crate::train::optim::ModuleOptimiser;

use super::{BadSteps, Sampler};

/// The state of a run. Everything else can be recomputed from configuration and scene.
#[derive(Clone, Debug)]
pub struct TrainState {
    /// Number of completed steps.
    pub completed: usize,
    /// The model.
    pub model: Model,
    /// Training state of the dynamic branch.
    pub dynamic: BranchState,
    /// Training state of the static branch, if there is one.
    pub static_: Option<BranchState>,
    /// Adam moments of network, refinement and exposures.
    pub optimiser: ModuleOptimiser,
    /// Normalisers of the motion descriptors.
    pub normalisers: Normalisers,
    /// Random streams.
    pub streams: Streams,
    /// Views not yet shown in this round.
    pub sampler: Sampler,
    /// Number of refreshes of the motion statistics.
    pub refreshes: usize,
    /// Steps that were skipped because a number was not finite.
    pub bad_steps: BadSteps,
}

impl TrainState {
    /// The state before the first step, with the detected `motion`. Parameters are created on `device`, with autodiff.
    ///
    /// # Errors
    /// If a branch would have no Gaussians, or a configured file of Gaussians cannot be used.
    pub fn new(
        config: &Config,
        scene: &Scene,
        motion: Option<&MotionPoints>,
        device: &Device,
    ) -> Result<Self, ModelError> {
        let device = &device.clone().autodiff();
        let mut streams = Streams::new(config.seed);
        let clouds = InitialClouds::draw(scene, motion, config, &mut streams.clouds)?;
        if clouds.static_.as_ref().is_some_and(GaussianCloud::is_empty) {
            return Err(ModelError::Config {
                key: "init.static_points".to_owned(),
                value: config.init.static_points.to_string(),
                reason:
                    "the scene has no points, and the static branch needs at least one Gaussian to start from; give \
                         a number above 0"
                        .to_owned(),
            });
        }
        let of_motion = motion.filter(|_| config.model.grid.bounds == GridBoundsRule::Motion);
        let bounds = of_motion.and_then(MotionPoints::bounds).or_else(|| grid_bounds(&clouds.dynamic)).ok_or(
            ModelError::Config {
                key: "init.dynamic_points".to_owned(),
                value: config.init.dynamic_points.to_string(),
                reason: "the dynamic branch needs at least one Gaussian to start from; give a number above 0"
                    .to_owned(),
            },
        )?;
        let dtype = DType::F32;
        let masking = match config.model.branches {
            Branches::Both => Masking::Blended { dynamic_logit: config.init.dynamic_logit },
            Branches::Dynamic => Masking::Absent,
        };
        let highest = config.model.sh_degree;
        let dynamic = gaussians_of(&clouds.dynamic, masking, highest, device, dtype);
        let static_ = clouds.static_.as_ref().map(|seeds| gaussians_of(seeds, Masking::Absent, highest, device, dtype));

        let mut init = ModuleInit { device, dtype, stream: &mut streams.weights };
        let deformation = DeformationConfig::of(&config.model, bounds);
        let network = deformation.init(&mut init);
        let refinement = MotionRefinement::new(&deformation, &config.motion, &mut init);
        let exposures = config.model.exposure.then(|| Exposures::new(camera_count(scene), device, dtype));
        Ok(Self {
            completed: 0,
            dynamic: BranchState::new(&dynamic),
            static_: static_.as_ref().map(BranchState::new),
            model: Model {
                dynamic,
                static_,
                network,
                refinement,
                exposures,
                motion: None,
                substitutes: Substitutes::default(),
            },
            optimiser: ModuleOptimiser::default(),
            normalisers: Normalisers::default(),
            streams,
            sampler: Sampler::default(),
            refreshes: 0,
            bad_steps: BadSteps::default(),
        })
    }

    /// The state before the first step of a run that begins with the weights of another one, read for the same
    /// `config`. It keeps the model with its SH degrees, motion statistics and their normalisers. Moments, counts and
    /// random streams begin anew, as do exposures if `scene` has another number of cameras.
    pub fn with_weights(other: Self, config: &Config, scene: &Scene) -> Self {
        let Self { mut model, normalisers, .. } = other;
        if let Some(exposures) = &mut model.exposures {
            let departures = exposures.departures.val();
            let cameras = camera_count(scene);
            if departures.dims()[0] != cameras {
                *exposures = Exposures::new(cameras, &departures.device(), departures.dtype());
            }
        }
        Self {
            completed: 0,
            dynamic: BranchState::new(&model.dynamic),
            static_: model.static_.as_ref().map(BranchState::new),
            model,
            optimiser: ModuleOptimiser::default(),
            normalisers,
            streams: Streams::new(config.seed),
            sampler: Sampler::default(),
            refreshes: 0,
            bad_steps: BadSteps::default(),
        }
    }

    /// Rejects a state that refers to views or cameras that the scene does not have.
    pub(super) fn check_scene(&self, scene: &Scene) -> Result<(), ModelError> {
        let views = scene.train.len();
        if let Some(view) = self.sampler.last().filter(|&view| view >= views) {
            let reason = format!("it has {views} training views, the state view {view}");
            return Err(ModelError::OtherScene { reason });
        }
        let Some(exposures) = &self.model.exposures else { return Ok(()) };
        match (exposures.departures.dims()[0], camera_count(scene)) {
            (of_state, of_scene) if of_state == of_scene => Ok(()),
            (of_state, of_scene) => {
                let reason = format!("it has {of_scene} training cameras, the state the exposures of {of_state}");
                Err(ModelError::OtherScene { reason })
            }
        }
    }

    /// Resets moments and statistics, as at the start of a stage.
    pub(super) fn restart(&mut self) {
        self.dynamic.restart(&self.model.dynamic);
        if let (Some(state), Some(gaussians)) = (&mut self.static_, &self.model.static_) {
            state.restart(gaussians);
        }
        self.optimiser = ModuleOptimiser::default();
    }

    /// The dynamic branch, for changes of its rows between two steps.
    pub fn dynamic_branch(&mut self) -> Branch<'_> {
        let Model { dynamic, motion, .. } = &mut self.model;
        Branch { gaussians: dynamic, state: &mut self.dynamic, motion: motion.as_mut(), gradients: None }
    }

    /// The static branch, if there is one.
    pub fn static_branch(&mut self) -> Option<Branch<'_>> {
        let (gaussians, state) = (self.model.static_.as_mut()?, self.static_.as_mut()?);
        Some(Branch { gaussians, state, motion: None, gradients: None })
    }

    /// Warns if a branch has more Gaussians than the configuration allows, as runs of earlier versions may. None are
    /// added to it.
    pub(super) fn warn_of_excess(&self, config: &Config) {
        let most = [&config.densify.dynamic, &config.densify.static_].map(|limits| limits.max_gaussians);
        for ((name, gaussians), most) in self.model.branches().zip(most) {
            let count = gaussians.count();
            if count > most {
                tracing::warn!(
                    "the {name} branch has {count} Gaussians, more than `densify.{name}.max_gaussians` = {most}; none \
                     are added"
                );
            }
        }
    }

    /// The counts of row changes, first of the dynamic branch.
    pub fn counts(&self) -> [DensifyCounts; 2] {
        [self.dynamic.counts, self.static_.as_ref().map_or_else(DensifyCounts::default, |state| state.counts)]
    }
}

/// Number of training cameras.
fn camera_count(scene: &Scene) -> usize {
    scene.training_cameras().into_iter().max().map_or(0, |last| last + 1)
}

/// The box of the dynamic cloud, without margin (METHOD §2.1); `None` for an empty one.
fn grid_bounds(cloud: &GaussianCloud) -> Option<GridBounds> {
    /// Minimum side of the box. The grid coordinates of a flat cloud would be infinite.
    const MIN_SIDE: f64 = 1e-6;
    let (min, max) = cloud.bounds()?;
    let min = min.as_dvec3();
    let max = max.as_dvec3().max(min + DVec3::splat(MIN_SIDE));
    Some(GridBounds { min: min.to_array(), max: max.to_array() })
}
