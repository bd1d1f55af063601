//! A spiral around the cameras of a forward-facing capture, as introduced by LLFF.

use std::f64::consts::TAU;

use glam::DVec3;

use super::placed::{axes, placed};
use super::vantage::Vantage;
use crate::scene::{Camera, Scene};

/// Turns around the viewing direction while the camera moves back and forth along it once.
const TURNS: f64 = 2.0;
/// Fraction of the training cameras within the spiral, on each axis.
const WITHIN: f64 = 0.9;
/// Largest radius, as a fraction of the depth of the scene. A larger radius shows regions that no photo covers.
const LARGEST: f64 = 0.25;
/// Smallest radius across the viewing direction. It applies to captures by one fixed camera.
const SMALLEST: f64 = 0.02;

/// `count` cameras on a closed spiral around the middle of the training cameras. All look at one point: straight ahead
/// of the middle camera, at the depth of its view. The camera after the last would be the first.
///
/// On each axis, the width of the spiral is the spread of the training cameras, within bounds.
pub fn spiral(scene: &Scene, count: usize) -> Vec<Camera> {
    let vantage = Vantage::of(scene);
    let middle = vantage.middle;
    let radii = radii(scene, &vantage);
    let target = middle.centre() + vantage.depth * middle.forward();
    let down = middle.rotation.row(1);
    let camera = |i: usize| {
        let phase = TAU * i as f64 / count as f64;
        let (sin, cos) = (TURNS * phase).sin_cos();
        let offset = radii * DVec3::new(cos, sin, phase.sin());
        let centre = middle.centre() + middle.rotation.transpose() * offset;
        // Proof: the offset is shorter than the distance to the target, so neither vector is zero and they are not
        // parallel.
        let axes = axes(target - centre, down).expect("the target is ahead");
        placed(&middle, axes, centre)
    };
    (0..count).map(camera).collect()
}

/// Half widths of the spiral: right, down, forward.
fn radii(scene: &Scene, vantage: &Vantage) -> DVec3 {
    let offsets: Vec<DVec3> = scene.train.iter().map(|view| vantage.middle.to_camera(view.camera.centre())).collect();
    let half_width = |axis: usize| {
        let mut sorted: Vec<f64> = offsets.iter().map(|offset| offset[axis].abs()).collect();
        sorted.sort_by(f64::total_cmp);
        sorted[((sorted.len() - 1) as f64 * WITHIN) as usize].min(LARGEST * vantage.depth)
    };
    let least = SMALLEST * vantage.depth;
    DVec3::new(half_width(0).max(least), half_width(1).max(least), half_width(2))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::builtin;
    use crate::builtin::{BuiltinKind, BuiltinOptions};

    fn scene(kind: BuiltinKind) -> Scene {
        builtin::builtin(&BuiltinOptions { width: 32, height: 24, ..BuiltinOptions::of_kind(kind) })
    }

    #[test]
    fn all_cameras_are_rotations_that_look_at_one_point() {
        for kind in [BuiltinKind::Video, BuiltinKind::Casual] {
            let scene = scene(kind);
            let vantage = Vantage::of(&scene);
            let target = vantage.middle.centre() + vantage.depth * vantage.middle.forward();
            for camera in spiral(&scene, 24) {
                let off = camera.rotation * camera.rotation.transpose() - glam::DMat3::IDENTITY;
                assert!(off.to_cols_array().iter().all(|v| v.abs() < 1e-12) && camera.rotation.determinant() > 0.0);
                let seen = camera.to_camera(target);
                assert!(seen.x.abs() < 1e-9 && seen.y.abs() < 1e-9 && seen.z > 0.0, "{seen}");
            }
        }
    }

    #[test]
    fn cameras_stay_near_those_that_trained_and_near_each_other() {
        let scene = scene(BuiltinKind::Video);
        let cameras = spiral(&scene, 60);
        let reach = scene.extent();
        let places: Vec<DVec3> = cameras.iter().map(Camera::centre).collect();
        assert!(places.iter().all(|place| place.distance(scene.training_centre()) < reach), "within the capture");
        let step = |i: usize| places[i].distance(places[(i + 1) % places.len()]);
        let longest = (0..places.len()).map(step).fold(0.0, f64::max);
        assert!(step(places.len() - 1) <= longest && longest < 0.25 * reach, "the path closes without a jump");
        assert!(longest > 0.0);
    }

    #[test]
    fn one_camera_that_stands_still_gets_a_small_spiral() {
        let mut scene = scene(BuiltinKind::Video);
        scene.train.truncate(1);
        let depth = Vantage::of(&scene).depth;
        let reach = |camera: &Camera| camera.centre().distance(scene.train[0].camera.centre());
        assert!(spiral(&scene, 12).iter().all(|camera| (reach(camera) - SMALLEST * depth).abs() < 1e-9));
    }
}
