//! Poses and intrinsics in the conventions of the layouts.
//!
//! Our poses map the world to the camera, in OpenCV axes. The readers contain the inverse of each function here.

use glam::{DMat3, DQuat, DVec3};

use super::depths::Depths;
use crate::readers::shared::poses::ROW;
use crate::scene::Camera;

/// Relative tolerance for the requirements of a layout. It is far below the precision of any file.
const EXACT: f64 = 1e-9;

/// The world-to-camera rotation as COLMAP writes it: a unit quaternion w, x, y, z with w not negative.
pub(super) fn quaternion(camera: &Camera) -> [f64; 4] {
    let q = DQuat::from_mat3(&camera.rotation).normalize();
    let q = if q.w < 0.0 { -q } else { q };
    [q.w, q.x, q.y, q.z]
}

/// World-to-camera pose in OpenCV axes: rows of a 4x4 matrix.
pub(super) fn world_to_camera(camera: &Camera) -> [[f64; 4]; 4] {
    affine(camera.rotation, camera.translation)
}

/// Camera-to-world pose, where the camera looks along -z with y up (OpenGL): rows of a 4x4 matrix.
pub(super) fn opengl_to_world(camera: &Camera) -> [[f64; 4]; 4] {
    let [right, down, forward] = axes(camera);
    affine(DMat3::from_cols(right, -down, -forward), camera.centre())
}

/// A row of `poses_bounds.npy`: a 3x5 matrix by rows, then the bounds. The columns of the matrix are down, right,
/// backward, the centre and (height, width, focal length).
pub(super) fn llff_row(camera: &Camera, depths: Depths) -> [f64; ROW] {
    let [right, down, forward] = axes(camera);
    let sizes = DVec3::new(camera.height as f64, camera.width as f64, camera.fx);
    let columns = [down, right, -forward, camera.centre(), sizes];
    let mut row = [0.0; ROW];
    for (place, value) in row.iter_mut().take(15).enumerate() {
        *value = columns[place % 5][place / 5];
    }
    (row[15], row[16]) = (depths.near, depths.far);
    row
}

/// The matrix from camera coordinates to homogeneous pixel coordinates, by rows.
pub(super) fn intrinsics(camera: &Camera) -> [[f64; 3]; 3] {
    [[camera.fx, 0.0, camera.cx], [0.0, camera.fy, camera.cy], [0.0, 0.0, 1.0]]
}

/// Whether pixels are square and the principal point is centred.
pub(super) fn is_plain(camera: &Camera) -> bool {
    let (width, height) = (camera.width as f64, camera.height as f64);
    let square = (camera.fx - camera.fy).abs() <= EXACT * camera.fx;
    square && (camera.cx - width / 2.0).abs() <= EXACT * width && (camera.cy - height / 2.0).abs() <= EXACT * height
}

/// Whether two cameras have the same focal length along x.
pub(super) fn same_focal(one: &Camera, other: &Camera) -> bool {
    (one.fx - other.fx).abs() <= EXACT * one.fx
}

/// The camera's right, down and forward axes in the world.
fn axes(camera: &Camera) -> [DVec3; 3] {
    [0, 1, 2].map(|row| camera.rotation.row(row))
}

fn affine(rotation: DMat3, translation: DVec3) -> [[f64; 4]; 4] {
    let row = |i: usize| {
        let r = rotation.row(i);
        [r.x, r.y, r.z, translation[i]]
    };
    [row(0), row(1), row(2), [0.0, 0.0, 0.0, 1.0]]
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::readers::shared::poses::camera_from_row;

    /// Rounding tolerance for a few products of numbers near one.
    const ROUNDING: f64 = 1e-12;

    fn camera(angle: f64) -> Camera {
        let turn = DMat3::from_axis_angle(DVec3::new(0.2, 0.9, -0.1).normalize(), angle);
        Camera::centred(160, 120, 140.0, turn, DVec3::new(1.0, -2.0, 3.0))
    }

    #[test]
    fn quaternions_have_length_one_and_no_negative_w_and_turn_as_the_camera_does() {
        for angle in [0.0, 0.7, 2.9, 3.3, 6.0] {
            let camera = camera(angle);
            let [w, x, y, z] = quaternion(&camera);
            let back = DMat3::from_quat(DQuat::from_xyzw(x, y, z, w));
            assert!(w >= 0.0 && (w * w + x * x + y * y + z * z - 1.0).abs() < ROUNDING);
            assert!((back - camera.rotation).to_cols_array().iter().all(|v| v.abs() < ROUNDING), "{angle}");
        }
    }

    #[test]
    fn numbers_that_were_worked_out_by_hand_come_out() {
        // It looks along the world's x, with right = -z and down = y: -90 degrees about y by COLMAP's formula.
        let aside = DMat3::from_cols(DVec3::NEG_Z, DVec3::Y, DVec3::X);
        let half = 0.5f64.sqrt();
        let found = quaternion(&Camera::centred(600, 400, 300.0, aside, DVec3::ZERO));
        assert!(found.iter().zip([half, 0.0, -half, 0.0]).all(|(a, b)| (a - b).abs() < ROUNDING), "{found:?}");

        // It looks along the world's -z with y up, so its axes are those of OpenGL.
        let upright = DMat3::from_cols(DVec3::X, DVec3::NEG_Y, DVec3::NEG_Z);
        let camera = Camera::centred(600, 400, 300.0, upright, DVec3::new(1.0, 2.0, 3.0));
        let (x, y, z) = ([1.0, 0.0, 0.0, 1.0], [0.0, 1.0, 0.0, 2.0], [0.0, 0.0, 1.0, 3.0]);
        assert_eq!(opengl_to_world(&camera), [x, y, z, [0.0, 0.0, 0.0, 1.0]]);
        let (x, y, z) = ([0.0, 1.0, 0.0, 1.0, 400.0], [-1.0, 0.0, 0.0, 2.0, 600.0], [0.0, 0.0, 1.0, 3.0, 300.0]);
        let row = llff_row(&camera, Depths { near: 0.1, far: 9.0 });
        assert_eq!(row.as_slice(), [x.as_slice(), &y, &z, &[0.1, 9.0]].concat());
    }

    #[test]
    fn a_row_of_llff_is_read_back_as_the_same_camera() {
        let camera = camera(0.7);
        let row = llff_row(&camera, Depths { near: 0.5, far: 9.0 });
        let back = camera_from_row(&row, 160, 120);
        assert!((back.translation - camera.translation).length() < ROUNDING && (back.fx - camera.fx).abs() < ROUNDING);
        assert!((back.rotation - camera.rotation).to_cols_array().iter().all(|v| v.abs() < ROUNDING));
        assert_eq!(row[15..], [0.5, 9.0]);
    }

    #[test]
    fn an_opengl_camera_looks_along_minus_z_with_y_up() {
        let camera = camera(1.2);
        let matrix = opengl_to_world(&camera);
        let column = |c: usize| DVec3::new(matrix[0][c], matrix[1][c], matrix[2][c]);
        assert!((column(2) + camera.forward()).length() < ROUNDING);
        assert!((column(3) - camera.centre()).length() < ROUNDING);
        let above = camera.project(camera.centre() + 2.0 * camera.forward() + 0.1 * column(1)).expect("in front");
        assert!(above.y < camera.cy && (above.x - camera.cx).abs() < 1e-9);
    }
}
