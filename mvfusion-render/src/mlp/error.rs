//! Errors in the arguments of the op.

use burn::tensor::{DType, Tensor};

use super::MlpLayout;
use crate::device::{buffer_limit, takes};

/// An invalid argument of [`forward`](super::forward).
#[derive(Debug, thiserror::Error)]
pub enum MlpError {
    /// The shape of a tensor does not match the layout.
    #[error("`{argument}` has shape {found:?}; expected {expected}")]
    Shape {
        /// Name of the argument.
        argument: &'static str,
        /// Its shape.
        found: Vec<usize>,
        /// The shape in words.
        expected: String,
    },
    /// The device does not support a dtype, or the two dtypes differ.
    #[error(
        "`input` has dtype {input:?} and `parameters` has dtype {parameters:?}; expected f32 in both, or f64 on a CPU"
    )]
    Type {
        /// Dtype of the input.
        input: DType,
        /// Dtype of the parameters.
        parameters: DType,
    },
    /// The rows of the widest layer do not fit into a buffer of the device.
    #[error(
        "{rows} rows of {width} values need {bytes} bytes, but the largest buffer of this device has {limit}: use \
         fewer Gaussians or `--device cpu`"
    )]
    Buffer {
        /// Rows of the input.
        rows: usize,
        /// Width of the widest layer.
        width: usize,
        /// Bytes of these rows.
        bytes: u64,
        /// Bytes of the largest buffer.
        limit: u64,
    },
    /// The layout has no chains, a chain without layers, or a width of zero.
    #[error("the layout {0:?} is empty: it needs at least one chain, and every width must be positive")]
    Layout(MlpLayout),
}

/// Checks all arguments of [`forward`](super::forward).
pub(super) fn check(input: &Tensor<2>, parameters: &Tensor<1>, layout: &MlpLayout) -> Result<(), MlpError> {
    let empty = |widths: &Vec<usize>| widths.is_empty() || widths.contains(&0);
    if layout.inputs == 0 || layout.chains.is_empty() || layout.chains.iter().any(empty) {
        return Err(MlpError::Layout(layout.clone()));
    }
    if input.dims()[1] != layout.inputs {
        let expected = format!("[N, {}]", layout.inputs);
        return Err(MlpError::Shape { argument: "input", found: input.dims().to_vec(), expected });
    }
    if parameters.dims() != [layout.parameters()] {
        let expected = format!("[{}]", layout.parameters());
        return Err(MlpError::Shape { argument: "parameters", found: parameters.dims().to_vec(), expected });
    }
    match (input.dtype(), parameters.dtype()) {
        (own, other) if own == other && takes(&input.device(), own) => {}
        (input, parameters) => return Err(MlpError::Type { input, parameters }),
    }
    let rows = input.dims()[0];
    let width = layout.chains.iter().flatten().copied().chain([layout.inputs, layout.outputs()]).max().unwrap_or(0);
    let bytes = 4 * (rows * width) as u64;
    match buffer_limit(&input.device()) {
        Some(limit) if bytes > limit => Err(MlpError::Buffer { rows, width, bytes, limit }),
        _ => Ok(()),
    }
}
