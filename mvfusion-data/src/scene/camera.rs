//! A pinhole camera: its pose and its projection.

use glam::{DMat3, DVec2, DVec3};
use serde::{Deserialize, Serialize};

use super::limits::LARGEST_COORDINATE;

/// Smallest and largest focal length in sides of the image: fields of view of 179.99 degrees and of 20 arc seconds.
const LEAST_FOCAL: f64 = 1e-4;
const MOST_FOCAL: f64 = 1e4;

/// Largest distance of the principal point from the image's corner, in sides of the image.
const MOST_SHIFT: f64 = 100.0;

/// A pinhole camera with its pose, in OpenCV axes: x right, y down, z forward.
///
/// A world point `x` has camera coordinates `rotation * x + translation`. A camera point `(x, y, z)` projects to the
/// pixel position `(fx x / z + cx, fy y / z + cy)`. The centre of the first pixel is at `(0.5, 0.5)`. All numbers are
/// `f64`, because the finite-difference checks run entirely in `f64`.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Camera {
    /// Width of the image in pixels.
    pub width: usize,
    /// Height of the image in pixels.
    pub height: usize,
    /// Focal length along x, in pixels.
    pub fx: f64,
    /// Focal length along y, in pixels.
    pub fy: f64,
    /// Principal point along x, in pixels.
    pub cx: f64,
    /// Principal point along y, in pixels.
    pub cy: f64,
    /// Rotation from world to camera.
    pub rotation: DMat3,
    /// Translation from world to camera.
    pub translation: DVec3,
}

impl Camera {
    /// A camera at `centre` in the world, with square pixels and a centred principal point. The columns of the
    /// camera-to-world rotation are right, down, forward.
    pub fn centred(width: usize, height: usize, focal: f64, camera_to_world: DMat3, centre: DVec3) -> Self {
        let rotation = camera_to_world.transpose();
        Self {
            width,
            height,
            fx: focal,
            fy: focal,
            cx: width as f64 / 2.0,
            cy: height as f64 / 2.0,
            rotation,
            translation: -(rotation * centre),
        }
    }

    /// The camera's centre in the world.
    pub fn centre(&self) -> DVec3 {
        -(self.rotation.transpose() * self.translation)
    }

    /// The viewing direction in the world, a unit vector.
    pub fn forward(&self) -> DVec3 {
        self.rotation.row(2)
    }

    /// Camera coordinates of a world point.
    pub fn to_camera(&self, point: DVec3) -> DVec3 {
        self.rotation * point + self.translation
    }

    /// Pixel position of a world point, or `None` if it is behind the camera.
    pub fn project(&self, point: DVec3) -> Option<DVec2> {
        let p = self.to_camera(point);
        (p.z > 0.0).then(|| DVec2::new(self.fx * p.x / p.z + self.cx, self.fy * p.y / p.z + self.cy))
    }

    /// Field of view along x and y, in radians. Valid if the principal point is centred.
    pub fn field_of_view(&self) -> DVec2 {
        let half = |pixels: usize, focal: f64| 2.0 * (pixels as f64 / (2.0 * focal)).atan();
        DVec2::new(half(self.width, self.fx), half(self.height, self.fy))
    }

    /// Whether training can compute with the camera in single precision. Focal lengths and the principal point must be
    /// in proportion to the image, and the centre within [`LARGEST_COORDINATE`].
    pub fn is_computable(&self) -> bool {
        let side = self.width.max(self.height) as f64;
        let within = |value: f64, least: f64, most: f64| least * side <= value && value <= most * side;
        let is_place = |place: DVec3| place.abs().max_element() <= LARGEST_COORDINATE && place.is_finite();
        [self.fx, self.fy].iter().all(|&focal| within(focal, LEAST_FOCAL, MOST_FOCAL))
            && [self.cx, self.cy].iter().all(|&place| within(place, -MOST_SHIFT, MOST_SHIFT))
            && self.rotation.is_finite()
            && is_place(self.translation)
            && is_place(self.centre())
    }

