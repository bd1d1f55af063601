//! The paper's variant of MFTA with self-attention (main paper, component ablation; METHOD A28).

use std::slice::from_ref;

use burn::tensor::Tensor;

use super::TemporalAttention;
use crate::model::network::{Rectified, side_by_side};

impl TemporalAttention {
    /// Every token of a Gaussian attends to all tokens, including itself. Returns the mean of the outputs, before the
    /// MLP: `[N, S, T]` to `[N, attention width]`.
    ///
    /// # Panics
    /// Same as [`TemporalAttention::attend`].
    pub fn attend_to_all(&self, tokens: Tensor<3>) -> Tensor<2> {
        let [count, length, token] = tokens.dims();
        let tokens = tokens.reshape([count * length, token]);
        let queries = side_by_side(&[from_ref(&self.query)], tokens.clone(), Rectified::No);
        let memory = side_by_side(&[from_ref(&self.key), from_ref(&self.value)], tokens, Rectified::No);
        let width = queries.dims()[1];
        let outputs = self.look(queries.reshape([count, length, width]), memory.reshape([count, length, 2 * width]));
        outputs.mean_dim(1).squeeze_dim(1)
    }
}
