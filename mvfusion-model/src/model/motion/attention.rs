//! MFTA: query-centred attention over neighbouring frames (paper, "MotionFormer Attention"; METHOD A14 to A16).

use std::slice::from_ref;

use burn::module::Module;
use burn::nn::Linear;
use burn::tensor::Tensor;
use mvfusion_render::attention;

use super::token::token_width;
use crate::config::MotionConfig;
use crate::model::network::{Mlp, ModuleInit, Rectified, side_by_side, zero_last_layer};

/// The current token attends to tokens of neighbouring frames. An MLP that starts at zero maps the result to a residual
/// of the deformation feature. The attention is multi-head, scaled by `1 / sqrt(d)`, without layer norm, dropout or
/// output projection.
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
    pub(super) heads: usize,
    #[module(skip)]
    include_self: bool,
}

impl TemporalAttention {
    /// Attention over tokens for features of `feature_width`.
    pub fn new(feature_width: usize, config: &MotionConfig, init: &mut ModuleInit<'_>) -> Self {
        let (token, width) = (token_width(feature_width), config.attention_width);
        let [query, key, value] = [(); 3].map(|()| init.linear(token, width));
        let mlp = zero_last_layer(init.mlp(&[width, config.hidden, feature_width]));
        Self::from_layers(query, key, value, mlp, config)
    }

    /// Attention with given layers.
    pub fn from_layers(query: Linear, key: Linear, value: Linear, mlp: Mlp, config: &MotionConfig) -> Self {
        Self { query, key, value, mlp, heads: config.heads, include_self: config.include_self }
    }

    /// Maps centre tokens `[N, T]` and the `K` tokens around each, `[N, K, T]`, to the output of the attention before
    /// the MLP: `[N, attention width]`. With `motion.include_self`, the centre also attends to itself.
    ///
    /// # Panics
    /// If the shapes do not match the layers, or the heads do not divide the attention width.
    pub fn attend(&self, centre: Tensor<2>, neighbours: Tensor<3>) -> Tensor<2> {
        let neighbours = match self.include_self {
            // Attention is independent of the order.
            true => Tensor::cat(vec![neighbours, centre.clone().unsqueeze_dim(1)], 1),
            false => neighbours,
        };
        let [count, keys, token] = neighbours.dims();
        let project = |layers: &[&[Linear]], tokens| side_by_side(layers, tokens, Rectified::No);
        let queries = project(&[from_ref(&self.query)], centre);
        let memory = project(&[from_ref(&self.key), from_ref(&self.value)], neighbours.reshape([count * keys, token]));
        let memory = memory.reshape([count, keys, 2 * queries.dims()[1]]);
        self.look(queries.unsqueeze_dim(1), memory).squeeze_dim(1)
    }

    /// Attention of queries `[N, Q, width]` to the keys and values `[N, K, 2 width]` of their row: `[N, Q, width]`.
    pub(super) fn look(&self, queries: Tensor<3>, memory: Tensor<3>) -> Tensor<3> {
        // Proof: `Config::check` ensures that the heads divide the width of query, key and value. Both tensors have the
        // same Gaussians and at least one token each.
        attention::forward(queries, memory, self.heads).unwrap_or_else(|error| panic!("MFTA: {error}"))
    }
}
