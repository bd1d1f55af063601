//! MFTA: query-centred attention over neighbouring frames (paper, "MotionFormer Attention"; METHOD A14 to A16).

use burn::module::Module;
use burn::nn::Linear;
use burn::tensor::{Tensor, activation::softmax};

use super::token::GEOMETRY_WIDTH;
use crate::network::{LayerInit, Mlp, zero_last_layer};

/// The current token attends to tokens of neighbouring frames; an MLP that starts at zero turns the result into a residual
/// of the deformation feature. Multi-head, scaled by `1 / sqrt(d)`, without layer norm, dropout or output projection.
///
/// Written out with broadcasting: for two keys this is several times faster on a CPU than a general attention layer.
#[derive(Module, Debug)]
pub struct TemporalAttention {
    /// Token to query.
    pub query: Linear,
    /// Token to key.
    pub key: Linear,
    /// Token to value.
    pub value: Linear,
    /// Two layers; the last one starts at zero.
    pub mlp: Mlp,
    #[module(skip)]
    heads: usize,
}

impl TemporalAttention {
    /// Attention over tokens of features of `feature_width`, `attention_width` wide over all `heads`.
    pub fn new(
        feature_width: usize,
        attention_width: usize,
        hidden: usize,
        heads: usize,
        init: &mut LayerInit<'_>,
    ) -> Self {
        let token = feature_width + GEOMETRY_WIDTH + 1;
        Self {
            query: init.linear(token, attention_width),
            key: init.linear(token, attention_width),
            value: init.linear(token, attention_width),
            mlp: zero_last_layer(init.mlp(&[attention_width, hidden, feature_width])),
            heads,
        }
    }

    /// Attention of given layers.
    pub fn from_layers(query: Linear, key: Linear, value: Linear, mlp: Mlp, heads: usize) -> Self {
        Self { query, key, value, mlp, heads }
    }

    /// Centre token `[N, T]` and the tokens it attends to, each `[N, T]`, to a residual `[N, H]`.
    pub fn forward(&self, centre: Tensor<2>, neighbours: &[Tensor<2>]) -> Tensor<2> {
        self.mlp.forward(self.attend(centre, neighbours))
    }

    /// The attention's output before the MLP: `[N, attention width]`.
    pub fn attend(&self, centre: Tensor<2>, neighbours: &[Tensor<2>]) -> Tensor<2> {
        let query = self.split(self.query.forward(centre));
        let [count, heads, width] = query.dims();
        let scale = 1.0 / (width as f64).sqrt();
        let scores: Vec<Tensor<3>> = neighbours
            .iter()
            .map(|token| (query.clone() * self.split(self.key.forward(token.clone()))).sum_dim(2) * scale)
            .collect();
        let weights = softmax(Tensor::cat(scores, 2), 2);
        let mixed = neighbours
            .iter()
            .enumerate()
            .map(|(index, token)| self.split(self.value.forward(token.clone())) * weights.clone().narrow(2, index, 1));
        let mixed = mixed.reduce(|sum, part| sum + part);
        mixed.unwrap_or_else(|| query.zeros_like()).reshape([count, heads * width])
    }

    /// `[N, attention width]` to `[N, heads, d]`.
    fn split(&self, rows: Tensor<2>) -> Tensor<3> {
        let [count, width] = rows.dims();
        rows.reshape([count, self.heads, width / self.heads])
    }
}
