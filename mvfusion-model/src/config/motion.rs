//! Motion statistics and the two modules that read them.

use serde::{Deserialize, Serialize};

use super::keys::{keys, leaves};
use super::{Descriptor, Interval, Refinement, Temporal, TokenMode};

/// Motion is never measured more often than this, however short the run: the descriptors of a motion that is still being
/// learned change by more than their encoding's period, so that each measurement throws the refined deformation back.
const MIN_MEASURING: usize = 500;

/// MVG and MFTA (METHOD §10; the readings A5 to A30 are named at the keys). What the paper's tables compare is said at
/// the keys as well, and gathered in docs/ablations.md.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct MotionConfig {
    /// Whether the motion-variance feature is added in the last stage. Without, tokens have no local variance either
    /// (A26). Main paper, component ablation: "w/o MVG"; with `mfta` off as well, "w/o MVG & MFTA".
    pub mvg: bool,
    /// What MVG is shown (A27, A29). Main paper, component ablation; supplement, temporal consistency.
    pub descriptor: Descriptor,
    /// Whether the temporal feature is added in the last stage. Main paper, component ablation: "w/o MFTA".
    pub mfta: bool,
    /// What MFTA makes of the tokens (A28, A30). Main paper, component ablation; supplement, temporal consistency.
    pub temporal: Temporal,
    /// Steps between refreshes of the statistics, `E` (paper: 2000). Supplement, update interval: 100, 500, 1000, 2000.
    pub interval: Interval<MIN_MEASURING>,
    /// Trajectory samples, `K` (paper: 64; A6).
    pub samples: usize,
    /// Only every n-th of them is evaluated, and the last one (A6).
    pub sample_stride: usize,
    /// Every n-th sample is a knot of the variance dictionary, with this n (paper: 16; A6).
    pub knot_stride: usize,
    /// Number of evenly spread knots instead; 0 goes by `knot_stride` (A6).
    pub knots: usize,
    /// What stands for the spread of a motion (A9).
    pub spread: Spread,
    /// Whether displacements are measured in scene extents instead of world units (A9b).
    pub in_extents: bool,
    /// Half window of the local variance in samples, and distance of the neighbour tokens in frames, `w` (A7, A8).
    /// Supplement, temporal window size: 3, 5, 7, 9.
    pub window: usize,
    /// Whether `window` and `knots` go by the distinct times of the training views. Ours. The window is then the same
    /// share of these times as `window` is of Neu3D's 300, rounded, at least 1 and at most `window`. Where there are
    /// fewer times than `samples`, there are as many knots as `knot_stride` gives with all samples. A run writes the
    /// numbers that it found into its configuration, with this switched off.
    pub by_times: bool,
    /// Weights of the motion intensity (A9c), which is the last column of the signature. Supplement, fusion weights:
    /// five settings, among them `1, 0, 0`, which keeps the other columns and so is not
    /// `descriptor = "position_variance"`.
    pub weights: FusionWeights,
    /// Decay of the moving mean and variance of the descriptors (A10).
    pub decay: f64,
    /// Whether these start from zero instead of the first measurement (A10).
    pub zero_start: bool,
    /// Whether local variances are normalised like the signatures (A10b).
    pub normalise_local: bool,
    /// Added to the standard deviation of the descriptors (A10).
    pub epsilon: f64,
    /// Descriptors are squashed softly to plus or minus this (A10).
    pub soft_clip: f64,
    /// Octaves of the sinusoidal encoding (A11).
    pub octaves: usize,
    /// Hidden width of both MLPs (paper: 256; A11, A16).
    pub hidden: usize,
    /// Width of queries, keys and values over all heads (A15).
    pub attention_width: usize,
    /// Attention heads (A15).
    pub heads: usize,
    /// Which frames MFTA looks at beside the current one (A7).
    pub tokens: TokenMode,
    /// Whether the current frame is a key of the cross-attention as well (A14).
    pub include_self: bool,
    /// Whether gradients reach the network through the neighbours' tokens (A17); about three times the work.
    pub neighbour_gradient: bool,
    /// How base and refined offsets become one (A3).
    pub refinement: Refinement,
    /// Whether the mask heads see the refined feature as well (A23).
    pub refine_masks: bool,
    /// Whether a new Gaussian has its parent's descriptors until the next measurement; else it has none (A25).
    pub inherit: bool,
    /// What becomes of dynamic Gaussians that do not move.
    pub still: StillRule,
    /// A Gaussian does not move if its motion intensity is below this share of what only 2 % of the dynamic ones exceed.
    pub still_below: f64,
    /// Gaussians handled at once when statistics and neighbour tokens are computed (A34).
    pub chunk: usize,
}

impl Default for MotionConfig {
    fn default() -> Self {
        Self {
            mvg: true,
            descriptor: Descriptor::default(),
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
            decay: 0.99,
            zero_start: false,
            normalise_local: true,
            epsilon: 1e-6,
            soft_clip: 3.0,
            octaves: 4,
            hidden: 256,
            attention_width: 128,
            heads: 4,
            tokens: TokenMode::Triple,
            include_self: false,
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

/// Weights of the three variances in the motion intensity (paper, eq. for the intensity score).
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
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

/// What stands for the spread of a motion (A9).
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Spread {
    /// The population variance, as the paper defines it.
    Variance,
    /// Its root, as the paper once calls it.
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

/// What becomes, at every measurement of the last stage, of dynamic Gaussians that do not move. Ours: the paper names
/// pruning by motion as future work.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum StillRule {
    /// They stay.
    Keep,
    /// They are removed.
    Prune,
    /// They move to the static branch, as they are at the middle of the video.
    Reassign,
}

keys!(MotionConfig {
    mvg: ANY,
    descriptor: ANY,
    mfta: ANY,
    temporal: ANY,
    interval: FROM_1.saying("give the steps between two measurements of motion, at least 1"),
    samples: FROM_1.saying("statistics need at least one sample"),
    sample_stride: FROM_1.saying("give 1 to evaluate every sample"),
    knot_stride: FROM_1,
    knots: ANY,
    spread: ANY,
    in_extents: ANY,
    window: FROM_1.saying("a neighbour is at least one frame away"),
    by_times: ANY,
    weights: ANY,
    decay: SHARE,
    zero_start: ANY,
    normalise_local: ANY,
    epsilon: ABOVE_0,
    soft_clip: ABOVE_0,
    octaves: ANY,
    hidden: FROM_1,
    attention_width: FROM_1.saying("queries, keys and values need at least one column"),
    heads: FROM_1.saying("it must divide motion.attention_width"),
    tokens: ANY,
    include_self: ANY,
    neighbour_gradient: ANY,
    refinement: ANY,
    refine_masks: ANY,
    inherit: ANY,
    still: ANY,
    still_below: SHARE,
    chunk: FROM_1,
});

// Zeros alone are a choice as well: an intensity that says nothing.
keys!(FusionWeights { position: FROM_0, scale: FROM_0, rotation: FROM_0 });

leaves!(Spread, StillRule);
