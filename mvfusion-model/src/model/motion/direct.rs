//! The paper's control "direct deformation magnitude" (supplement, temporal consistency; METHOD A29).

use burn::module::Module;
use burn::tensor::Tensor;

use crate::model::network::{HeadChoice, Mlp, ModuleInit, Offsets, zero_last_layer};

/// MVG that is shown raw offsets instead of statistics: `h_MVG = W2 relu(W1 heads(h))`, with `W2` zero at the start.
/// There is no encoding, no normaliser and no local variance: that raw numbers differ by orders of magnitude is the
/// point.
#[derive(Module, Debug)]
pub struct DirectEncoder {
    /// Two layers; the last one starts at zero.
    pub mlp: Mlp,
}

impl DirectEncoder {
    /// An encoder of what `heads` put out to features of `width`, through `hidden` units.
    pub fn new(heads: HeadChoice, width: usize, hidden: usize, init: &mut ModuleInit<'_>) -> Self {
        Self { mlp: zero_last_layer(init.mlp(&[heads.outputs(), hidden, width])) }
    }

    /// Offsets of `N` Gaussians to `[N, width]`.
    pub fn forward(&self, offsets: Offsets) -> Tensor<2> {
        self.mlp.forward(offsets.joined())
    }
}