    /// The same camera for the image resized to `width` by `height`.
    pub fn resized(&self, width: usize, height: usize) -> Self {
        let (sx, sy) = (width as f64 / self.width as f64, height as f64 / self.height as f64);
        Self { width, height, fx: self.fx * sx, fy: self.fy * sy, cx: self.cx * sx, cy: self.cy * sy, ..*self }
    }

    /// The same camera for another aspect ratio. Only the horizontal field of view changes.
    pub fn reframed(&self, width: usize, height: usize) -> Self {
        let scale = height as f64 / self.height as f64;
        let cx = (self.cx - self.width as f64 / 2.0) * scale + width as f64 / 2.0;
        Self { width, height, fx: self.fx * scale, fy: self.fy * scale, cx, cy: self.cy * scale, ..*self }
    }
}

/// The point with the least sum of squared distances to the optical axes. `None` if the axes do not meet, that is, if
/// the determinant of the mean normal equations is not above `least`. The determinant is 0 for parallel axes and at
/// most 8/27.
pub(crate) fn nearest_to_axes(cameras: &[&Camera], least: f64) -> Option<DVec3> {
    let (mut normal, mut right) = (DMat3::ZERO, DVec3::ZERO);
    for camera in cameras {
        let axis = camera.forward();
        // Projects a vector onto the plane across the axis.
        let across = DMat3::IDENTITY - DMat3::from_cols(axis * axis.x, axis * axis.y, axis * axis.z);
        normal += across;
        right += across * camera.centre();
    }
    let share = (cameras.len().max(1) as f64).recip();
    let (normal, right) = (normal * share, right * share);
    (normal.determinant() > least).then(|| normal.inverse() * right)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn camera() -> Camera {
        let turn = DMat3::from_axis_angle(DVec3::new(0.2, 0.9, -0.1).normalize(), 0.7);
        Camera::centred(160, 120, 140.0, turn, DVec3::new(1.0, -2.0, 3.0))
    }

    #[test]
    fn the_centre_is_where_the_camera_was_put() {
        assert!((camera().centre() - DVec3::new(1.0, -2.0, 3.0)).length() < 1e-12);
    }

    #[test]
    fn a_point_straight_ahead_falls_on_the_principal_point() {
        let c = camera();
        let pixel = c.project(c.centre() + 2.0 * c.forward()).expect("in front");
        assert!((pixel - DVec2::new(80.0, 60.0)).length() < 1e-9);
        assert_eq!(c.project(c.centre() - c.forward()), None);
    }

    #[test]
    fn resizing_scales_pixel_positions() {
        let c = camera();
        let p = c.centre() + c.rotation.transpose() * DVec3::new(0.3, -0.2, 2.0);
        let (full, half) = (c.project(p).expect("in front"), c.resized(80, 60).project(p).expect("in front"));
        assert!((full * 0.5 - half).length() < 1e-9);
    }

    #[test]
    fn cameras_whose_numbers_overflow_or_make_no_sense_are_told() {
        assert!(camera().is_computable());
        let far = |x: f64| Camera::centred(160, 120, 140.0, DMat3::IDENTITY, DVec3::new(x, 0.0, 0.0));
        assert!(far(1e9).is_computable());
        for bad in [
            far(1.1e9),
            far(1e300),
            far(f64::NAN),
            Camera { cx: 1e9, ..camera() },
            Camera { cy: f64::NAN, ..camera() },
            Camera { fx: 1e9, ..camera() },
            Camera { fy: 1e-9, ..camera() },
            Camera { fy: -140.0, ..camera() },
        ] {
            assert!(!bad.is_computable(), "{bad:?}");
        }
    }

    #[test]
    fn another_format_shows_the_same_from_top_to_bottom() {
        let c = Camera { cx: 90.0, ..camera() };
        let wide = c.reframed(480, 240);
        let p = c.centre() + c.rotation.transpose() * DVec3::new(0.3, -0.2, 2.0);
        let (old, new) = (c.project(p).expect("in front"), wide.project(p).expect("in front"));
        // Twice the size, and half of the 160 additional pixels on the left.
        assert!((new - (2.0 * old + DVec2::new(80.0, 0.0))).length() < 1e-9);
    }
}
