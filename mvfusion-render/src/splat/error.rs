//! Errors of the splat op.

use burn::tensor::DType;
use thiserror::Error;

/// An invalid call of the splat op.
#[derive(Debug, Clone, PartialEq, Error)]
pub enum SplatError {
    /// The shape of an argument does not match the others.
    #[error("`{argument}` has shape {found:?}, expected {expected}")]
    Shape {
        /// Name of the argument.
        argument: &'static str,
        /// Its shape.
        found: Vec<usize>,
        /// Expected shape.
        expected: String,
    },
    /// The arguments differ in dtype, or the op does not support it.
    #[error("`{argument}` has dtype {found:?}, expected {expected:?} (that of `means`: F32, or F64 on a CPU)")]
    Dtype {
        /// Name of the argument.
        argument: &'static str,
        /// Its dtype.
        found: DType,
        /// Expected dtype.
        expected: DType,
    },
    /// An argument is on another device than the others.
    #[error("`{argument}` is on another device than `means`: move all arguments to one device")]
    OtherDevice {
        /// Name of the argument.
        argument: &'static str,
    },
    /// The SH degree is not supported.
    #[error("`sh_degree` is {0}, but colours are evaluated up to degree 3")]
    Degree(usize),
    /// A rule is out of its range.
    #[error("`{rule}` is {value}, expected {expected}")]
    Rule {
        /// Name of the field of [`SplatRules`](super::SplatRules).
        rule: &'static str,
        /// Its value.
        value: f64,
        /// The range.
        expected: &'static str,
    },
    /// There are more features than the device can blend at once.
    #[error(
        "{0} features are more than this device can blend: it has too little shared memory. Blend fewer at a time, or \
         use the CPU (`--device cpu`)"
    )]
    Features(usize),
    /// There are more pairs of a Gaussian and a tile than an index can count.
    #[error(
        "there are at least {0} pairs of a Gaussian and a tile, more than an index can count: use fewer Gaussians or \
         smaller images"
    )]
    Pairs(u32),
    /// Frames that are rendered together are on different devices.
    #[error("frame {0} is on another device than frame 0: render frames of one device together")]
    Devices(usize),
    /// The device failed, or was lost.
    #[error("the device failed: {0}")]
    Device(String),
    /// The camera has no pixels, or more than an index can count.
    #[error("the camera's image has {width} x {height} pixels")]
    Size {
        /// Width in pixels.
        width: usize,
        /// Height in pixels.
        height: usize,
    },
    /// A tensor does not fit into a buffer of the device.
    #[error(
        "the {tensor} would need {bytes} bytes, but the largest buffer of this device has {limit}: use fewer \
         Gaussians, smaller images or the CPU (`--device cpu`)"
    )]
    Buffer {
        /// Name of the tensor.
        tensor: &'static str,
        /// Bytes of the tensor.
        bytes: u64,
        /// Bytes of the largest buffer.
        limit: u64,
    },
}
