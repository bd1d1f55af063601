//! Images of solids by ray casting. Each pixel has 4 x 4 rays for its colour and one through its centre for its depth.

use std::ops::Range;

use glam::{DVec2, DVec3, Vec3};
use image::{GrayImage, Luma, Rgb, RgbImage};

use super::solid::{Ray, Solid};
use crate::scene::Camera;

/// Rays along each side of a pixel.
const GRID: usize = 4;
/// Rays of a pixel that determine its colour.
const COLOUR_RAYS: usize = GRID * GRID;
/// All rays of a pixel; the last goes through its centre.
const RAYS: usize = COLOUR_RAYS + 1;

/// The lamp that lights everything, metres.
const LIGHT: DVec3 = DVec3::new(-2.0, -3.6, 3.1);
/// Ambient light.
const AMBIENT: f64 = 0.46;
/// Light of the lamp on a surface that faces it.
const DIFFUSE: f64 = 0.62;
/// Additional light from above.
const FROM_ABOVE: f64 = 0.10;

/// The first surface that a ray meets.
#[derive(Clone, Copy, Debug)]
pub(super) struct Seen {
    pub(super) colour: Vec3,
    /// Along the camera's z axis for rays of [`ray_through`], otherwise in lengths of the ray's direction.
    pub(super) depth: f64,
    /// Whether it belongs to a mover.
    pub(super) is_mover: bool,
}

/// A camera's view of the still solids. All rays are kept so that moving objects can be drawn in front.
pub(super) struct Backdrop {
    camera: Camera,
    seen: Vec<[Seen; RAYS]>,
}

/// A finished image with its ground truth.
pub(super) struct Shot {
    pub(super) image: RgbImage,
    /// 255 where moving objects cover more than half of the pixel.
    pub(super) mask: GrayImage,
    /// 255 where movers cover more than half of the pixel.
    pub(super) movers: GrayImage,
    /// Along the camera's z axis at the pixel centres, row by row.
    pub(super) depth: Vec<f32>,
}

/// The ray through a pixel position. Its direction reaches depth 1.
pub(super) fn ray_through(camera: &Camera, pixel: DVec2) -> Ray {
    let local = DVec3::new((pixel.x - camera.cx) / camera.fx, (pixel.y - camera.cy) / camera.fy, 1.0);
    Ray { origin: camera.centre(), direction: camera.rotation.transpose() * local }
}

/// The first surface of these solids that the ray meets.
pub(super) fn first_seen<'a>(ray: &Ray, solids: impl IntoIterator<Item = &'a Solid>) -> Option<Seen> {
    let hits = solids.into_iter().filter_map(|solid| solid.hit(ray).map(|hit| (solid, hit)));
    let (solid, hit) = hits.min_by(|a, b| a.1.distance.total_cmp(&b.1.distance))?;
    let albedo = solid.texture.at(hit.point, hit.normal);
    let (point, normal) = (ray.origin + hit.distance * ray.direction, solid.to_world(hit.normal));
    let facing = normal.dot((LIGHT - point).normalize());
    // Wrapped around the edge of the shadow, so that the dark side keeps its form.
    let lit = ((facing + 0.25) / 1.25).max(0.0);
    let light = AMBIENT + DIFFUSE * lit + FROM_ABOVE * normal.z;
    let colour = (albedo * light as f32).clamp(Vec3::ZERO, Vec3::ONE);
    Some(Seen { colour, depth: hit.distance, is_mover: solid.is_mover })
}

impl Backdrop {
    pub(super) fn new(camera: Camera, solids: &[Solid]) -> Self {
        let nothing = Seen { colour: Vec3::ZERO, depth: f64::INFINITY, is_mover: false };
        let mut seen = Vec::with_capacity(camera.width * camera.height);
        for_each_pixel(&camera, solids, |pixel, near| {
            seen.push(std::array::from_fn(|i| {
                first_seen(&ray_through(&camera, pixel + offset(i)), near.iter().copied()).unwrap_or(nothing)
            }));
        });
        Self { camera, seen }
    }

    /// The image without moving objects.
    pub(super) fn image(&self) -> RgbImage {
        RgbImage::from_fn(self.camera.width as u32, self.camera.height as u32, |x, y| self.rgb(x as usize, y as usize))
    }

