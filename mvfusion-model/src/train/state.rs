//! All that a run has to remember between two steps.

use burn::tensor::{DType, Device};
use glam::DVec3;
use mvfusion_data::{GaussianCloud, Scene};
use mvfusion_render::grid::GridBounds;

use crate::ModelError;
use crate::config::{Branches, Config, GridBoundsRule};
use crate::densify::{Branch, Census};
use crate::exposure::Exposures;
use crate::initial::{InitialClouds, Masking, MotionPoints, gaussians_of};
use crate::model::Model;
use crate::motion::{MotionRefinement, Normalisers};
use crate::network::{DeformationConfig, LayerInit};
use crate::optim::ModuleOptimiser;
use crate::random::Streams;

use super::{Contribution, Sampler};

/// The state of a run: parameters, moments, statistics, motion cache, random streams, counters. What is not in here can
/// be computed anew from configuration and scene.
#[derive(Clone, Debug)]
pub struct TrainState {
    /// Steps done.
    pub completed: usize,
    /// Parameters, and the branches' moments and statistics.
    pub model: Model,
    /// Moments of network and refinement.
    pub optimiser: ModuleOptimiser,
    /// Normalisers of the motion descriptors.
    pub normalisers: Normalisers,
    /// Random streams.
    pub streams: Streams,
    /// Views not yet shown in this round.
    pub sampler: Sampler,
    /// What the static branch has yet to learn from, under gradient accumulation.
    pub pending: Option<Contribution>,
    /// How often rows changed, dynamic branch first.
    pub census: [Census; 2],
    /// Refreshes of the motion statistics.
    pub refreshes: usize,
}

impl TrainState {
    /// The state before the first step, where `motion` was seen. Parameters are made on `device`, which must record gradients.
    ///
    /// # Errors
    /// If the configuration leaves a branch without Gaussians, or names a file of Gaussians that cannot be used.
    pub fn new(
        config: &Config,
        scene: &Scene,
        motion: Option<&MotionPoints>,
        device: &Device,
    ) -> Result<Self, ModelError> {
        let mut streams = Streams::new(config.seed);
        let clouds = InitialClouds::draw(scene, motion, config, &mut streams.clouds)?;
        let of_motion = motion.filter(|_| config.model.grid.bounds == GridBoundsRule::Motion);
        let bounds = of_motion.and_then(MotionPoints::bounds).or_else(|| grid_bounds(&clouds.dynamic)).ok_or(
            ModelError::Config {
                key: "init.dynamic_points",
                value: config.init.dynamic_points.to_string(),
                reason: "the dynamic branch needs at least one Gaussian to start from; give a number above 0",
            },
        )?;
        let dtype = DType::F32;
        let masking = match config.model.branches {
            Branches::Both => Masking::Blended { dynamic_logit: config.init.dynamic_logit },
            Branches::Dynamic => Masking::Absent,
        };
        let dynamic = first_branch(&clouds.dynamic, masking, config, device, dtype);
        let static_ = clouds.static_.as_ref().map(|seeds| first_branch(seeds, Masking::Absent, config, device, dtype));

        let mut init = LayerInit { device, dtype, stream: &mut streams.weights };
        let deformation = DeformationConfig::of(&config.model, bounds);
        let network = deformation.init(&mut init);
        let refinement = MotionRefinement::new(&deformation, &config.motion, &mut init);
        let cameras = || scene.training_cameras().into_iter().max().map_or(0, |last| last + 1);
        let exposures = config.model.exposure.then(|| Exposures::new(cameras(), device, dtype));
        Ok(Self {
            completed: 0,
            model: Model { dynamic, static_, network, refinement, exposures, motion: None },
            optimiser: ModuleOptimiser::default(),
            normalisers: Normalisers::default(),
            streams,
            sampler: Sampler::default(),
            pending: None,
            census: [Census::default(); 2],
            refreshes: 0,
        })
    }
}

/// A branch before the first step. Gaussians from a file keep the degree of their colours, as far as there is room
/// for it.
fn first_branch(cloud: &GaussianCloud, masking: Masking, config: &Config, device: &Device, dtype: DType) -> Branch {
    let highest = config.model.sh_degree;
    Branch {
        sh_degree: cloud.sh_degree.min(highest),
        ..Branch::new(gaussians_of(cloud, masking, highest, device, dtype))
    }
}

/// The box of the dynamic cloud, without margin (METHOD §2.1); `None` for an empty one.
fn grid_bounds(cloud: &GaussianCloud) -> Option<GridBounds> {
    /// A flat cloud would make the grid's coordinates infinite.
    const MIN_SIDE: f64 = 1e-6;
    let (min, max) = cloud.bounds()?;
    let min = min.as_dvec3();
    let max = max.as_dvec3().max(min + DVec3::splat(MIN_SIDE));
    Some(GridBounds { max: max.to_array(), min: min.to_array() })
}
