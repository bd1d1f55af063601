//! HexPlane: six planes per scale, interpolated at points in space and time, and the penalties that keep them smooth.

pub(crate) mod cpu;
mod error;
mod layout;
pub(crate) mod op;
#[cfg(test)]
mod reference;
pub mod regulariser;

use burn::tensor::Tensor;

pub use error::GridError;
pub use layout::{GridBounds, GridLayout, PlaneLayout};

/// The features of `points` at `times`: the product of six bilinear samples per scale, scales concatenated (METHOD
/// §2.1).
///
/// `planes` `[cells, F]` contains all planes, channels last, in the order of [`GridLayout::planes`]. `points` `[N, 3]`
/// are world coordinates. `times` is `[N, 1]`, or `[1, 1]` for all points, and is used directly as a grid coordinate in
/// `-1..=1`. The result is `[N, scales * F]`. All three have the same dtype, f32, or f64 on a CPU, and the same device.
///
/// Coordinates are clamped to the border; NaN becomes the first cell. Gradients reach planes, points and times. The
/// gradient of a coordinate is zero on and beyond the border. At an interior node it is the slope of the right-hand
/// cell.
///
/// # Errors
/// If a shape, dtype or device does not match, the layout contains a zero, the bounds are not finite, or the result
/// does not fit into a buffer of the device.
pub fn look_up(
    planes: Tensor<2>,
    points: Tensor<2>,
    times: Tensor<2>,
    bounds: &GridBounds,
    layout: &GridLayout,
) -> Result<Tensor<2>, GridError> {
    error::check(&planes, &points, &times, bounds, layout)?;
    Ok(op::look_up(planes, points, times, bounds, layout))
}

#[cfg(test)]
mod tests;
