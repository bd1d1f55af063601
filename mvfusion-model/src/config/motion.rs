//! Motion statistics and the modules MVG and MFTA.

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use super::keys::{keys, leaves};
use super::{
    Activation, Descriptor, Interval, Normalisation, Refinement, Temporal, TokenMode, TokenOffset, TokenValues,
    Trajectory,
};

/// Minimum number of steps between measurements of motion in shortened runs. While motion is being learned, its
/// descriptors change by more than the period of their encoding, so each measurement sets back the refined deformation.
const MIN_MEASURING: usize = 500;

/// MVG and MFTA (METHOD §10). The keys name their readings A5 to A30 and the rows of the paper's tables, which
/// docs/ablations.md lists.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(default, deny_unknown_fields)]
pub struct MotionConfig {
    /// Whether the motion-variance feature is added in the last stage. Without it, tokens have no local variance either
    /// (A26). Main paper, component ablation: "w/o MVG"; with `mfta` off as well, "w/o MVG & MFTA".
    pub mvg: bool,
    /// The input of MVG (A27, A29). Main paper, component ablation; supplement, temporal consistency.
    pub descriptor: Descriptor,
    /// The trajectories whose statistics MVG reads.
    pub trajectory: Trajectory,
    /// Whether the temporal feature is added in the last stage. Main paper, component ablation: "w/o MFTA".
    pub mfta: bool,
    /// How MFTA combines the tokens (A28, A30). Main paper, component ablation; supplement, temporal consistency.
    pub temporal: Temporal,
    /// Steps between refreshes of the statistics, `E` (paper: 2000). Supplement, update interval: 100, 500, 1000, 2000.
    pub interval: Interval<MIN_MEASURING>,
    /// Trajectory samples, `K` (paper: 64; A6).
    pub samples: usize,
    /// Evaluate only every n-th sample, and the last one (A6).
    pub sample_stride: usize,
    /// Every n-th sample is a knot of the variance dictionary (paper: 16; A6).
    pub knot_stride: usize,
    /// Number of evenly spaced knots instead; 0 means `knot_stride` (A6).
    pub knots: usize,
    /// The measure of the spread of a motion (A9).
    pub spread: Spread,
    /// Whether displacements are measured in scene extents instead of world units (A9b).
    pub in_extents: bool,
    /// Half window of the local variance in samples, and distance of the neighbour tokens in frames, `w` (A7, A8).
    /// Supplement, temporal window size: 3, 5, 7, 9.
    pub window: usize,
    /// Whether `window` and `knots` follow the number of distinct times of the training views. Ours. The window is then
    /// the same fraction of these times as `window` is of Neu3D's 300: rounded, at least 1, at most `window`. With
    /// fewer times than `samples`, there are as many knots as `knot_stride` gives with all samples. A run writes the
    /// results into its configuration, with this switch off.
    pub by_times: bool,
    /// Weights of the motion intensity (A9c), the last column of the signature. Supplement, fusion weights: five
    /// settings. One of them is `1, 0, 0`, which keeps the other columns and therefore differs from
    /// `descriptor = "position_variance"`.
    pub weights: FusionWeights,
    /// Centre and scale of the normalised descriptors (A10).
    pub normalisation: Normalisation,
    /// Decay of the moving mean and variance of the descriptors (A10).
    pub decay: f64,
    /// Whether mean and variance start from zero instead of the first measurement (A10).
    pub zero_start: bool,
    /// Whether local variances are normalised like the signatures (A10b).
    pub normalise_local: bool,
    /// Added to the standard deviation of the descriptors (A10).
    pub epsilon: f64,
    /// Bound of the soft clip of the descriptors (A10).
    pub soft_clip: f64,
    /// Octaves of the sinusoidal encoding (A11).
    pub octaves: usize,
    /// Hidden width of both MLPs (paper: 256; A11, A16).
    pub hidden: usize,
    /// The activation between the layers of the modules' MLPs (A11, A16).
    pub activation: Activation,
    /// Width of queries, keys and values over all heads (A15).
    pub attention_width: usize,
    /// Attention heads (A15).
    pub heads: usize,
    /// The frames that MFTA uses besides the current one (A7).
    pub tokens: TokenMode,
    /// Whether the current frame is a key of the cross-attention as well (A14).
    pub include_self: bool,
    /// The relative positional encoding of a token.
    pub token_offset: TokenOffset,
    /// What the values of the cross-attention are projected from.
    pub values: TokenValues,
    /// Whether tokens are normalised and the value of the current token is added to the attention's output, as in a
    /// transformer's block. Ours; the paper has neither.
    pub residual: bool,
    /// Number of nearest Gaussians that `temporal = "spatial"` reads. Ours.
    pub neighbours: usize,
    /// Whether gradients reach the network through the neighbours' tokens (A17); about three times the work.
    pub neighbour_gradient: bool,
    /// How the fused feature becomes offsets (A3).
    pub refinement: Refinement,
    /// Whether the mask heads also read the refined feature (A23).
    pub refine_masks: bool,
    /// Whether a new Gaussian inherits its parent's descriptors until the next measurement; otherwise it has none
    /// (A25).
    pub inherit: bool,
    /// The treatment of dynamic Gaussians that do not move.
    pub still: StillRule,
    /// A Gaussian does not move if its motion intensity is below this fraction of the 98 % quantile of the dynamic
    /// Gaussians. Ours.
    pub still_below: f64,
    /// Gaussians per chunk of the motion statistics and neighbour tokens (A34); eight times as many on a GPU.
    pub chunk: usize,
}

