//! The variants of MFTA in the paper's tables.

use burn::module::Module;
use burn::tensor::Tensor;

use super::{TemporalAttention, TemporalAverage, TemporalConvolution, Tokens};
use crate::config::{MotionConfig, Temporal};
use crate::model::network::{Mlp, ModuleInit};

/// A variant of MFTA, which computes `h_MFTA` from tokens. Names in checkpoints: `refinement.attention`,
/// `refinement.self_attention`, `refinement.average`, `refinement.convolution`, `refinement.spatial`.
#[derive(Module, Debug)]
pub enum TemporalModule {
    /// The current token attends to its neighbours.
    Attention(TemporalAttention),
    /// Every token attends to all tokens, with the projections of cross-attention (A28).
    SelfAttention(TemporalAttention),
    /// The mean of the tokens (A30).
    Average(TemporalAverage),
    /// A convolution over time (A30).
    Convolution(TemporalConvolution),
    /// The current token attends to the nearest Gaussians at the same time. Ours.
    Spatial(TemporalAttention),
}

impl TemporalModule {
    /// A new module of the configured kind, without effect at the start.
    pub fn new(feature_width: usize, config: &MotionConfig, init: &mut ModuleInit<'_>) -> Self {
        let attention = |init| TemporalAttention::new(feature_width, config, init);
        match config.temporal {
            Temporal::Cross => Self::Attention(attention(init)),
            Temporal::SelfAttention => Self::SelfAttention(attention(init)),
            Temporal::Average => Self::Average(TemporalAverage::new(feature_width, config, init)),
            Temporal::Convolution => Self::Convolution(TemporalConvolution::new(feature_width, config, init)),
            Temporal::Spatial => Self::Spatial(attention(init)),
        }
    }

    /// `h_MFTA`: `[N, H]`.
    ///
    /// # Panics
    /// If tokens and layers do not match.
    pub fn forward(&self, tokens: Tokens) -> Tensor<2> {
        self.mlp().forward(self.mix(tokens))
    }

    /// The mixed tokens before the MLP: `[N, attention width]`, for averaging `[N, T]`.
    ///
    /// # Panics
    /// If tokens and layers do not match.
    pub fn mix(&self, tokens: Tokens) -> Tensor<2> {
        match self {
            Self::Attention(attention) | Self::Spatial(attention) => attention.attend(tokens),
            Self::SelfAttention(attention) => attention.attend_to_all(tokens.in_time_order()),
            Self::Average(average) => average.average(tokens.in_time_order()),
            Self::Convolution(convolution) => convolution.convolve(tokens.in_time_order()),
        }
    }

    /// Whether the module is an attention.
    pub fn attends(&self) -> bool {
        !matches!(self, Self::Average(_) | Self::Convolution(_))
    }

    /// The mean entropy of the attention, in nats: `[1]`; `None` for a module without attention.
    ///
    /// # Panics
    /// If tokens and layers do not match.
    pub fn entropy(&self, tokens: Tokens) -> Option<Tensor<1>> {
        match self {
            Self::Attention(attention) | Self::Spatial(attention) => Some(attention.entropy(tokens)),
            Self::SelfAttention(attention) => Some(attention.entropy_among_all(tokens.in_time_order())),
            Self::Average(_) | Self::Convolution(_) => None,
        }
    }

    /// The layers after the mixing.
    pub fn mlp(&self) -> &Mlp {
        match self {
            Self::Attention(attention) | Self::SelfAttention(attention) | Self::Spatial(attention) => &attention.mlp,
            Self::Average(average) => &average.mlp,
            Self::Convolution(convolution) => &convolution.mlp,
        }
    }
}
