//! The variants of MVG and MFTA in the paper's tables.

use serde::{Deserialize, Serialize};

use super::keys::leaves;

/// The input of MVG (A27, A29).
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
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
}

/// How MFTA combines the tokens of neighbouring frames (A28, A30).
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
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
}

/// The frames that MFTA uses besides the current frame `i` (A7).
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum TokenMode {
    /// The two frames `i - w` and `i + w`.
    Triple,
    /// All frames from `i - w` to `i + w`.
    FullWindow,
}

/// How the fused feature becomes offsets (A3).
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Refinement {
    /// The offsets of the fused feature replace those of the base feature; the identity at the start.
    Replace,
    /// The sum of both, as written in the paper; doubles the offsets at the start.
    Sum,
}

leaves!(Descriptor, Temporal, TokenMode, Refinement);
