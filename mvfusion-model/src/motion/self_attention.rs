//! The paper's variant of MFTA with self-attention (main paper, component ablation; METHOD A28).

use std::slice::from_ref;

use burn::tensor::Tensor;
use mvfusion_render::attention;

use super::TemporalAttention;
use crate::network::{Rectified, side_by_side};

impl TemporalAttention {
    /// Every token of a Gaussian attends to all of them, itself included; the mean of the outputs, before the MLP.
    /// `[N, S, T]` to `[N, attention width]`.
    ///
    /// # Panics
    /// As [`TemporalAttention::attend`].
    pub fn attend_to_all(&self, tokens: Tensor<3>) -> Tensor<2> {
        let [count, length, token] = tokens.dims();
        let layers = [from_ref(&self.query), from_ref(&self.key), from_ref(&self.value)];
        let projected = side_by_side(&layers, tokens.reshape([count * length, token]), Rectified::No);
        let width = projected.dims()[1] / layers.len();
        let queries = projected.clone().narrow(1, 0, width);
        // The op gives each query keys of its own, so a Gaussian's are repeated for each of its tokens.
        let memory = projected.narrow(1, width, 2 * width).reshape([count, 1, length, 2 * width]);
        let memory = memory.repeat_dim(1, length).reshape([count * length, length, 2 * width]);
        // Proof: as in `attend`; each query has the `length` keys of its Gaussian.
        let outputs = attention::forward(queries, memory, self.heads).unwrap_or_else(|error| panic!("MFTA: {error}"));
        outputs.reshape([count, length, width]).mean_dim(1).squeeze_dim(1)
    }
}
