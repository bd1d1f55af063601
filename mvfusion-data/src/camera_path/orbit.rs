//! An orbit around the point that the cameras of a capture look at.

use std::f64::consts::{PI, TAU};

use glam::DVec3;

use super::placed::{axes, placed};
use super::vantage::Vantage;
use crate::scene::{Camera, Scene};

/// Minimum angle to either side, in radians. It applies to captures by one fixed camera.
const LEAST_SWING: f64 = 0.05;

/// `count` cameras on a closed orbit around the point that the training cameras look at. The orbit has their median
/// distance and height. The camera after the last would be the first.
///
/// If the training cameras cover more than half of the circle, the orbit is the whole circle. Otherwise it swings
/// between the outermost cameras, because no photo shows the rest.
pub fn orbit(scene: &Scene, count: usize) -> Vec<Camera> {
    let circle = Circle::of(scene);
    let camera = |i: usize| {
        let angle = circle.arc.angle(i as f64 / count as f64);
        let centre = circle.place(angle);
        let axes = axes(circle.target - centre, -circle.axis);
        // A camera right above the target has no up direction. It keeps the orientation of the middle camera.
        axes.map_or(circle.middle, |axes| placed(&circle.middle, axes, centre))
    };
    (0..count).map(camera).collect()
}

/// The circle of the cameras.
struct Circle {
    middle: Camera,
    target: DVec3,
    /// Upwards.
    axis: DVec3,
    /// Directions of angle 0, towards the middle camera, and of a quarter turn.
    across: [DVec3; 2],
    radius: f64,
    height: f64,
    arc: Arc,
}

impl Circle {
    fn of(scene: &Scene) -> Self {
        let Vantage { middle, target, up: axis, .. } = Vantage::of(scene);
        let flat = |v: DVec3| v - axis * axis.dot(v);
        let ahead = flat(middle.centre() - target).try_normalize();
        let ahead =
            ahead.or_else(|| flat(middle.rotation.row(1)).try_normalize()).unwrap_or(axis.any_orthonormal_vector());
        let across = [ahead, axis.cross(ahead)];
        let offsets: Vec<DVec3> = scene.train.iter().map(|view| view.camera.centre() - target).collect();
        let angles = offsets.iter().map(|v| across[1].dot(*v).atan2(across[0].dot(*v))).collect();
        Self {
            middle,
            target,
            axis,
            across,
            radius: median(offsets.iter().map(|v| flat(*v).length()).collect()),
            height: median(offsets.iter().map(|v| axis.dot(*v)).collect()),
            arc: Arc::of(angles),
        }
    }

    fn place(&self, angle: f64) -> DVec3 {
        let (sin, cos) = angle.sin_cos();
        self.target + self.radius * (cos * self.across[0] + sin * self.across[1]) + self.height * self.axis
    }
}

/// The median.
fn median(mut values: Vec<f64>) -> f64 {
    values.sort_by(f64::total_cmp);
    values[values.len() / 2]
}

/// The part of a circle that the orbit covers.
#[derive(Clone, Copy, Debug, PartialEq)]
enum Arc {
    Whole,
    Swing { middle: f64, half: f64 },
}

impl Arc {
    /// The part that contains the given angles, which are in `[-PI, PI]`.
    fn of(mut angles: Vec<f64>) -> Self {
        angles.sort_by(f64::total_cmp);
        // The largest gap between neighbours. The first follows the last.
        let gap = |i: usize| match angles.get(i + 1) {
            Some(next) => next - angles[i],
            None => angles[0] + TAU - angles[i],
        };
        let before = (0..angles.len()).max_by(|&a, &b| gap(a).total_cmp(&gap(b))).unwrap_or(0);
        let covered = TAU - gap(before);
        if covered > PI {
            return Self::Whole;
        }
        let first = angles[(before + 1) % angles.len()];
        Self::Swing { middle: first + covered / 2.0, half: (covered / 2.0).max(LEAST_SWING) }
    }

    /// The angle after a fraction of the way.
    fn angle(self, share: f64) -> f64 {
        match self {
            Self::Whole => TAU * share,
            Self::Swing { middle, half } => middle + half * (TAU * share).sin(),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::builtin;
    use crate::builtin::{BuiltinKind, BuiltinOptions};

    fn scene() -> Scene {
        builtin::builtin(&BuiltinOptions { width: 32, height: 24, ..BuiltinOptions::of_kind(BuiltinKind::Video) })
    }

    #[test]
    fn all_cameras_are_rotations_that_look_at_the_target_from_one_distance() {
        let scene = scene();
        let circle = Circle::of(&scene);
        for camera in orbit(&scene, 24) {
            let off = camera.rotation * camera.rotation.transpose() - glam::DMat3::IDENTITY;
            assert!(off.to_cols_array().iter().all(|v| v.abs() < 1e-12) && camera.rotation.determinant() > 0.0);
            let seen = camera.to_camera(circle.target);
            assert!(seen.x.abs() < 1e-9 && seen.y.abs() < 1e-9, "{seen}");
            assert!((seen.z - circle.radius.hypot(circle.height)).abs() < 1e-9);
            assert!(camera.rotation.row(1).dot(circle.axis) < 0.0, "upright");
        }
    }

    #[test]
    fn the_target_of_the_built_in_rig_is_found() {
        // Its cameras look at this point (`builtin/rig.rs`).
        assert!(Circle::of(&scene()).target.distance(DVec3::new(0.0, 0.2, 1.05)) < 1e-9);
    }

    #[test]
    fn cameras_on_one_side_are_swung_between_and_the_way_closes() {
        let scene = scene();
        let cameras = orbit(&scene, 40);
        let places: Vec<DVec3> = cameras.iter().map(Camera::centre).collect();
        let reach = 2.0 * scene.extent();
        assert!(places.iter().all(|place| place.distance(scene.training_centre()) < reach));
        let step = |i: usize| places[i].distance(places[(i + 1) % places.len()]);
        assert!((0..places.len()).all(|i| step(i) < 0.2 * reach), "no jump, not at the end either");
    }

    #[test]
    fn the_arc_has_all_angles_on_it_and_most_of_a_circle_is_all_of_it() {
        assert_eq!(Arc::of((0..8).map(|i| f64::from(i) * TAU / 8.0 - PI).collect()), Arc::Whole);
        // Across the jump of angles from PI to -PI.
        let Arc::Swing { middle, half } = Arc::of(vec![3.0, -3.0, 2.8]) else { panic!("a swing") };
        assert!((middle - (2.8 + half)).abs() < 1e-12 && (2.0 * half - (TAU - 5.8)).abs() < 1e-12);
        assert_eq!(Arc::of(vec![0.3]), Arc::Swing { middle: 0.3, half: LEAST_SWING });
        let swing = Arc::Swing { middle: 1.0, half: 0.5 };
        assert!((swing.angle(0.25) - 1.5).abs() < 1e-12 && (swing.angle(0.75) - 0.5).abs() < 1e-12);
        assert!((swing.angle(0.0) - swing.angle(1.0)).abs() < 1e-12);
    }
}
