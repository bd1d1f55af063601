//! Attention of a few queries a row to the few keys and values of that row, as one op.
//!
//! General attention layers are made for long sequences. Here every Gaussian attends to two or three frames, to
//! eleven at most by default: written out as tensor operations that is a dozen passes over `[N, width]`, forward and
//! backward, for a few hundred multiplications a row.

mod cpu;
mod error;
pub(crate) mod op;

use burn::tensor::Tensor;

pub use error::AttentionError;

/// Scaled dot-product attention, `softmax(q k / sqrt(d)) v` in each head, row by row.
///
/// `queries` is `[N, queries, width]`; `memory` is `[N, keys, 2 width]`, for each row its keys and beside each key its
/// value, which all queries of the row look at. Both share one dtype, f32, or f64 on a CPU. Head `h` of the `heads`
/// reads columns `h d .. (h + 1) d` of query, key and value, where `d = width / heads`. The result is `[N, queries,
/// width]`. Gradients reach both.
///
/// # Errors
/// If a shape or dtype does not fit, there is no query or no key in a row, or the heads do not divide the width.
pub fn forward(queries: Tensor<3>, memory: Tensor<3>, heads: usize) -> Result<Tensor<3>, AttentionError> {
    error::check(&queries, &memory, heads)?;
    Ok(op::forward(queries, memory, heads))
}

#[cfg(test)]
mod tests;
