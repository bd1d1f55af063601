//! A small network whose Gaussians move, and the refinement that given switches make of it.

use burn::module::{Module, Param};
use burn::nn::Linear;
use burn::tensor::{DType, Device, Tensor};
use mvfusion_model::config::MotionConfig;
use mvfusion_model::model::motion::{
    Guidance, MomentRows, MotionCache, MotionRefinement, Normalisers, RefinementConfig, SIGNATURE_WIDTH, Substitutes,
    TemporalModule, Trajectories, TrajectoryStatistics,
};
use mvfusion_model::model::network::{DeformationConfig, DeformationNetwork, HeadChoice, Mlp, ModuleInit, Offsets};
use mvfusion_model::random::Stream;
use mvfusion_model::timeline::Timeline;
use mvfusion_render::grid::{GridBounds, GridLayout};
use mvfusion_tests::{numbers, tensor};

// Widths are all different, so that formulas cannot mix them up.

/// Width of features.
pub const WIDTH: usize = 12;

/// Width of hidden layers.
pub const HIDDEN: usize = 10;

/// Width of the attention.
pub const ATTENTION: usize = 8;

/// Gaussians.
const COUNT: usize = 7;

/// Frames.
const FRAMES: usize = 12;

/// Turns switches.
pub type Switch = fn(&mut MotionConfig);

/// The switches before any is turned.
pub fn defaults() -> MotionConfig {
    MotionConfig {
        samples: 8,
        knot_stride: 3,
        window: 2,
        hidden: HIDDEN,
        attention_width: ATTENTION,
        heads: 2,
        chunk: 5,
        ..MotionConfig::default()
    }
}

/// The defaults with the given switches turned.
pub fn with(switch: Switch) -> MotionConfig {
    let mut motion = defaults();
    switch(&mut motion);
    motion
}

/// What all variants have in common.
pub struct Bench {
    network: DeformationNetwork,
    timeline: Timeline,
    deformation: DeformationConfig,
    means: Tensor<2>,
    device: Device,
}

/// Extent of the scene, so that displacements in extents are not those in world units.
const EXTENT: f64 = 2.5;

/// A moment between two frames, two samples and two knots.
const TIME: f64 = 0.31;

impl Bench {
    pub fn new(device: &Device) -> Self {
        Self::with_heads(HeadChoice::ALL, device)
    }

    /// With the given heads only.
    pub fn with_heads(heads: HeadChoice, device: &Device) -> Self {
        let deformation = DeformationConfig {
            layout: GridLayout { features: 3, resolution: [4, 5, 4, 6], multipliers: vec![1, 2] },
            bounds: GridBounds { min: [-1.0; 3], max: [1.0; 3] },
            width: WIDTH,
            depth: 1,
            heads,
        };
        let mut stream = Stream::new(3, 0);
        let learning = device.clone().autodiff();
        let mut init = ModuleInit { device: &learning, dtype: DType::F32, stream: &mut stream };
        let mut network = deformation.init(&mut init).valid();
        // Time planes of ones, as a run has them at the start, would let nothing move.
        let shape = network.grid.planes.val().dims();
        network.grid.planes = Param::from_tensor(random(&mut stream, shape, 0.2, 1.6, device));
        let means = random(&mut stream, [COUNT, 3], -0.9, 0.9, device);
        let timeline = Timeline::new((0..FRAMES).map(|frame| frame as f64 / FRAMES as f64).collect());
        Self { network, timeline, deformation, means, device: device.clone() }
    }

    /// The modules as a run starts with them, without autodiff, and the stream behind them.
    pub fn fresh(&self, motion: &MotionConfig) -> (MotionRefinement, Stream) {
        let mut stream = Stream::new(5, 0);
        let learning = self.device.clone().autodiff();
        let mut init = ModuleInit { device: &learning, dtype: DType::F32, stream: &mut stream };
        let refinement = MotionRefinement::new(&self.deformation, motion, &mut init);
        (refinement.valid(), stream)
    }

