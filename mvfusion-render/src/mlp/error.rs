//! Errors in the arguments of the op.

use burn::tensor::{DType, Tensor};

use super::layout::LinearLayout;
use super::{Layer, MAX_LAYERS, MlpLayout};
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
    /// The device does not support a dtype, or two dtypes differ.
    #[error(
        "`input` has dtype {input:?} and a parameter has dtype {parameter:?}; expected f32 in both, or f64 on a CPU"
    )]
    Type {
        /// Dtype of the input.
        input: DType,
        /// Dtype of a parameter.
        parameter: DType,
    },
    /// A parameter is on another device than the input.
    #[error("`{argument}` is on another device than `input`: move all arguments to one device")]
    OtherDevice {
        /// Name of the argument.
        argument: &'static str,
    },
    /// The rows of the widest layer do not fit into a buffer of the device.
    #[error(
        "{rows} rows of {width} values need {bytes} bytes, but the largest buffer of this device has {limit}: use \
         fewer Gaussians or the CPU (`--device cpu`)"
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
    /// The number of layers does not match the layout, or there are too many of them.
    #[error("`layers` has {found} layers; expected {expected}, and {MAX_LAYERS} at most")]
    Layers {
        /// Number of layers.
        found: usize,
        /// Number of layers in the layout.
        expected: usize,
    },
    /// The layout has no chains, a chain without layers, or a width of zero.
    #[error("the layout {0:?} is empty: it needs at least one chain, and every width must be positive")]
    Layout(MlpLayout),
}

/// Checks all arguments of [`forward`](super::forward).
pub(super) fn check(input: &Tensor<2>, layers: &[Layer], layout: &MlpLayout) -> Result<(), MlpError> {
    let empty = |widths: &Vec<usize>| widths.is_empty() || widths.contains(&0);
    if layout.inputs == 0 || layout.chains.is_empty() || layout.chains.iter().any(empty) {
        return Err(MlpError::Layout(layout.clone()));
    }
    let wanted: Vec<LinearLayout> = layout.layers().into_iter().flatten().collect();
    if layers.len() != wanted.len() || layers.len() > MAX_LAYERS {
        return Err(MlpError::Layers { found: layers.len(), expected: wanted.len() });
    }
    let misfit =
        |argument, found: &[usize], expected| Err(MlpError::Shape { argument, found: found.to_vec(), expected });
    if input.dims()[1] != layout.inputs {
        return misfit("input", &input.dims(), format!("[N, {}]", layout.inputs));
    }
    let device = input.device();
    let taken = takes(&device, input.dtype());
    for (Layer { weight, bias }, &LinearLayout { inputs, outputs, .. }) in layers.iter().zip(&wanted) {
        if weight.dims() != [inputs, outputs] {
            return misfit("weight", &weight.dims(), format!("[{inputs}, {outputs}]"));
        }
        if bias.dims() != [outputs] {
            return misfit("bias", &bias.dims(), format!("[{outputs}]"));
        }
        let dtypes = [weight.dtype(), bias.dtype()];
        if let Some(parameter) = dtypes.into_iter().find(|&parameter| !taken || parameter != input.dtype()) {
            return Err(MlpError::Type { input: input.dtype(), parameter });
        }
        // Devices are equal with and without autodiff.
        for (argument, other) in [("weight", weight.device()), ("bias", bias.device())] {
            if other != device {
                return Err(MlpError::OtherDevice { argument });
            }
        }
    }
    let rows = input.dims()[0];
    let width = layout.chains.iter().flatten().copied().chain([layout.inputs, layout.outputs()]).max().unwrap_or(0);
    let bytes = 4 * (rows * width) as u64;
    match buffer_limit(&device) {
        Some(limit) if bytes > limit => Err(MlpError::Buffer { rows, width, bytes, limit }),
        _ => Ok(()),
    }
}
