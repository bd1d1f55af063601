//! What can be wrong with the arguments of the op.

use burn::tensor::{DType, Tensor};

use super::MlpLayout;
use crate::device::{buffer_limit, takes};

/// An argument of [`forward`](super::forward) that does not fit.
#[derive(Debug, thiserror::Error)]
pub enum MlpError {
    /// A tensor has another shape than the layout asks for.
    #[error("`{argument}` has shape {found:?}; expected {expected}")]
    Shape {
        /// The argument's name.
        argument: &'static str,
        /// Its shape.
        found: Vec<usize>,
        /// The shape in words.
        expected: String,
    },
    /// A tensor's numbers are of a type that the device does not take, or the two tensors differ.
    #[error("`input` holds {input:?} and `parameters` holds {parameters:?}; expected f32 in both, or f64 on a CPU")]
    Type {
        /// Type of the input.
        input: DType,
        /// Type of the parameters.
        parameters: DType,
    },
    /// Rows that are more than a buffer of the device holds, at the widest layer.
    #[error(
        "{rows} rows of {width} numbers take {bytes} bytes, but no buffer of this device holds more than {limit}: use fewer \
         Gaussians, or take `--device cpu`"
    )]
    Buffer {
        /// Rows of the input.
        rows: usize,
        /// The largest width of a layer.
        width: usize,
        /// Bytes of these numbers.
        bytes: u64,
        /// Those of the largest buffer.
        limit: u64,
    },
    /// A layout without a chain, or with a chain without layers, or with a width of zero.
    #[error("the layout {0:?} is empty: there must be a chain, and every width must be positive")]
    Layout(MlpLayout),
}

/// Checks everything that [`forward`](super::forward) takes.
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
