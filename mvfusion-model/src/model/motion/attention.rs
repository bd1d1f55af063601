//! MFTA: query-centred attention over neighbouring frames (paper, "MotionFormer Attention"; METHOD A14 to A16).

use std::slice::from_ref;

use burn::module::Module;
use burn::nn::{LayerNorm, LayerNormConfig, Linear};
use burn::tensor::Tensor;
use burn::tensor::activation::softmax;
use mvfusion_render::attention;

use super::Tokens;
use super::token::token_width;
use crate::config::MotionConfig;
use crate::model::network::{Mlp, ModuleInit, Rectified, residual_mlp, side_by_side};

/// The current token attends to tokens around it. An MLP that starts at zero maps the result to a residual of the
/// deformation feature. The attention is multi-head, scaled by `1 / sqrt(d)`, without dropout or output projection. It
/// has layer norm and a residual only with `motion.residual`.
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
    /// Normalises tokens, if the value of the current token is added to the output.
    pub norm: Option<LayerNorm>,
    #[module(skip)]
    pub(super) heads: usize,
    #[module(skip)]
    include_self: bool,
}

impl TemporalAttention {
    /// Attention over tokens for features of `feature_width`.
    pub fn new(feature_width: usize, config: &MotionConfig, init: &mut ModuleInit<'_>) -> Self {
        let (token, width) = (token_width(feature_width, config), config.attention_width);
        let [query, key, value] = [(); 3].map(|()| init.linear(token, width));
        let mlp = residual_mlp(&[width, config.hidden, feature_width], config.activation, init);
        let norm = config.residual.then(|| {
            let mut norm = LayerNormConfig::new(token).init(init.device);
            norm.gamma = init.parameter(vec![1.0; token], [token]);
            norm.beta = Some(init.parameter(vec![0.0; token], [token]));
            norm
        });
        Self { norm, ..Self::from_layers(query, key, value, mlp, config) }
    }

    /// Attention with given layers, without layer norm.
    pub fn from_layers(query: Linear, key: Linear, value: Linear, mlp: Mlp, config: &MotionConfig) -> Self {
        Self { query, key, value, mlp, norm: None, heads: config.heads, include_self: config.include_self }
    }

    /// Maps tokens to the output of the attention before the MLP: `[N, attention width]`. With `motion.include_self`, the
    /// current token also attends to itself.
    ///
    /// # Panics
    /// If the shapes do not match the layers, or the heads do not divide the attention width.
    pub fn attend(&self, tokens: Tokens) -> Tensor<2> {
        let tokens = self.normalised(tokens);
        let current = self.norm.as_ref().map(|_| project(&[&self.value], tokens.centre.clone()));
        let (queries, memory) = self.projections(tokens);
        let found = self.look(queries, memory).squeeze_dim(1);
        match current {
            Some(current) => found + current,
            None => found,
        }
    }

    /// The mean entropy of the current token's attention over Gaussians and heads, in nats: `[1]`.
    ///
    /// # Panics
    /// Same as [`TemporalAttention::attend`].
    pub fn entropy(&self, tokens: Tokens) -> Tensor<1> {
        let (queries, memory) = self.projections(self.normalised(tokens));
        self.entropy_of(queries, memory)
    }

    fn normalised(&self, tokens: Tokens) -> Tokens {
        match &self.norm {
            Some(norm) => tokens.map(|rows| norm.forward(rows)),
            None => tokens,
        }
    }

    /// Queries `[N, 1, width]`, and keys and values `[N, K, 2 width]`.
    fn projections(&self, tokens: Tokens) -> (Tensor<3>, Tensor<3>) {
        let Tokens { centre, mut around, values } = tokens;
        if self.include_self {
            // Attention is independent of the order.
            around = Tensor::cat(vec![around, centre.clone().unsqueeze_dim(1)], 1);
        }
        let [count, keys, token] = around.dims();
        let rows = |tokens: Tensor<3>| tokens.reshape([count * keys, token]);
        let queries = project(&[&self.query], centre);
        let memory = match values {
            None => project(&[&self.key, &self.value], rows(around)),
            Some(values) => {
                Tensor::cat(vec![project(&[&self.key], rows(around)), project(&[&self.value], rows(values))], 1)
            }
        };
        let memory = memory.reshape([count, keys, 2 * queries.dims()[1]]);
        (queries.unsqueeze_dim(1), memory)
    }

    /// Attention of queries `[N, Q, width]` to the keys and values `[N, K, 2 width]` of their row: `[N, Q, width]`.
    pub(super) fn look(&self, queries: Tensor<3>, memory: Tensor<3>) -> Tensor<3> {
        // Proof: `Config::check` ensures that the heads divide the width of query, key and value. Both tensors have the
        // same Gaussians and at least one token each.
        attention::forward(queries, memory, self.heads).unwrap_or_else(|error| panic!("MFTA: {error}"))
    }

    /// The mean entropy of the weights of that attention, in nats: `[1]`.
    pub(super) fn entropy_of(&self, queries: Tensor<3>, memory: Tensor<3>) -> Tensor<1> {
        let [count, asked, width] = queries.dims();
        let keys = memory.dims()[1];
        let of_head = width / self.heads;
        let by_head = |rows: Tensor<3>, length| -> Tensor<4> {
            rows.narrow(2, 0, width).reshape([count, length, self.heads, of_head]).swap_dims(1, 2)
        };
        let scores = by_head(queries, asked).matmul(by_head(memory, keys).transpose()) / (of_head as f64).sqrt();
        let weights = softmax(scores, 3);
        // p ln p is 0 at 0.
        let logarithms = weights.clone().clamp_min(f32::MIN_POSITIVE).log();
        -(weights * logarithms).sum_dim(3).mean()
    }
}

/// Applies layers to the same rows, their outputs side by side.
pub(super) fn project(layers: &[&Linear], rows: Tensor<2>) -> Tensor<2> {
    let chains: Vec<&[Linear]> = layers.iter().map(|layer| from_ref(*layer)).collect();
    side_by_side(&chains, rows, Rectified::No)
}

#[cfg(test)]
mod tests {
    use burn::tensor::{DType, TensorData};

    use super::*;
    use crate::random::Stream;
    use crate::test_support::{for_each_device, values};

    #[test]
    fn attention_over_equal_keys_has_the_entropy_of_their_number() {
        for_each_device(|device| {
            let config = MotionConfig { attention_width: 4, heads: 2, hidden: 3, ..MotionConfig::default() };
            let mut stream = Stream::new(1, 0);
            let learning = device.clone().autodiff();
            let mut init = ModuleInit { device: &learning, dtype: DType::F32, stream: &mut stream };
            let attention = TemporalAttention::new(1, &config, &mut init).valid();
            let numbers: Vec<f64> = (0..24).map(f64::from).collect();
            let centre = Tensor::<2>::from_data(TensorData::new(numbers, [2, 12]), (&device, DType::F32));
            let equal = |keys| Tokens::new(centre.clone(), centre.clone().unsqueeze_dim::<3>(1).repeat(&[1, keys, 1]));
            for keys in [1, 3] {
                let entropy = values(attention.entropy(equal(keys)).reshape([1, 1]));
                assert!((entropy[0] - (keys as f64).ln()).abs() < 1e-5, "{entropy:?}");
            }
            let apart = Tokens::new(centre.clone(), Tensor::cat(vec![equal(1).around, equal(1).around * -9.0], 1));
            assert!(values(attention.entropy(apart).reshape([1, 1]))[0] < 2f64.ln());
        });
    }
}
