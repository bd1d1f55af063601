//! The check of cameras that are to be rendered.

use thiserror::Error;

use crate::scene::{Camera, LARGEST_COORDINATE};

/// Longest side of an image, pixels.
pub const LONGEST_SIDE: usize = 16_384;

/// The reason why a camera cannot be rendered: a clause about the camera, with the bounds.
#[derive(Clone, Copy, Debug, Error, PartialEq)]
pub enum CameraError {
    /// The image has no pixel, or a side that is too long.
    #[error("its image has {width} x {height} pixels, and a side has 1 to {LONGEST_SIDE}")]
    Size {
        /// Width of the image in pixels.
        width: usize,
        /// Height of the image in pixels.
        height: usize,
    },
    /// A focal length is not a positive number.
    #[error("its focal lengths are {fx} and {fy} pixels, and both must be above zero")]
    Focal {
        /// Focal length along x, in pixels.
        fx: f64,
        /// Focal length along y, in pixels.
        fy: f64,
    },
    /// Rendering cannot compute with the numbers: see [`Camera::is_computable`].
    #[error(
        "its position {position:?}, its focal lengths {fx:?} and {fy:?} and its principal point ({cx:?}, {cy:?}) are \
         too large or too small to compute with; coordinates go up to {most:e}",
        most = LARGEST_COORDINATE
    )]
    Range {
        /// The camera's centre in the world.
        position: [f64; 3],
        /// Focal length along x, in pixels.
        fx: f64,
        /// Focal length along y, in pixels.
        fy: f64,
        /// Principal point along x, in pixels.
        cx: f64,
        /// Principal point along y, in pixels.
        cy: f64,
    },
}

/// Whether a camera can be rendered.
///
/// # Errors
/// [`CameraError`] if its image, its focal lengths or its position are out of bounds, with the bounds.
pub fn check_camera(camera: &Camera) -> Result<(), CameraError> {
    let Camera { width, height, fx, fy, cx, cy, .. } = *camera;
    if width == 0 || height == 0 || width.max(height) > LONGEST_SIDE {
        return Err(CameraError::Size { width, height });
    }
    if ![fx, fy].iter().all(|focal| focal.is_finite() && *focal > 0.0) {
        return Err(CameraError::Focal { fx, fy });
    }
    if !camera.is_computable() {
        return Err(CameraError::Range { position: camera.centre().to_array(), fx, fy, cx, cy });
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use glam::{DMat3, DVec3};

    use super::*;

    #[test]
    fn what_keeps_a_camera_from_being_rendered_is_told_with_the_bounds() {
        let camera = Camera::centred(64, 48, 60.0, DMat3::IDENTITY, DVec3::ZERO);
        assert_eq!(check_camera(&camera), Ok(()));
        assert_eq!(check_camera(&Camera { width: 0, ..camera }), Err(CameraError::Size { width: 0, height: 48 }));
        assert_eq!(check_camera(&Camera { fy: -1.0, ..camera }), Err(CameraError::Focal { fx: 60.0, fy: -1.0 }));
        let far = check_camera(&Camera { cx: 1e9, ..camera }).expect_err("refused");
        assert!(matches!(far, CameraError::Range { cx: 1e9, .. }), "{far}");
        assert!(far.to_string().contains("go up to 1e9"), "{far}");
    }
}
