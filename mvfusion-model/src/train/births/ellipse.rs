//! The ellipse of a cluster of pixels.

use glam::{DMat2, DMat3, DQuat, DVec2, Vec3};
use mvfusion_data::Camera;

use super::clusters::ErrorPixel;

/// Variance of the position within a pixel, in square pixels. A single pixel has this variance.
const OF_A_PIXEL: f64 = 1.0 / 12.0;

/// Position, shape and colour of a cluster.
#[derive(Clone, Debug, PartialEq)]
pub struct Ellipse {
    /// Its centre in pixels.
    pub centre: DVec2,
    /// Standard deviations along the longer and the shorter axis, in pixels.
    pub deviations: [f64; 2],
    /// Angle from the image's x axis to the longer axis, in radians.
    pub angle: f64,
    /// Mean colour.
    pub colour: Vec3,
    /// Indices of the pixels.
    pub pixels: Vec<usize>,
}

impl Ellipse {
    /// The ellipse of the given pixels; `None` without pixels.
    pub(super) fn of(pixels: &[ErrorPixel]) -> Option<Self> {
        let share = 1.0 / pixels.len() as f64;
        if !share.is_finite() {
            return None;
        }
        let centre = pixels.iter().map(|pixel| pixel.position).sum::<DVec2>() * share;
        let colour = pixels.iter().map(|pixel| pixel.colour).sum::<Vec3>() * share as f32;
        let spread = |pixel: &ErrorPixel| {
            let away = pixel.position - centre;
            DMat2::from_cols(away * away.x, away * away.y)
        };
        let covariance = pixels.iter().map(spread).sum::<DMat2>() * share;
        let (xx, xy, yy) = (covariance.x_axis.x + OF_A_PIXEL, covariance.x_axis.y, covariance.y_axis.y + OF_A_PIXEL);
        let (mean, half) = ((xx + yy) / 2.0, ((xx - yy) / 2.0).hypot(xy));
        let deviations = [mean + half, (mean - half).max(OF_A_PIXEL)].map(f64::sqrt);
        let angle = 0.5 * (2.0 * xy).atan2(xx - yy);
        let pixels = pixels.iter().map(|pixel| pixel.index).collect();
        Some(Self { centre, deviations, angle, colour, pixels })
    }

    /// Quaternion w, x, y, z in world coordinates that aligns a Gaussian's first axis with the longer axis, and its
    /// third axis with the viewing direction.
    pub(super) fn rotation(&self, camera: &Camera) -> [f32; 4] {
        let in_camera = DMat3::from_rotation_z(self.angle);
        let turn = DQuat::from_mat3(&(camera.rotation.transpose() * in_camera)).as_quat();
        [turn.w, turn.x, turn.y, turn.z]
    }
}
