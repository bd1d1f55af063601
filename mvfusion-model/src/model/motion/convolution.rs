//! The paper's control "temporal convolution" (supplement, temporal consistency; METHOD A30).

use std::slice::from_ref;

use burn::module::Module;
use burn::nn::Linear;
use burn::tensor::Tensor;

use super::token::token_width;
use crate::config::MotionConfig;
use crate::model::network::{Mlp, ModuleInit, Rectified, residual_mlp, side_by_side};

/// Taps of the convolution: previous, current and next frame.
const TAPS: usize = 3;

/// A convolution over the three tokens instead of attention, then the MLP of MFTA. Three taps on three tokens without
/// padding have one output, so the convolution is a linear layer of the concatenated tokens.
#[derive(Module, Debug)]
pub struct TemporalConvolution {
    /// Maps previous, current and next token, concatenated, to the width of the attention.
    pub taps: Linear,
    /// Two layers; the last one starts at zero.
    pub mlp: Mlp,
}

impl TemporalConvolution {
    /// A convolution over tokens for features of `feature_width`.
    pub fn new(feature_width: usize, config: &MotionConfig, init: &mut ModuleInit<'_>) -> Self {
        let width = config.attention_width;
        Self {
            taps: init.linear(TAPS * token_width(feature_width, config), width),
            mlp: residual_mlp(&[width, config.hidden, feature_width], config.activation, init),
        }
    }

    /// The convolution before the MLP: `[N, 3, T]` in time order to `[N, attention width]`.
    ///
    /// # Panics
    /// If these are not three tokens of the layer's width.
    pub fn convolve(&self, tokens: Tensor<3>) -> Tensor<2> {
        let [count, length, token] = tokens.dims();
        side_by_side(&[from_ref(&self.taps)], tokens.reshape([count, length * token]), Rectified::No)
    }
}
