//! Cameras of the built-in scenes.

use std::f64::consts::TAU;

use glam::{DMat3, DVec3};
use rand::RngExt;
use rand_chacha::ChaCha8Rng;

use super::choreography::stream;
use crate::scene::Camera;

/// Focal length for an image one pixel wide: 63 degrees from edge to edge.
const FOCAL: f64 = 0.82;
/// Point that the cameras look at, metres.
const TARGET: DVec3 = DVec3::new(0.0, 0.2, 1.05);
/// Distance of the cameras from the target, metres.
const DISTANCE: f64 = 4.7;
/// Directions of the video cameras from the target: degrees to the right, degrees up. The first, which is held out, has
/// others on all sides. Neighbours are 8 to 12 degrees apart.
const VIDEO_RIG: [(f64, f64); 8] =
    [(0.0, 12.0), (-19.5, 12.5), (-9.5, 11.0), (9.5, 12.5), (19.5, 11.0), (-5.5, 20.5), (6.5, 20.0), (1.0, 3.0)];
const STREAM_HAND: u64 = 2;
/// Largest camera shake away from the path, metres, to each side.
const HAND: f64 = 0.09;

/// The cameras of the video; the first is the test camera.
pub(super) fn video_cameras(width: usize, height: usize) -> Vec<Camera> {
    VIDEO_RIG.iter().map(|&(right, up)| camera(width, height, place(right, up, DISTANCE), TARGET)).collect()
}

/// The cameras of `count` photos. They are taken with a handheld camera on a walk around the stage and back.
pub(super) fn photo_cameras(width: usize, height: usize, count: usize, seed: u64) -> Vec<Camera> {
    let mut rng = stream(seed, STREAM_HAND);
    let last = count.saturating_sub(1).max(1) as f64;
    (0..count).map(|i| on_walk(width, height, i as f64 / last, jitter(&mut rng), jitter(&mut rng))).collect()
}

/// A camera on the walk of [`photo_cameras`] without camera shake, for a time in `[0, 1]`.
pub(super) fn held_out_camera(width: usize, height: usize, time: f64) -> Camera {
    on_walk(width, height, time, DVec3::ZERO, DVec3::ZERO)
}

fn jitter(rng: &mut ChaCha8Rng) -> DVec3 {
    let mut side = || rng.random_range(-HAND..HAND);
    DVec3::new(side(), side(), side())
}

fn on_walk(width: usize, height: usize, time: f64, stray: DVec3, aim: DVec3) -> Camera {
    let phase = TAU * time;
    let position = place(24.0 * phase.sin(), 11.5 + 6.0 * (2.0 * phase + 0.7).sin(), DISTANCE + 0.25 * phase.cos());
    camera(width, height, position + stray, TARGET + aim)
}

/// The point at this distance from the target. Zero angles mean the open side of the room, -y.
fn place(right: f64, up: f64, distance: f64) -> DVec3 {
    let ((sin_right, cos_right), (sin_up, cos_up)) = (right.to_radians().sin_cos(), up.to_radians().sin_cos());
    TARGET + distance * DVec3::new(sin_right * cos_up, -cos_right * cos_up, sin_up)
}

fn camera(width: usize, height: usize, position: DVec3, target: DVec3) -> Camera {
    let forward = (target - position).normalize();
    let right = forward.cross(DVec3::Z).normalize();
    let axes = DMat3::from_cols(right, forward.cross(right), forward);
    Camera::centred(width, height, FOCAL * width as f64, axes, position)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn cameras_stand_upright_and_look_at_the_stage() {
        for camera in video_cameras(160, 120).iter().chain(&photo_cameras(160, 120, 9, 4)) {
            assert!((camera.rotation.determinant() - 1.0).abs() < 1e-12);
            let below = camera.project(TARGET - 0.5 * DVec3::Z).expect("in front");
            let middle = camera.project(TARGET).expect("in front");
            assert!(below.y > middle.y + 5.0 && (middle.x - 80.0).abs() < 8.0 && (middle.y - 60.0).abs() < 8.0);
        }
    }

    #[test]
    fn the_held_out_video_camera_has_neighbours_on_all_sides() {
        let cameras = video_cameras(160, 120);
        let axes = cameras[0].rotation;
        let offsets: Vec<DVec3> = cameras[1..].iter().map(|c| axes * (c.centre() - cameras[0].centre())).collect();
        for (axis, sign) in [(0, 1.0), (0, -1.0), (1, 1.0), (1, -1.0)] {
            assert!(offsets.iter().any(|o| sign * o[axis] > 0.5));
        }
        for (i, camera) in cameras.iter().enumerate() {
            let angle = |other: &Camera| (camera.centre() - TARGET).angle_between(other.centre() - TARGET).to_degrees();
            let nearest = cameras.iter().enumerate().filter(|&(j, _)| j != i).map(|(_, c)| angle(c));
            let nearest = nearest.fold(f64::INFINITY, f64::min);
            assert!((8.0..12.5).contains(&nearest), "camera {i}: {nearest}");
        }
    }
}
