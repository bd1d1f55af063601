//! Attention of a few queries per row to a few keys and values of the same row, as one op.
//!
//! General attention layers are designed for long sequences. Here, every Gaussian attends to two or three frames, by
//! default at most eleven. Separate tensor operations would pass over `[N, width]` a dozen times, forward and backward,
//! for a few hundred multiplications per row.

mod cpu;
mod error;
pub(crate) mod op;

use burn::tensor::Tensor;

pub use error::AttentionError;

/// Scaled dot-product attention, `softmax(q k / sqrt(d)) v` in each head, row by row.
///
/// `queries` is `[N, queries, width]`. `memory` is `[N, keys, 2 width]`: each key is followed by its value. All queries
/// of a row share its memory. Both tensors have the same dtype, f32, or f64 on a CPU, and the same device. Head `h` of
/// the `heads` reads columns `h d .. (h + 1) d` of query, key and value, where `d = width / heads`. The result is
/// `[N, queries, width]`. Gradients reach both tensors.
///
/// # Errors
/// If a shape, dtype or device does not match, a row has no query or no key, or the heads do not divide the width.
pub fn forward(queries: Tensor<3>, memory: Tensor<3>, heads: usize) -> Result<Tensor<3>, AttentionError> {
    error::check(&queries, &memory, heads)?;
    Ok(op::forward(queries, memory, heads))
}

#[cfg(test)]
mod tests;
