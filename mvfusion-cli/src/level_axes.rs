//! The axes of a level view of a scene.

use glam::DVec3;

/// Right, up and forward, at right angles, from sums of what cameras call down and forward. Up is against `down`, and
/// forward is where the cameras look, as far as this is level.
pub(crate) fn level_axes(down: DVec3, forward: DVec3) -> [DVec3; 3] {
    let up = (-down).try_normalize().unwrap_or(DVec3::NEG_Y);
    let level = (forward - up * forward.dot(up)).try_normalize();
    // Where cameras stand all around, or look straight up or down, any level direction will do.
    let forward = level.unwrap_or_else(|| up.any_orthonormal_vector());
    [forward.cross(up), up, forward]
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn axes_are_at_right_angles_whatever_the_cameras_do() {
        let tilted = [DVec3::new(0.1, 1.0, 0.2), DVec3::new(0.0, -0.5, 2.0)];
        for [down, forward] in [tilted, [DVec3::Y, DVec3::ZERO], [DVec3::ZERO, DVec3::Z], [DVec3::X, DVec3::X]] {
            let [right, up, ahead] = level_axes(down, forward);
            assert!(right.cross(ahead).abs_diff_eq(up, 1e-12) && up.dot(ahead).abs() < 1e-12);
            assert!([right, up, ahead].iter().all(|axis| (axis.length() - 1.0).abs() < 1e-12));
            assert!(up.dot(down) <= 0.0 && ahead.dot(forward) >= -1e-12);
        }
        assert_eq!(level_axes(DVec3::Y, DVec3::Z), [DVec3::X, DVec3::NEG_Y, DVec3::Z]);
    }
}
