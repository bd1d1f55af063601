//! Cameras at new poses.

use glam::{DMat3, DVec3};

use crate::scene::Camera;

/// The axes of a camera that looks along `forward`, with `down` pointing as far downwards as possible. The columns are
/// right, down, forward. `None` if the two vectors are parallel or one is zero.
pub(super) fn axes(forward: DVec3, down: DVec3) -> Option<DMat3> {
    let forward = forward.try_normalize()?;
    let right = down.cross(forward).try_normalize()?;
    Some(DMat3::from_cols(right, forward.cross(right), forward))
}

/// A copy of a camera at another pose. The columns of `axes` are right, down, forward.
pub(super) fn placed(like: &Camera, axes: DMat3, centre: DVec3) -> Camera {
    let rotation = axes.transpose();
    Camera { rotation, translation: -(rotation * centre), ..*like }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn axes_are_orthonormal_and_turn_right_handed() {
        let axes = axes(DVec3::new(0.3, -2.0, 0.5), DVec3::new(0.1, 0.2, 3.0)).expect("axes");
        let off = axes * axes.transpose() - DMat3::IDENTITY;
        assert!(off.to_cols_array().iter().all(|v| v.abs() < 1e-14) && axes.determinant() > 0.0);
        assert!(axes.y_axis.dot(DVec3::Z) > 0.9, "down was to be along z");
        assert_eq!(super::axes(DVec3::Z, 2.0 * DVec3::Z), None);
    }
}
