//! The variants of MVG and MFTA that the paper's tables compare, and which of them exclude one another.

use serde::{Deserialize, Serialize};

use super::keys::leaves;

/// What MVG is shown (A27, A29).
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Descriptor {
    /// The whole signature and the local variance.
    #[default]
    Variances,
    /// The same without rotation and scale; the intensity is the position's variance (main paper, component ablation:
    /// "w/ MVG (position variance only)").
    PositionVariance,
    /// The raw offsets of the moment, with neither encoding nor normaliser (supplement, temporal consistency: "Direct
    /// deformation magnitude").
    Offsets,
}

/// What MFTA makes of the tokens of neighbouring frames (A28, A30).
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Temporal {
    /// The current token attends to its neighbours.
    #[default]
    Cross,
    /// Every token attends to all of them (main paper, component ablation: "w/o Cross-attention (Self-attention)").
    SelfAttention,
    /// Their mean (supplement, temporal consistency: "Temporal averaging").
    Average,
    /// A convolution over time (supplement, temporal consistency: "Temporal convolution").
    Convolution,
}

/// Which frames MFTA looks at beside the current frame `i` (A7).
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum TokenMode {
    /// The two frames `i - w` and `i + w`.
    Triple,
    /// All frames from `i - w` to `i + w`.
    FullWindow,
}

/// How the fused feature turns into offsets (A3).
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Refinement {
    /// The heads of the fused feature replace those of the base feature; the identity at the start.
    Replace,
    /// The paper's literal sum of both; doubles the offsets at the start.
    Sum,
}

leaves!(Descriptor, Temporal, TokenMode, Refinement);
