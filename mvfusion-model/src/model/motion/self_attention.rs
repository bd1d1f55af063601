//! The paper's variant of MFTA with self-attention (main paper, component ablation; METHOD A28).

use burn::tensor::Tensor;

use super::TemporalAttention;
use super::attention::project;

impl TemporalAttention {
    /// Every token of a Gaussian attends to all tokens, including itself. Returns the mean of the outputs, before the
    /// MLP: `[N, S, T]` to `[N, attention width]`.
    ///
    /// # Panics
    /// Same as [`TemporalAttention::attend`].
    pub fn attend_to_all(&self, tokens: Tensor<3>) -> Tensor<2> {
        let (queries, memory) = self.projections_of_all(tokens);
        self.look(queries, memory).mean_dim(1).squeeze_dim(1)
    }

    /// The mean entropy of that attention over Gaussians, heads and tokens, in nats: `[1]`.
    ///
    /// # Panics
    /// Same as [`TemporalAttention::attend`].
    pub fn entropy_among_all(&self, tokens: Tensor<3>) -> Tensor<1> {
        let (queries, memory) = self.projections_of_all(tokens);
        self.entropy_of(queries, memory)
    }

    /// Queries `[N, S, width]`, and keys and values `[N, S, 2 width]`.
    fn projections_of_all(&self, tokens: Tensor<3>) -> (Tensor<3>, Tensor<3>) {
        let [count, length, token] = tokens.dims();
        let tokens = tokens.reshape([count * length, token]);
        let queries = project(&[&self.query], tokens.clone());
        let memory = project(&[&self.key, &self.value], tokens);
        let width = queries.dims()[1];
        (queries.reshape([count, length, width]), memory.reshape([count, length, 2 * width]))
    }
}
