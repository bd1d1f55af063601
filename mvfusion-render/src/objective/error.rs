//! Errors in the arguments of the op.

use burn::tensor::{DType, Tensor};
use mvfusion_kernels::splat::COLOUR_CHANNELS;
use thiserror::Error;

use super::{ObjectiveInputs, ObjectiveTerms, SLOPE_BYTES};
use crate::device::{buffer_limit, takes};

/// Planes of the packed render of the dynamic branch, and of the static branch.
pub(crate) const DYNAMIC_PLANES: usize = 8;
pub(crate) const STATIC_PLANES: usize = 5;

/// An invalid argument of [`objective`](super::objective).
#[derive(Debug, Error)]
pub enum ObjectiveError {
    /// A tensor has another shape.
    #[error("`{argument}` has shape {found:?}; expected {expected:?}")]
    Shape {
        /// Name of the argument.
        argument: &'static str,
        /// The tensor's shape.
        found: Vec<usize>,
        /// The expected one.
        expected: Vec<usize>,
    },
    /// A picture has no pixels.
    #[error("the pictures are {height} pixels high and {width} wide; expected at least one each")]
    Empty {
        /// Rows.
        height: usize,
        /// Columns.
        width: usize,
    },
    /// The scene's extent cannot divide depths.
    #[error("`extent` is {0}; expected a number above 0")]
    Extent(f64),
    /// The derivatives of SSIM do not fit into a buffer of the device.
    #[error(
        "pictures of {width} x {height} pixels need a buffer of {bytes} bytes, but the largest one of this device has \
         {limit}: use smaller pictures or a CPU"
    )]
    Buffer {
        /// Columns.
        width: usize,
        /// Rows.
        height: usize,
        /// Bytes of the derivatives.
        bytes: u64,
        /// Bytes of the largest buffer.
        limit: u64,
    },
    /// The device does not support a dtype, or the dtypes differ.
    #[error("`{argument}` has dtype {found:?}; expected f32 in all arguments, or f64 on a CPU")]
    Type {
        /// Name of the argument.
        argument: &'static str,
        /// The tensor's dtype.
        found: DType,
    },
}

/// Checks all arguments.
pub(super) fn check(inputs: &ObjectiveInputs, terms: &ObjectiveTerms) -> Result<(), ObjectiveError> {
    let [_, _, height, width] = inputs.dynamic.dims();
    if height == 0 || width == 0 {
        return Err(ObjectiveError::Empty { height, width });
    }
    if terms.extent.is_nan() || terms.extent <= 0.0 {
        return Err(ObjectiveError::Extent(terms.extent));
    }
    if let Some(limit) = buffer_limit(&inputs.dynamic.device()) {
        let bytes = (SLOPE_BYTES * height * width) as u64;
        if bytes > limit {
            return Err(ObjectiveError::Buffer { width, height, bytes, limit });
        }
    }
    let dtype = inputs.dynamic.dtype();
    check_tensor("dynamic", &inputs.dynamic, [2, DYNAMIC_PLANES, height, width], dtype)?;
    check_tensor("static", &inputs.static_, [2, STATIC_PLANES, height, width], dtype)?;
    check_tensor("photo", &inputs.photo, [COLOUR_CHANNELS, height, width], dtype)?;
    if let Some(exposure) = &inputs.exposure {
        check_tensor("exposure", exposure, [COLOUR_CHANNELS, COLOUR_CHANNELS + 1], dtype)?;
    }
    let masks = &inputs.masks;
    for (name, mask) in [("valid", &masks.valid), ("moving", &masks.moving), ("around", &masks.around)] {
        if let Some(mask) = mask {
            check_tensor(name, mask, [1, height, width], dtype)?;
        }
    }
    Ok(())
}

fn check_tensor<const D: usize>(
    argument: &'static str,
    tensor: &Tensor<D>,
    expected: [usize; D],
    dtype: DType,
) -> Result<(), ObjectiveError> {
    let found = tensor.dims();
    if found != expected {
        return Err(ObjectiveError::Shape { argument, found: found.to_vec(), expected: expected.to_vec() });
    }
    if tensor.dtype() != dtype || !takes(&tensor.device(), dtype) {
        return Err(ObjectiveError::Type { argument, found: tensor.dtype() });
    }
    Ok(())
}
