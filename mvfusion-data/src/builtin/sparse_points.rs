//! Points that structure from motion would find in a built-in scene.

use glam::{DVec2, DVec3};
use rand::RngExt;
use rand_chacha::ChaCha8Rng;

use super::choreography::stream;
use super::shot::{first_seen, ray_through};
use super::solid::{Ray, Solid};
use super::stage::SCENE_SIZE;
use crate::scene::{Camera, PointCloud};

/// Number of points.
pub(super) const WANTED: usize = 4000;
/// Number of cameras that must see a point.
const SEEN_BY: usize = 2;
/// Root mean square error of a position, as a fraction of the scene's size.
const NOISE: f64 = 0.003;
/// A surface hides a point if it is nearer than the point by more than this fraction of the distance.
const HIDDEN: f64 = 1e-6;
const STREAM_POINTS: u64 = 3;

/// Samples points on still surfaces at random pixels of the cameras. At least two cameras see each point, and its
/// position is slightly noisy.
pub(super) fn sample(cameras: &[Camera], solids: &[Solid], seed: u64) -> PointCloud {
    let mut rng = stream(seed, STREAM_POINTS);
    let mut points = PointCloud::default();
    // Three quarters of the pixels give a point. The limit is for rigs where none does.
    for _ in 0..20 * WANTED {
        let camera = &cameras[rng.random_range(0..cameras.len())];
        let pixel = DVec2::new(rng.random::<f64>() * camera.width as f64, rng.random::<f64>() * camera.height as f64);
        let ray = ray_through(camera, pixel);
        let Some(seen) = first_seen(&ray, solids) else { continue };
        let point = ray.origin + seen.depth * ray.direction;
        let error = misplacement(&mut rng);
        if cameras.iter().filter(|c| sees(c, point, solids)).take(SEEN_BY).count() == SEEN_BY {
            points.push((point + error).as_vec3(), seen.colour);
        }
        if points.len() == WANTED {
            break;
        }
    }
    points
}

fn sees(camera: &Camera, point: DVec3, solids: &[Solid]) -> bool {
    let Some(pixel) = camera.project(point) else { return false };
    if pixel.x < 0.0 || pixel.y < 0.0 || pixel.x > camera.width as f64 || pixel.y > camera.height as f64 {
        return false;
    }
    let ray = Ray { origin: camera.centre(), direction: point - camera.centre() };
    !solids.iter().any(|s| s.hit(&ray).is_some_and(|hit| hit.distance < 1.0 - HIDDEN))
}

/// Nearly normal noise. The sum of three uniform numbers in (-1, 1) is bell-shaped and has variance one.
fn misplacement(rng: &mut ChaCha8Rng) -> DVec3 {
    let mut bell = || (0..3).map(|_| rng.random_range(-1.0..1.0)).sum::<f64>();
    let direction = DVec3::new(bell(), bell(), bell());
    direction * NOISE * SCENE_SIZE / 3f64.sqrt()
}
