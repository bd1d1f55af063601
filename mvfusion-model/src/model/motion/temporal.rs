//! The variants of MFTA in the paper's tables.

use burn::module::Module;
use burn::tensor::Tensor;

use super::{TemporalAttention, TemporalAverage, TemporalConvolution};
use crate::config::{MotionConfig, Temporal};
use crate::model::network::{Mlp, ModuleInit};

/// A variant of MFTA, which computes `h_MFTA` from tokens. Names in checkpoints: `refinement.attention`,
/// `refinement.self_attention`, `refinement.average`, `refinement.convolution`.
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
}

/// The tokens of `N` Gaussians at one time.
#[derive(Clone, Debug)]
pub struct Tokens {
    /// Token of the current frame: `[N, T]`.
    pub centre: Tensor<2>,
    /// Tokens of the frames around it, in time order, as many before as after it: `[N, K, T]`.
    pub around: Tensor<3>,
}

impl TemporalModule {
    /// A new module of the configured kind, without effect at the start.
    pub fn new(feature_width: usize, config: &MotionConfig, init: &mut ModuleInit<'_>) -> Self {
        let (width, hidden) = (config.attention_width, config.hidden);
        let attention = |init| TemporalAttention::new(feature_width, config, init);
        match config.temporal {
            Temporal::Cross => Self::Attention(attention(init)),
            Temporal::SelfAttention => Self::SelfAttention(attention(init)),
            Temporal::Average => Self::Average(TemporalAverage::new(feature_width, hidden, init)),
            Temporal::Convolution => Self::Convolution(TemporalConvolution::new(feature_width, width, hidden, init)),
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
            Self::Attention(attention) => attention.attend(tokens.centre, tokens.around),
            Self::SelfAttention(attention) => attention.attend_to_all(tokens.in_time_order()),
            Self::Average(average) => average.average(tokens.in_time_order()),
            Self::Convolution(convolution) => convolution.convolve(tokens.in_time_order()),
        }
    }

    /// The layers after the mixing.
    pub fn mlp(&self) -> &Mlp {
        match self {
            Self::Attention(attention) | Self::SelfAttention(attention) => &attention.mlp,
            Self::Average(average) => &average.mlp,
            Self::Convolution(convolution) => &convolution.mlp,
        }
    }
}

impl Tokens {
    /// All tokens, the current one in the middle: `[N, K + 1, T]`.
    pub fn in_time_order(self) -> Tensor<3> {
        let half = self.around.dims()[1] / 2;
        let before = self.around.clone().narrow(1, 0, half);
        let after = self.around.narrow(1, half, half);
        Tensor::cat(vec![before, self.centre.unsqueeze_dim(1), after], 1)
    }
}
