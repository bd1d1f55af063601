//! Small MLPs over many rows, as one op: a trunk, a group of heads, an encoder.
//!
//! As separate tensor operations, a layer would pass over memory three times and keep every hidden row until the
//! backward pass. Here, a block of rows passes through all layers while it is in the cache. The backward pass
//! recomputes the hidden rows, so that nothing of size `[N, width]` is kept, except that a GPU keeps up to 512 MiB of them
//! in a call.

pub(crate) mod cpu;
mod error;
pub(crate) mod layout;
pub(crate) mod op;

use std::ops::Range;

use burn::tensor::Tensor;

pub use error::MlpError;
pub use layout::MlpLayout;

/// Most layers of a group of MLPs, all chains together.
pub const MAX_LAYERS: usize = 64;

/// The parameters of a linear layer.
#[derive(Clone, Debug)]
pub struct Layer {
    /// Weight, `[in, out]`.
    pub weight: Tensor<2>,
    /// Bias, `[out]`.
    pub bias: Tensor<1>,
}

/// Applies every chain of `layout` to the rows of `input`. The outputs of the chains are concatenated.
///
/// `input` is `[N, inputs]`. `layers` contains the layers of each chain, first to last. A layer is `x W + b`, with a ReLU
/// between layers. With [`MlpLayout::rectified`], a ReLU also precedes the first layer. The result is `[N, outputs]`. All
/// tensors have the same dtype, f32, or f64 on a CPU, and the same device.
///
/// Gradients reach the input and every parameter. The derivative of a ReLU at zero is zero.
///
/// # Errors
/// If a shape, dtype or device does not match, the layout has no chain, a width of zero or more than [`MAX_LAYERS`], or
/// a layer's rows do not fit into a buffer of the device.
pub fn forward(input: Tensor<2>, layers: Vec<Layer>, layout: &MlpLayout) -> Result<Tensor<2>, MlpError> {
    error::check(&input, &layers, layout)?;
    Ok(op::forward(input, layers, layout))
}

impl Layer {
    /// The layers whose parameters are joined in one tensor, `[P]`: chain by chain, and layer by layer, the weight
    /// row-major, then the bias.
    ///
    /// # Panics
    /// If there are fewer parameters than the layers have.
    pub fn all_of(parameters: &Tensor<1>, layout: &MlpLayout) -> Vec<Self> {
        let part = |range: Range<usize>| parameters.clone().narrow(0, range.start, range.len());
        let layers = layout.layers().into_iter().flatten();
        let layers = layers.map(|layer| Self {
            weight: part(layer.weight).reshape([layer.inputs, layer.outputs]),
            bias: part(layer.bias),
        });
        layers.collect()
    }
}

#[cfg(test)]
mod tests;
