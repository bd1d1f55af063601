//! The losses of a step, on the device. Only reading them waits for the device.

use burn::tensor::Tensor;

/// The loss of a step.
#[derive(Clone, Debug)]
pub struct Losses {
    /// The total loss, with the graph of the backward pass: `[1]`.
    pub total: Tensor<1>,
    /// Mean squared error of the composed renders over the valid pixels, without autodiff: `[1]`.
    pub squared_error: Tensor<1>,
}

impl Losses {
    /// The same without the graph of the backward pass.
    pub fn detached(&self) -> Self {
        Self { total: self.total.clone().inner(), squared_error: self.squared_error.clone() }
    }
}
