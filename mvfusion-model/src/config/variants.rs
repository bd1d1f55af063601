//! The variants of MVG and MFTA in the paper's tables.

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use super::keys::leaves;

/// The input of MVG (A27, A29).
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum Descriptor {
    /// The whole signature and the local variance.
    #[default]
    Variances,
    /// The same without rotation and scale; the intensity is the position variance (main paper, component ablation: "w/
    /// MVG (position variance only)").
    PositionVariance,
    /// The raw offsets at the moment, without encoding and normaliser (supplement, temporal consistency: "Direct
    /// deformation magnitude").
    Offsets,
    /// The signature, the local variance, and the velocity at the moment. Ours: a signature is the same at all times.
    Momentary,
}

/// How MFTA combines the tokens of neighbouring frames (A28, A30).
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum Temporal {
    /// The current token attends to its neighbours.
    #[default]
    Cross,
    /// Every token attends to all tokens (main paper, component ablation: "w/o Cross-attention (Self-attention)").
    SelfAttention,
    /// The mean of the tokens (supplement, temporal consistency: "Temporal averaging").
    Average,
    /// A convolution over time (supplement, temporal consistency: "Temporal convolution").
    Convolution,
    /// The current token attends to those of the nearest Gaussians at the same time. Ours.
    Spatial,
}

/// The frames that MFTA uses besides the current frame `i` (A7).
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum TokenMode {
    /// The two frames `i - w` and `i + w`.
    Triple,
    /// All frames from `i - w` to `i + w`.
    FullWindow,
}

/// The relative positional encoding of a token, of its distance from the current one: in frames, as a fraction of `motion.window`, or in space, in
/// mean distances of the neighbours. Ours: without it, attention cannot tell the frame before from the one after.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum TokenOffset {
    /// Nothing (the paper).
    #[default]
    Absent,
    /// The signed distance.
    Signed,
    /// The signed distance with its sines and cosines in `motion.octaves` octaves.
    Sines,
}

/// What the values of the attention are projected from.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum TokenValues {
    /// The tokens of the neighbours (the paper).
    #[default]
    States,
    /// The same with, instead of their geometry, its difference from the current frame over the signed distance in time.
    /// Ours: a convex combination of states is no velocity, but one of velocities is.
    Velocities,
}

/// The activation between the layers of the modules' MLPs (A11, A16).
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum Activation {
    /// A ReLU. Units that are negative for every Gaussian no longer learn.
    #[default]
    Relu,
    /// `x sigmoid(x)`, which always learns.
    Silu,
}

/// Centre and scale of the normalised descriptors (A10).
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum Normalisation {
    /// Mean and standard deviation. A few Gaussians with far larger values than the others determine both.
    #[default]
    Moments,
    /// The median, and the interquartile range over that of the standard normal distribution. Ours.
    Quantiles,
}

/// The trajectories whose statistics MVG reads.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum Trajectory {
    /// The deformation at all times (the paper).
    #[default]
    Deformation,
    /// The deformation and the Gaussian's own velocity, each time weighted by the factor that its lifetime gives to the
    /// odds of its opacity. Ours, for `model.lifetime`: a Gaussian is not trained at times when it is not there.
    Lifetime,
}

/// How the fused feature becomes offsets (A3).
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum Refinement {
    /// The offsets of the fused feature replace those of the base feature; the identity at the start.
    Replace,
    /// The sum of both, as written in the paper; doubles the offsets at the start.
    Sum,
}

leaves!(Activation, Descriptor, Normalisation, Temporal, TokenMode, TokenOffset, TokenValues, Trajectory, Refinement);