    /// The image with `moving` in front of the still solids.
    pub(super) fn shot(&self, moving: &[Solid]) -> Shot {
        let (width, height) = (self.camera.width as u32, self.camera.height as u32);
        let mut image = self.image();
        let [mut mask, mut movers] = [0; 2].map(|_| GrayImage::new(width, height));
        let mut depth: Vec<f32> = self.seen.iter().map(|rays| rays[COLOUR_RAYS].depth as f32).collect();
        let mut index = 0;
        for_each_pixel(&self.camera, moving, |pixel, near| {
            let mut rays = self.seen[index];
            let mut covered = [false; RAYS];
            for (i, ray) in rays.iter_mut().enumerate().filter(|_| !near.is_empty()) {
                let front = first_seen(&ray_through(&self.camera, pixel + offset(i)), near.iter().copied());
                if let Some(front) = front.filter(|f| f.depth < ray.depth) {
                    (*ray, covered[i]) = (front, true);
                }
            }
            let count = covered[..COLOUR_RAYS].iter().filter(|&&c| c).count();
            let by_movers = rays[..COLOUR_RAYS].iter().filter(|ray| ray.is_mover).count();
            let (x, y) = (pixel.x as u32, pixel.y as u32);
            if count > 0 {
                image.put_pixel(x, y, average(&rays));
            }
            mask.put_pixel(x, y, white_for_most(count));
            movers.put_pixel(x, y, white_for_most(by_movers));
            depth[index] = rays[COLOUR_RAYS].depth as f32;
            index += 1;
        });
        Shot { image, mask, movers, depth }
    }

    fn rgb(&self, x: usize, y: usize) -> Rgb<u8> {
        average(&self.seen[y * self.camera.width + x])
    }
}

/// The position of ray `index` in a pixel, relative to the pixel's corner.
fn offset(index: usize) -> DVec2 {
    if index == COLOUR_RAYS {
        return DVec2::splat(0.5);
    }
    (DVec2::new((index % GRID) as f64, (index / GRID) as f64) + 0.5) / GRID as f64
}

/// White if this many rays are more than half of the pixel's rays.
fn white_for_most(rays: usize) -> Luma<u8> {
    Luma([if 2 * rays > COLOUR_RAYS { 255 } else { 0 }])
}

fn average(rays: &[Seen; RAYS]) -> Rgb<u8> {
    let sum: Vec3 = rays[..COLOUR_RAYS].iter().map(|r| r.colour).sum();
    Rgb((sum / COLOUR_RAYS as f32 * 255.0).round().to_array().map(|v| v as u8))
}

/// Calls `visit` for each pixel, row by row, with its corner and the solids that it may show.
fn for_each_pixel<'a>(camera: &Camera, solids: &'a [Solid], mut visit: impl FnMut(DVec2, &[&'a Solid])) {
    let frames: Vec<_> = solids.iter().map(|s| (s, frame_of(camera, s))).collect();
    let mut near = Vec::new();
    for y in 0..camera.height {
        let in_row: Vec<_> = frames.iter().filter(|(_, (_, rows))| rows.contains(&(y as f64))).collect();
        for x in 0..camera.width {
            near.clear();
            near.extend(in_row.iter().filter(|(_, (columns, _))| columns.contains(&(x as f64))).map(|(s, _)| *s));
            visit(DVec2::new(x as f64, y as f64), &near);
        }
    }
}

/// The columns and rows of pixels, by their corners, that contain everything of the solid.
fn frame_of(camera: &Camera, solid: &Solid) -> (Range<f64>, Range<f64>) {
    let centre = camera.to_camera(solid.pose.position);
    let reach = solid.reach();
    let side = |lateral: f64, focal: f64, middle: f64| {
        let distance = lateral.hypot(centre.z);
        let spread = if reach < distance { (reach / distance).asin() } else { f64::INFINITY };
        let angle = lateral.atan2(centre.z);
        let limit = 0.5 * std::f64::consts::PI - 1e-3;
        let edge = |a: f64| middle + focal * a.tan();
        let low = if angle - spread > -limit { edge((angle - spread).min(limit)) } else { f64::NEG_INFINITY };
        let high = if angle + spread < limit { edge((angle + spread).max(-limit)) } else { f64::INFINITY };
        (low - 1.0)..(high + 1.0)
    };
    (side(centre.x, camera.fx, camera.cx), side(centre.y, camera.fy, camera.cy))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::builtin::{rig, stage};

    #[test]
    fn leaving_out_solids_that_are_out_of_sight_changes_no_pixel() {
        let camera = rig::video_cameras(40, 30)[3];
        let solids = stage::still_solids(1);
        let backdrop = Backdrop::new(camera, &solids);
        for (index, rays) in backdrop.seen.iter().enumerate() {
            let pixel = DVec2::new((index % 40) as f64 + 0.5, (index / 40) as f64 + 0.5);
            let all = first_seen(&ray_through(&camera, pixel), &solids).expect("the room is closed");
            assert_eq!(all.depth, rays[COLOUR_RAYS].depth);
        }
    }

    #[test]
    fn a_backdrop_with_nothing_in_front_is_itself() {
        let backdrop = Backdrop::new(rig::video_cameras(40, 30)[0], &stage::still_solids(1));
        let shot = backdrop.shot(&[]);
        assert_eq!(shot.image, backdrop.image());
        assert!(shot.mask.pixels().all(|p| p.0[0] == 0));
    }
}
