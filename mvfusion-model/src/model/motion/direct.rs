//! The paper's control "direct deformation magnitude" (supplement, temporal consistency; METHOD A29).

use burn::module::Module;
use burn::tensor::Tensor;

use crate::config::MotionConfig;
use crate::model::network::{HeadChoice, Mlp, ModuleInit, Offsets, residual_mlp};

/// MVG with raw offsets instead of statistics: `h_MVG = W2 relu(W1 heads(h))`, with `W2` zero at the start. It
/// deliberately has no encoding, normaliser or local variance, although raw values differ by orders of magnitude.
#[derive(Module, Debug)]
pub struct DirectEncoder {
    /// Two layers; the last one starts at zero.
    pub mlp: Mlp,
}

impl DirectEncoder {
    /// An encoder from the outputs of `heads` to features of `width`.
    pub fn new(heads: HeadChoice, width: usize, config: &MotionConfig, init: &mut ModuleInit<'_>) -> Self {
        Self { mlp: residual_mlp(&[heads.outputs(), config.hidden, width], config.activation, init) }
    }

    /// Maps the offsets of `N` Gaussians to `[N, width]`.
    pub fn forward(&self, offsets: Offsets) -> Tensor<2> {
        self.mlp.forward(offsets.joined())
    }
}
