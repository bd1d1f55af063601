//! The paper's control "temporal averaging" (supplement, temporal consistency; METHOD A30).

use burn::module::Module;
use burn::tensor::Tensor;

use super::token::token_width;
use crate::config::MotionConfig;
use crate::model::network::{Mlp, ModuleInit, residual_mlp};

/// The mean of the tokens instead of attention. It has a separate MLP, because tokens are wider than the output of
/// attention.
#[derive(Module, Debug)]
pub struct TemporalAverage {
    /// Two layers; the last one starts at zero.
    pub mlp: Mlp,
}

impl TemporalAverage {
    /// Averaging over tokens for features of `feature_width`.
    pub fn new(feature_width: usize, config: &MotionConfig, init: &mut ModuleInit<'_>) -> Self {
        let token = token_width(feature_width, config);
        Self { mlp: residual_mlp(&[token, config.hidden, feature_width], config.activation, init) }
    }

    /// The mean of the tokens, before the MLP: `[N, S, T]` to `[N, T]`.
    pub fn average(&self, tokens: Tensor<3>) -> Tensor<2> {
        tokens.mean_dim(1).squeeze_dim(1)
    }
}
