//! The axes of glTF: right-handed, y up, cameras that look along -z.

use glam::{DMat3, DQuat, DVec3};
use mvfusion_data::{Camera, Scene};

use crate::level_axes::level_axes;

/// The rotation from the scene's world to the axes of glTF. Up is the mean of what the training cameras call up, and -z
/// is where they look on average, as far as this is level.
pub fn to_gltf(scene: &Scene) -> DMat3 {
    // The rows of a camera's rotation are right, down and forward in the world.
    let sum = |row: usize| scene.train.iter().map(|view| view.camera.rotation.row(row)).sum::<DVec3>();
    let [right, up, forward] = level_axes(sum(1), sum(2));
    DMat3::from_cols(right, up, -forward).transpose()
}

/// The pose of a camera as a node of glTF: translation, and rotation x, y, z, w.
pub fn camera_pose(camera: &Camera, to_gltf: DMat3) -> (DVec3, [f64; 4]) {
    let to_world = camera.rotation.transpose();
    let axes = to_gltf * DMat3::from_cols(to_world.x_axis, -to_world.y_axis, -to_world.z_axis);
    (to_gltf * camera.centre(), DQuat::from_mat3(&axes).normalize().to_array())
}

#[cfg(test)]
mod tests {
    use mvfusion_data::{BuiltinKind, BuiltinOptions, builtin};

    use super::*;

    fn scene() -> Scene {
        builtin::builtin(&BuiltinOptions { width: 48, height: 36, ..BuiltinOptions::of_kind(BuiltinKind::Video) })
    }

    #[test]
    fn what_cameras_call_up_is_y_and_they_look_along_minus_z() {
        let scene = scene();
        let turn = to_gltf(&scene);
        assert!((turn.determinant() - 1.0).abs() < 1e-12 && turn.transpose().abs_diff_eq(turn.inverse(), 1e-12));
        let mean = |row: usize| scene.train.iter().map(|view| view.camera.rotation.row(row)).sum::<DVec3>();
        let (up, forward) = (turn * -mean(1), turn * mean(2));
        assert!(up.normalize().abs_diff_eq(DVec3::Y, 1e-12), "{up}");
        assert!(forward.x.abs() < 1e-9 && forward.z < 0.0, "{forward}");
    }

    #[test]
    fn a_camera_of_gltf_sees_what_ours_sees() {
        let (scene, point) = (scene(), DVec3::new(0.1, 0.2, 0.3));
        let turn = to_gltf(&scene);
        for view in &scene.train {
            let (place, rotation) = camera_pose(&view.camera, turn);
            let seen = DQuat::from_array(rotation).inverse() * (turn * point - place);
            // Ours looks along z with y down.
            let wanted = view.camera.to_camera(point) * DVec3::new(1.0, -1.0, -1.0);
            assert!(seen.abs_diff_eq(wanted, 1e-9), "{seen}, not {wanted}");
        }
    }

    #[test]
    fn a_scene_without_cameras_has_the_axes_of_opencv() {
        let turn = to_gltf(&Scene { train: Vec::new(), ..scene() });
        assert!((turn * DVec3::NEG_Y).abs_diff_eq(DVec3::Y, 1e-12) && (turn.determinant() - 1.0).abs() < 1e-12);
    }
}