    /// The modules with last layers that have an effect, the same in every variant.
    pub fn awake(&self, motion: &MotionConfig) -> MotionRefinement {
        let (mut refinement, _) = self.fresh(motion);
        match &mut refinement.guidance {
            Some(Guidance::Encoder(encoder)) => self.awaken(&mut encoder.mlp, 1),
            Some(Guidance::Direct(encoder)) => self.awaken(&mut encoder.mlp, 1),
            None => (),
        }
        match &mut refinement.temporal {
            Some(
                TemporalModule::Attention(module)
                | TemporalModule::SelfAttention(module)
                | TemporalModule::Spatial(module),
            ) => self.awaken(&mut module.mlp, 2),
            Some(TemporalModule::Average(module)) => self.awaken(&mut module.mlp, 2),
            Some(TemporalModule::Convolution(module)) => self.awaken(&mut module.mlp, 2),
            None => (),
        }
        refinement
    }

    fn awaken(&self, mlp: &mut Mlp, number: u64) {
        let mut stream = Stream::new(5, number);
        let mut init = ModuleInit { device: &self.device, dtype: DType::F32, stream: &mut stream };
        let last: &mut Linear = mlp.layers.last_mut().expect("two layers");
        *last = init.linear(HIDDEN, WIDTH);
    }

    /// The statistics under these switches.
    pub fn measure(&self, motion: &MotionConfig) -> TrajectoryStatistics {
        let Self { network, timeline, .. } = self;
        let trajectories = Trajectories { network, timeline, config: motion, extent: EXTENT, lifetimes: None };
        trajectories.measure(&self.means).expect("the device hands its numbers back")
    }

    /// Refined offsets of given modules and statistics.
    pub fn refined(
        &self,
        refinement: &MotionRefinement,
        statistics: TrajectoryStatistics,
        motion: &MotionConfig,
    ) -> Offsets {
        let cache = MotionCache::new(statistics, &mut Normalisers::default(), motion, &self.means);
        let cache = cache.expect("the device hands its numbers back");
        let substitutes = Substitutes::default();
        let moments = [MomentRows { time: TIME, cache: &cache }];
        let config =
            RefinementConfig { timeline: &self.timeline, moments: &moments, extent: EXTENT, substitutes: &substitutes };
        refinement.offsets(&self.network, self.means.clone(), &config)
    }

    /// What comes out under these switches, with modules that have an effect.
    pub fn outcome(&self, motion: &MotionConfig) -> Vec<f64> {
        self.outcome_of(self.measure(motion), motion)
    }

    /// The same of given statistics.
    pub fn outcome_of(&self, statistics: TrajectoryStatistics, motion: &MotionConfig) -> Vec<f64> {
        numbers(self.refined(&self.awake(motion), statistics, motion).joined())
    }

    /// The base offsets.
    pub fn base(&self) -> Vec<f64> {
        let time = tensor(&[TIME], [1, 1], &self.device, DType::F32);
        numbers(self.network.decode(self.network.feature(self.means.clone(), time)).joined())
    }
}

fn random<const D: usize>(stream: &mut Stream, shape: [usize; D], from: f64, to: f64, device: &Device) -> Tensor<D> {
    let values: Vec<f64> = (0..shape.iter().product()).map(|_| stream.uniform(from, to)).collect();
    tensor(&values, shape, device, DType::F32)
}

/// Statistics with other numbers in some columns of the signatures.
pub fn disturbed(mut statistics: TrajectoryStatistics, columns: std::ops::Range<usize>) -> TrajectoryStatistics {
    let rows = statistics.signatures.chunks_exact_mut(SIGNATURE_WIDTH).enumerate();
    rows.for_each(|(row, values)| values[columns.clone()].iter_mut().for_each(|v| *v += 0.1 * (row * row) as f64));
    statistics
}