impl Default for MotionConfig {
    fn default() -> Self {
        Self {
            mvg: true,
            descriptor: Descriptor::default(),
            trajectory: Trajectory::default(),
            mfta: true,
            temporal: Temporal::default(),
            interval: Interval(2000),
            samples: 64,
            sample_stride: 1,
            knot_stride: 16,
            knots: 0,
            spread: Spread::Variance,
            in_extents: true,
            window: 5,
            by_times: false,
            weights: FusionWeights::default(),
            normalisation: Normalisation::default(),
            decay: 0.99,
            zero_start: false,
            normalise_local: true,
            epsilon: 1e-6,
            soft_clip: 3.0,
            octaves: 4,
            hidden: 256,
            activation: Activation::default(),
            attention_width: 128,
            heads: 4,
            tokens: TokenMode::Triple,
            include_self: false,
            token_offset: TokenOffset::default(),
            values: TokenValues::default(),
            residual: false,
            neighbours: 4,
            neighbour_gradient: false,
            refinement: Refinement::Replace,
            refine_masks: true,
            inherit: true,
            still: StillRule::Keep,
            still_below: 1e-4,
            chunk: 16_384,
        }
    }
}

impl MotionConfig {
    /// Whether MFTA reads the nearest Gaussians instead of neighbouring frames.
    pub fn reads_neighbours(&self) -> bool {
        self.mfta && self.temporal == Temporal::Spatial
    }
}

/// Weights of the three variances in the motion intensity (paper, eq. for the intensity score).
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(default, deny_unknown_fields)]
pub struct FusionWeights {
    /// Weight of the position variance.
    pub position: f64,
    /// Weight of the scale variance.
    pub scale: f64,
    /// Weight of the rotation variance.
    pub rotation: f64,
}

impl Default for FusionWeights {
    fn default() -> Self {
        Self { position: 0.7, scale: 0.2, rotation: 0.1 }
    }
}

/// The measure of the spread of a motion (A9).
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum Spread {
    /// The population variance, as the paper defines it.
    Variance,
    /// The standard deviation, as the paper calls it once.
    Deviation,
}

impl Spread {
    /// The spread of a population variance.
    pub fn of(self, variance: f64) -> f64 {
        match self {
            Self::Variance => variance,
            Self::Deviation => variance.sqrt(),
        }
    }
}

/// The treatment of dynamic Gaussians that do not move, at every measurement before `densify.until`. Ours: the paper
/// names pruning by motion as future work.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum StillRule {
    /// They stay.
    Keep,
    /// They are removed.
    Prune,
    /// They move to the static branch, in their state at the middle of the video.
    Reassign,
}

keys!(MotionConfig {
    mvg: ANY,
    descriptor: ANY,
    trajectory: ANY,
    mfta: ANY,
    temporal: ANY,
    interval: INTERVAL.saying("give the steps between two measurements of motion, at least 1"),
    samples: FROM_1.to(4096.0).saying("statistics need at least one sample"),
    sample_stride: FROM_1.saying("give 1 to evaluate every sample"),
    knot_stride: FROM_1,
    knots: FROM_0.to(4096.0),
    spread: ANY,
    in_extents: ANY,
    window: FROM_1.to(1e3).saying("a neighbour is at least one frame away"),
    by_times: ANY,
    weights: ANY,
    normalisation: ANY,
    decay: SHARE,
    zero_start: ANY,
    normalise_local: ANY,
    epsilon: ABOVE_0.from(1e-12),
    soft_clip: ABOVE_0.from(1e-6),
    octaves: FROM_0.to(16.0),
    hidden: WIDTH,
    activation: ANY,
    attention_width: WIDTH.saying("queries, keys and values need at least one column"),
    heads: WIDTH.saying("it must divide motion.attention_width"),
    tokens: ANY,
    include_self: ANY,
    token_offset: ANY,
    values: ANY,
    residual: ANY,
    neighbours: FROM_1.to(64.0).saying("give the number of nearest Gaussians that a token attends to"),
    neighbour_gradient: ANY,
    refinement: ANY,
    refine_masks: ANY,
    inherit: ANY,
    still: ANY,
    still_below: SHARE,
    chunk: FROM_1.to(1e8),
});

// All zeros are valid, too: the intensity is then 0.
keys!(FusionWeights { position: FROM_0, scale: FROM_0, rotation: FROM_0 });

leaves!(Spread, StillRule);
