//! The range of depths in which each camera's rays search for places.

use glam::{DVec2, DVec3};

use super::options::MotionHullOptions;
use super::rig::StillRig;
use crate::scene::{Camera, Scene, nearest_to_axes};

/// Known points that a camera must see for their depths to define its range.
const LEAST_POINTS: usize = 10;
/// Fraction of the known points within the far bound. Single points may be far outside.
const FAR_SHARE: f64 = 0.99;
/// Rays extend to this many times the distance of the known points, or of the point that all cameras look at. In
/// inverse depth, this costs few places.
const BEYOND_POINTS: f64 = 1.5;
const BEYOND_TARGET: f64 = 4.0;
/// If nothing is known of the scene, rays extend to this many times the distance between the cameras.
const BEYOND_CAMERAS: f64 = 100.0;
/// If no near bound is known, rays start at this fraction of the far bound, or where enough cameras see.
const NEAREST: f64 = 0.01;
/// Axes meet if the determinant of their mean normal equations is above this. Below it they differ by less than about 6
/// degrees.
const AXES_MEET: f64 = 1e-3;
/// Rays along each side of the image, and depths on each ray, for counting the cameras that see a place.
const SIDE: usize = 5;
const STEPS: usize = 128;

/// The range of depths in world units that the rays of each camera search. It is within the known scene and where
/// enough cameras see.
pub(super) fn reaches(scene: &Scene, rig: &StillRig, options: &MotionHullOptions) -> Vec<[f64; 2]> {
    let cameras: Vec<&Camera> = rig.cameras.iter().map(|still| &still.camera).collect();
    let needed = least_seeing(cameras.len(), options);
    let target = nearest_to_axes(&cameras, AXES_MEET);
    let apart = scene.camera_bounds();
    let apart = apart.min.distance(apart.max);
    let reach = |camera: &&Camera| {
        let far = far_of_points(scene, camera)
            .or_else(|| target.map(|target| BEYOND_TARGET * camera.to_camera(target).z).filter(|&depth| depth > 0.0))
            .unwrap_or(BEYOND_CAMERAS * apart.max(f64::MIN_POSITIVE));
        let near = scene.near.filter(|&near| near > 0.0 && near < far).unwrap_or(NEAREST * far);
        where_seen([near, far], camera, &cameras, needed)
    };
    cameras.iter().map(reach).collect()
}

/// The number of `cameras` cameras that must see a place.
pub(super) fn least_seeing(cameras: usize, options: &MotionHullOptions) -> usize {
    options.least_cameras.max((options.seeing_share * cameras as f64).ceil() as usize)
}

/// The far bound of a camera, from the known points that it sees.
fn far_of_points(scene: &Scene, camera: &Camera) -> Option<f64> {
    let seen = |point: DVec3| camera.project(point).is_some_and(|position| in_picture(camera, position));
    let points = scene.points.positions.iter().map(|point| point.as_dvec3()).filter(|&point| seen(point));
    let mut depths: Vec<f64> = points.map(|point| camera.to_camera(point).z).collect();
    if depths.len() < LEAST_POINTS {
        return None;
    }
    depths.sort_by(f64::total_cmp);
    Some(BEYOND_POINTS * depths[(FAR_SHARE * (depths.len() - 1) as f64) as usize])
}

fn in_picture(camera: &Camera, position: DVec2) -> bool {
    let inside = |coordinate: f64, side: usize| coordinate >= 0.0 && coordinate < side as f64;
    inside(position.x, camera.width) && inside(position.y, camera.height)
}

/// The part of a depth range where enough other cameras share a camera's view; the whole range if there is no such
/// part.
fn where_seen([near, far]: [f64; 2], camera: &Camera, cameras: &[&Camera], needed: usize) -> [f64; 2] {
    let inverse = |step: usize| 1.0 / near + (1.0 / far - 1.0 / near) * step as f64 / STEPS as f64;
    let directions = directions(camera);
    let seen = |step: &usize| {
        directions.iter().any(|&direction| {
            let place = camera.centre() + direction / inverse(*step);
            let sees = |other: &&&Camera| other.project(place).is_some_and(|position| in_picture(other, position));
            cameras.iter().filter(sees).take(needed).count() == needed
        })
    };
    let first = (0..=STEPS).find(seen);
    let last = (0..=STEPS).rev().find(seen);
    let (Some(first), Some(last)) = (first, last) else { return [near, far] };
    // One more step on each side, because more may be visible between two steps.
    [1.0 / inverse(first.saturating_sub(1)), 1.0 / inverse((last + 1).min(STEPS))]
}

/// Directions of depth 1, evenly spaced over a camera's image.
fn directions(camera: &Camera) -> Vec<DVec3> {
    let position = |index: usize, side: usize| (index as f64 + 0.5) / SIDE as f64 * side as f64;
    let positions = (0..SIDE * SIDE)
        .map(|index| DVec2::new(position(index % SIDE, camera.width), position(index / SIDE, camera.height)));
    let local = positions.map(|p| DVec3::new((p.x - camera.cx) / camera.fx, (p.y - camera.cy) / camera.fy, 1.0));
    local.map(|direction| camera.rotation.transpose() * direction).collect()
}
