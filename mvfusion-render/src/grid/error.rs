//! Errors in the arguments of the grid functions.

use burn::tensor::{DType, Tensor};

use super::{GridBounds, GridLayout};
use crate::device::{buffer_limit, takes};

/// An invalid argument of a grid function.
#[derive(Debug, thiserror::Error)]
pub enum GridError {
    /// The shape of a tensor does not match the layout.
    #[error("`{argument}` has shape {found:?}; expected {expected}")]
    Shape {
        /// Name of the argument.
        argument: &'static str,
        /// Its shape.
        found: [usize; 2],
        /// The shape in words.
        expected: String,
    },
    /// The dtype of a tensor differs from the planes', or the device does not support it.
    #[error("`{argument}` has dtype {found:?}; expected f32, or f64 on a CPU, the same in all arguments")]
    Type {
        /// Name of the argument.
        argument: &'static str,
        /// Its dtype.
        found: DType,
    },
    /// A tensor is on another device than the planes.
    #[error("`{argument}` is on another device than `planes`: move all arguments to one device")]
    OtherDevice {
        /// Name of the argument.
        argument: &'static str,
    },
    /// The features, or the gradients of the places at every scale, do not fit into a buffer of the device.
    #[error(
        "{points} points with {features} features need {bytes} bytes, but the largest buffer of this device has \
         {limit}: use fewer Gaussians or the CPU (`--device cpu`)"
    )]
    Buffer {
        /// Number of points.
        points: usize,
        /// Features per point.
        features: usize,
        /// Bytes of the larger of both.
        bytes: u64,
        /// Bytes of the largest buffer.
        limit: u64,
    },
    /// The layout has no features, no cells or no scales.
    #[error("the grid layout {0:?} is empty: features, resolution and multipliers must be positive")]
    Layout(GridLayout),
    /// The bounds are not finite.
    #[error("the grid bounds {0:?} are not finite")]
    Bounds(GridBounds),
}

/// Checks all arguments of [`look_up`](super::look_up).
pub(super) fn check(
    planes: &Tensor<2>,
    points: &Tensor<2>,
    times: &Tensor<2>,
    bounds: &GridBounds,
    layout: &GridLayout,
) -> Result<(), GridError> {
    check_planes(planes, layout)?;
    let count = points.dims()[0];
    let shape = |argument, found, fits: bool, expected: &str| match fits {
        true => Ok(()),
        false => Err(GridError::Shape { argument, found, expected: expected.to_owned() }),
    };
    shape("points", points.dims(), points.dims()[1] == 3, "[N, 3]")?;
    let of_points = times.dims() == [count, 1] || times.dims() == [1, 1];
    shape("times", times.dims(), of_points, &format!("[{count}, 1] or [1, 1]"))?;
    for (argument, tensor) in [("points", points), ("times", times)] {
        if tensor.dtype() != planes.dtype() {
            return Err(GridError::Type { argument, found: tensor.dtype() });
        }
        // Devices are equal with and without autodiff.
        if tensor.device() != planes.device() {
            return Err(GridError::OtherDevice { argument });
        }
    }
    let features = layout.features * layout.multipliers.len();
    let bytes = buffer_bytes(count, layout);
    if let Some(limit) = buffer_limit(&planes.device()).filter(|&limit| bytes > limit) {
        return Err(GridError::Buffer { points: count, features, bytes, limit });
    }
    match bounds.max.iter().chain(&bounds.min).all(|corner| corner.is_finite()) {
        true => Ok(()),
        false => Err(GridError::Bounds(*bounds)),
    }
}

/// Bytes of the largest buffer for `count` points. For each scale, the forward pass has the features of a point, the
/// backward pass the gradients of its four coordinates.
fn buffer_bytes(count: usize, layout: &GridLayout) -> u64 {
    const COORDINATES: usize = 4;
    let columns = layout.features.max(COORDINATES) * layout.multipliers.len();
    size_of::<f32>() as u64 * count as u64 * columns as u64
}

/// Checks only the planes.
pub(super) fn check_planes(planes: &Tensor<2>, layout: &GridLayout) -> Result<(), GridError> {
    let sizes = layout.resolution.iter().chain(&layout.multipliers);
    if layout.features == 0 || layout.multipliers.is_empty() || sizes.into_iter().any(|&size| size == 0) {
        return Err(GridError::Layout(layout.clone()));
    }
    let expected = [layout.cells(), layout.features];
    if planes.dims() != expected {
        let expected = format!("{expected:?}");
        return Err(GridError::Shape { argument: "planes", found: planes.dims(), expected });
    }
    match planes.dtype() {
        found if takes(&planes.device(), found) => Ok(()),
        found => Err(GridError::Type { argument: "planes", found }),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_buffer_holds_the_features_and_the_gradients_of_the_places() {
        let layout = |features| GridLayout { features, resolution: [2; 4], multipliers: vec![1, 2, 4] };
        // With few features, the backward pass needs more: 16 bytes for each point and scale.
        assert_eq!([1, 4, 16].map(|features| buffer_bytes(1000, &layout(features))), [48_000, 48_000, 192_000]);
    }
}
