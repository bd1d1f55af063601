//! HexPlane: six planes per scale, looked up at points in space and time, and the penalties that keep them smooth.

pub(crate) mod cpu;
mod error;
mod layout;
pub(crate) mod op;
pub mod reference;
pub mod regulariser;

use burn::tensor::Tensor;

pub use error::GridError;
pub use layout::{GridBounds, GridLayout, PlaneLayout};

/// The features of `points` at `times`: per scale the product of six bilinear samples, scales one after another
/// (METHOD §2.1).
///
/// `planes` `[cells, F]` holds every plane, channels last, as [`GridLayout::planes`] says; `points` `[N, 3]` are world
/// coordinates; `times` is `[N, 1]`, or `[1, 1]` for all points, and used raw as a grid coordinate of `-1..=1`. The
/// result is `[N, scales * F]`. All three share one dtype, f32, or f64 on a CPU.
///
/// A coordinate beyond the border counts as on it. Gradients reach planes, points and times; the one with respect to a
/// coordinate is zero on and beyond the border, and on an interior node it is the slope of the right-hand cell. A
/// coordinate that is NaN looks up the first cell.
///
/// # Errors
/// If a shape or dtype does not fit, the layout has a zero in it, the bounds are not finite, or the result is larger than a
/// buffer of the device.
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
