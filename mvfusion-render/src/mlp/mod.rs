//! Small perceptrons over many rows, as one op: a trunk, a bundle of heads, an encoder.
//!
//! Written out as tensor operations, a layer passes over memory three times and keeps every hidden row until the
//! backward pass. Here a block of rows goes through all layers while it is in the cache, and the backward pass computes
//! the hidden rows again: nothing of the size `[N, width]` is kept.

pub(crate) mod cpu;
mod error;
pub(crate) mod layout;
pub(crate) mod op;

use burn::tensor::Tensor;

pub use error::MlpError;
pub use layout::MlpLayout;

/// What every chain of `layout` makes of the rows of `input`, chains side by side.
///
/// `input` is `[N, inputs]`; `parameters` `[P]` holds for each chain, layer by layer, the weight `[in, out]` row-major
/// and then the bias `[out]`. A layer is `x W + b`, with a ReLU between each two; [`MlpLayout::rectified`] says whether
/// one precedes the first. The result is `[N, outputs]`. Both tensors share one dtype, f32, or f64 on a CPU.
///
/// Gradients reach both. The slope of a ReLU at zero is zero.
///
/// # Errors
/// If a shape or dtype does not fit, a layout has no chain or a width of zero, or a layer's rows are more than a buffer of
/// the device holds.
pub fn forward(input: Tensor<2>, parameters: Tensor<1>, layout: &MlpLayout) -> Result<Tensor<2>, MlpError> {
    error::check(&input, &parameters, layout)?;
    Ok(op::forward(input, parameters, layout))
}

#[cfg(test)]
mod tests;
