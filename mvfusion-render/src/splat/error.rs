//! What the splat op refuses.

use burn::tensor::DType;
use thiserror::Error;

/// Why a call of the splat op cannot be carried out.
#[derive(Debug, Clone, PartialEq, Error)]
pub enum SplatError {
    /// An argument has not the shape that the others ask for.
    #[error("`{argument}` has shape {found:?}, expected {expected}")]
    Shape {
        /// The argument.
        argument: &'static str,
        /// Its shape.
        found: Vec<usize>,
        /// The shape it should have.
        expected: String,
    },
    /// Arguments of different precision, or of one that the op does not know.
    #[error("`{argument}` has dtype {found:?}, expected {expected:?} (that of `means`: F32, or F64 on a CPU)")]
    Dtype {
        /// The argument.
        argument: &'static str,
        /// Its dtype.
        found: DType,
        /// The dtype it should have.
        expected: DType,
    },
    /// A degree of spherical harmonics that is not known.
    #[error("`sh_degree` is {0}, but colours are evaluated up to degree 3")]
    Degree(usize),
    /// A near plane behind the camera.
    #[error("`near` is {0}, but Gaussians behind the camera cannot be seen: it must be 0 or more")]
    Near(f64),
    /// More features than the device can blend at once.
    #[error(
        "{0} features are more than this device can blend: its units share too little memory. Blend fewer at a time, or take \
         `--device cpu`"
    )]
    Features(usize),
    /// More pairs of a Gaussian and a tile than an index counts.
    #[error(
        "there are at least {0} pairs of a Gaussian and a tile, more than an index counts: use fewer Gaussians or smaller \
         pictures"
    )]
    Pairs(u32),
    /// A camera without pixels, or with more than an index can count.
    #[error("the camera's picture has {width} x {height} pixels")]
    Size {
        /// Width in pixels.
        width: usize,
        /// Height in pixels.
        height: usize,
    },
    /// A tensor that is larger than the buffers of the device.
    #[error(
        "the {tensor} would take {bytes} bytes, but no buffer of this device holds more than {limit}: use fewer \
         Gaussians or smaller pictures, or take `--device cpu`"
    )]
    Buffer {
        /// Which.
        tensor: &'static str,
        /// Its bytes.
        bytes: u64,
        /// Those of the largest buffer.
        limit: u64,
    },
}
