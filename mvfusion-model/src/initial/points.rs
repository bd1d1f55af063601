//! Random points: in a box, on a far sphere.

use glam::{DVec3, Vec3};
use mvfusion_data::{Bounds, PointCloud, Scene};

use crate::config::InitConfig;
use crate::model::gaussians::SH_C0;
use crate::random::Stream;

/// The box of random points: the box of the cloud with its margin, at most `box_reach` extents away from the cameras.
/// Without a cloud it is the neighbourhood of the cameras.
pub(super) fn region(scene: &Scene, config: &InitConfig) -> Bounds {
    let cameras = scene.camera_bounds();
    let reach = DVec3::splat(config.box_reach * scene.extent());
    let margin = DVec3::splat(config.box_margin * scene.extent());
    match scene.points.bounds() {
        Some((min, max)) => Bounds {
            min: (min.as_dvec3() - margin).max(cameras.min - reach),
            max: (max.as_dvec3() + margin).min(cameras.max + reach),
        },
        None => {
            let reach = DVec3::splat(scene.extent());
            Bounds { min: cameras.min - reach, max: cameras.max + reach }
        }
    }
}

pub(super) fn strew(cloud: &mut PointCloud, count: usize, region: &Bounds, stream: &mut Stream) {
    for _ in 0..count {
        let position =
            DVec3::from_array(std::array::from_fn(|axis| stream.uniform(region.min[axis], region.max[axis])));
        cloud.push(position.as_vec3(), random_colour(stream));
    }
}

/// Points on a sphere around the cameras, twice as far as the farthest point, in random colours (METHOD §3, "sky").
pub(super) fn sky(cloud: &mut PointCloud, count: usize, scene: &Scene, stream: &mut Stream) {
    let centre = scene.training_centre();
    let radius = 2.0 * scene.points.reach(centre);
    for _ in 0..count {
        let azimuth = stream.uniform(0.0, std::f64::consts::TAU);
        let height = stream.uniform(-1.0, 1.0);
        let ring = (1.0 - height * height).sqrt();
        let direction = DVec3::new(ring * azimuth.cos(), ring * azimuth.sin(), height);
        let colour = Vec3::new(stream.unit() as f32, stream.unit() as f32, stream.unit() as f32);
        cloud.push((centre + radius * direction).as_vec3(), colour);
    }
}

/// The random colour of DeGauss: a constant coefficient from `[0, 1)`, so a colour of 0.5 to 0.78.
pub(super) fn random_colour(stream: &mut Stream) -> Vec3 {
    Vec3::from_array(std::array::from_fn(|_| (0.5 + SH_C0 * stream.unit()) as f32))
}
