//! Small MLPs over many rows, as one op: a trunk, a group of heads, an encoder.
//!
//! As separate tensor operations, a layer would pass over memory three times and keep every hidden row until the
//! backward pass. Here, a block of rows passes through all layers while it is in the cache. The backward pass
//! recomputes the hidden rows, so nothing of size `[N, width]` is kept.

pub(crate) mod cpu;
mod error;
pub(crate) mod layout;
pub(crate) mod op;

use burn::tensor::Tensor;

pub use error::MlpError;
pub use layout::MlpLayout;

/// Applies every chain of `layout` to the rows of `input`. The outputs of the chains are concatenated.
///
/// `input` is `[N, inputs]`. `parameters` `[P]` contains each chain, layer by layer: the weight `[in, out]`, row-major,
/// then the bias `[out]`. A layer is `x W + b`, with a ReLU between layers. With [`MlpLayout::rectified`], a ReLU also
/// precedes the first layer. The result is `[N, outputs]`. Both tensors have the same dtype: f32, or f64 on a CPU.
///
/// Gradients reach both tensors. The derivative of a ReLU at zero is zero.
///
/// # Errors
/// If a shape or dtype does not match, the layout has no chain or a width of zero, or a layer's rows do not fit into a
/// buffer of the device.
pub fn forward(input: Tensor<2>, parameters: Tensor<1>, layout: &MlpLayout) -> Result<Tensor<2>, MlpError> {
    error::check(&input, &parameters, layout)?;
    Ok(op::forward(input, parameters, layout))
}

#[cfg(test)]
mod tests;
