//! Random points: in a box, on a far sphere. Also what makes a cloud smaller: merging, drawing.

use std::collections::HashMap;
use std::collections::hash_map::Entry;

use glam::{DVec3, Vec3};
use mvfusion_data::{Bounds, PointCloud, Scene};

use crate::config::InitConfig;
use crate::model::gaussians::SH_C0;
use crate::random::Stream;

/// Fraction of the points that count as strays, on either side of an axis. They are few but far away.
const STRAYS: f64 = 0.01;

/// The box of random points: the box of the cloud with its margin, at most `box_reach` extents away from the cameras.
/// Along an axis on which all of the cloud is farther away, that would be the gap between cameras and cloud: there, the
/// box is that of the cloud without its strays. Without a cloud it is the neighbourhood of the cameras.
pub(super) fn region(scene: &Scene, config: &InitConfig) -> Bounds {
    let cameras = scene.camera_bounds();
    let Some(cloud) = cloud_box(scene, config) else {
        let reach = DVec3::splat(unit(scene));
        return Bounds { min: cameras.min - reach, max: cameras.max + reach };
    };
    let reach = DVec3::splat(config.box_reach * scene.extent());
    let (low, high) = (cameras.min - reach, cameras.max + reach);
    let (min, max) = (cloud.min.max(low), cloud.max.min(high));
    let mut region = Bounds { min, max };
    let margin = config.box_margin * scene.extent();
    for axis in (0..3).filter(|&axis| min[axis] > max[axis]) {
        if let Some([first, last]) = range_without_strays(&scene.points.positions, axis) {
            (region.min[axis], region.max[axis]) = (f64::from(first) - margin, f64::from(last) + margin);
        }
    }
    region
}

/// The range of points along an axis; `None` without points.
pub(super) fn range_without_strays(positions: &[Vec3], axis: usize) -> Option<[f32; 2]> {
    let last = positions.len().checked_sub(1)?;
    let skipped = (STRAYS * last as f64) as usize;
    let mut sorted: Vec<f32> = positions.iter().map(|position| position[axis]).collect();
    sorted.sort_by(f32::total_cmp);
    Some([sorted[skipped], sorted[last - skipped]])
}

/// A warning if the cloud is out of the cameras' reach along an axis.
pub(super) fn out_of_reach(scene: &Scene, config: &InitConfig) -> Option<String> {
    let (cameras, cloud) = (scene.camera_bounds(), cloud_box(scene, config)?);
    let reach = config.box_reach * scene.extent();
    let is_far =
        |axis: &usize| cloud.min[*axis] > cameras.max[*axis] + reach || cloud.max[*axis] < cameras.min[*axis] - reach;
    let axes: Vec<&str> = (0..3).filter(is_far).map(|axis| ["x", "y", "z"][axis]).collect();
    (!axes.is_empty()).then(|| {
        format!(
            "all points are farther from the cameras than `init.box_reach` = {} extents along {}: there, random points \
             are drawn in the range of the points. Check that cameras and points share their coordinates, or raise the \
             reach",
            config.box_reach,
            axes.join(" and ")
        )
    })
}

/// The box of the cloud with its margin; `None` without points.
fn cloud_box(scene: &Scene, config: &InitConfig) -> Option<Bounds> {
    let margin = DVec3::splat(config.box_margin * scene.extent());
    let (min, max) = scene.points.bounds()?;
    Some(Bounds { min: min.as_dvec3() - margin, max: max.as_dvec3() + margin })
}

/// The extent of the scene, or one world unit if all cameras are at one place: points need some distance from them.
fn unit(scene: &Scene) -> f64 {
    let extent = scene.extent();
    if extent > 0.0 { extent } else { 1.0 }
}

/// Adds points that are uniform in `region`, in random colours.
pub(super) fn add_uniform(cloud: &mut PointCloud, count: usize, region: &Bounds, stream: &mut Stream) {
    for _ in 0..count {
        let position =
            DVec3::from_array(std::array::from_fn(|axis| stream.uniform(region.min[axis], region.max[axis])));
        cloud.push(position.as_vec3(), random_colour(stream));
    }
}

/// Points on a sphere around the cameras, twice as far as the farthest point, in random colours (METHOD §3, "sky").
/// Without points, it is twice as far as the farthest corner of `region`, the box of random points.
pub(super) fn sky(cloud: &mut PointCloud, count: usize, scene: &Scene, region: &Bounds, stream: &mut Stream) {
    let centre = scene.training_centre();
    let reach = scene.points.reach(centre);
    let corner = (region.max - centre).abs().max((region.min - centre).abs());
    let radius = 2.0 * if reach > 0.0 { reach } else { corner.length() };
    for _ in 0..count {
        let azimuth = stream.uniform(0.0, std::f64::consts::TAU);
        let height = stream.uniform(-1.0, 1.0);
        let ring = (1.0 - height * height).sqrt();
        let direction = DVec3::new(ring * azimuth.cos(), ring * azimuth.sin(), height);
        let colour = Vec3::new(stream.unit() as f32, stream.unit() as f32, stream.unit() as f32);
        cloud.push((centre + radius * direction).as_vec3(), colour);
    }
}

/// The cloud with one point in place of all that coincide: the first one, in their mean colour. The order stays.
pub(super) fn merged(points: &PointCloud) -> PointCloud {
    // Sums of colours, and numbers of points. Adding 0.0 turns -0.0 into 0.0.
    let mut index: HashMap<[u32; 3], usize> = HashMap::with_capacity(points.len());
    let mut sums: Vec<(DVec3, f64)> = Vec::with_capacity(points.len());
    let mut merged = PointCloud::default();
    for (position, colour) in points.positions.iter().zip(&points.colours) {
        let place = position.to_array().map(|coordinate| (coordinate + 0.0).to_bits());
        match index.entry(place) {
            Entry::Vacant(free) => {
                free.insert(sums.len());
                sums.push((colour.as_dvec3(), 1.0));
                merged.push(*position, *colour);
            }
            Entry::Occupied(first) => {
                let (sum, count) = &mut sums[*first.get()];
                (*sum, *count) = (*sum + colour.as_dvec3(), *count + 1.0);
            }
        }
    }
    for (colour, (sum, count)) in merged.colours.iter_mut().zip(sums) {
        *colour = (sum / count).as_vec3();
    }
    merged
}

/// At most `most` points of a cloud, drawn at random, in their order.
pub(super) fn thinned(points: PointCloud, most: usize, stream: &mut Stream) -> PointCloud {
    if points.len() <= most {
        return points;
    }
    let mut kept = stream.permutation(points.len());
    kept.truncate(most);
    kept.sort_unstable();
    let mut thinned = PointCloud::default();
    kept.into_iter().for_each(|index| thinned.push(points.positions[index], points.colours[index]));
    thinned
}

/// The random colour of DeGauss: a constant coefficient from `[0, 1)`, so a colour of 0.5 to 0.78.
pub(super) fn random_colour(stream: &mut Stream) -> Vec3 {
    Vec3::from_array(std::array::from_fn(|_| (0.5 + SH_C0 * stream.unit()) as f32))
}

#[cfg(test)]
mod tests {
    use glam::DMat3;
    use mvfusion_data::{Camera, Capture, Picture, Truth, View};

    use super::*;

    /// A scene without points, with a camera at each centre.
    fn scene(centres: &[DVec3]) -> Scene {
        let view = |&centre: &DVec3| View {
            name: String::new(),
            camera: Camera::centred(4, 4, 4.0, DMat3::IDENTITY, centre),
            time: 0.0,
            image: Picture::Memory(std::sync::Arc::default()),
            mask: None,
            truth: Truth::default(),
        };
        let train = centres.iter().map(view).collect();
        let (name, points) = (String::new(), PointCloud::default());
        Scene { name, capture: Capture::Photos, train, test: Vec::new(), points, near: None }
    }

    #[test]
    fn without_points_the_sky_is_far_from_the_cameras_and_beyond_the_random_points() {
        for centres in [vec![DVec3::ZERO, 4.0 * DVec3::X], vec![DVec3::ONE]] {
            let scene = scene(&centres);
            let (config, stream) = (InitConfig::default(), &mut Stream::new(1, 0));
            let region = region(&scene, &config);
            let (mut points, mut far) = (PointCloud::default(), PointCloud::default());
            add_uniform(&mut points, 500, &region, stream);
            sky(&mut far, 500, &scene, &region, stream);
            let centre = scene.training_centre();
            let nearest = far.positions.iter().map(|p| p.as_dvec3().distance(centre)).fold(f64::INFINITY, f64::min);
            assert!(nearest > 1.5 * points.reach(centre) && points.reach(centre) > 0.5, "{nearest}");
        }
    }

    #[test]
    fn a_cloud_out_of_reach_keeps_its_own_range() {
        let mut scene = scene(&[DVec3::ZERO, 4.0 * DVec3::X]);
        scene.points.push(Vec3::new(1.0, -1.0, 900.0), Vec3::ONE);
        scene.points.push(Vec3::new(2.0, 1.0, 1000.0), Vec3::ONE);
        let config = InitConfig::default();
        let found = region(&scene, &config);
        let own = [DVec3::new(1.0, -1.0, 900.0), DVec3::new(2.0, 1.0, 1000.0)];
        assert_eq!([found.min, found.max], own);
        // Strays do not stretch it.
        let mut strayed = scene.clone();
        (0..200).for_each(|i| strayed.points.push(Vec3::new(1.5, 0.0, 900.0 + 0.5 * i as f32), Vec3::ONE));
        strayed.points.push(Vec3::new(1.5, 0.0, 5e5), Vec3::ONE);
        let found = region(&strayed, &config);
        assert!(found.min.z >= 900.0 && found.max.z <= 1000.0 && found.max.z - found.min.z > 95.0, "{found:?}");
        let said = out_of_reach(&scene, &config).expect("it is far away");
        assert!(said.contains("`init.box_reach` = 5 extents along z:"), "{said}");

        let everywhere = InitConfig { box_reach: f64::INFINITY, ..config.clone() };
        assert_eq!([region(&scene, &everywhere).min, region(&scene, &everywhere).max], own);
        assert_eq!(out_of_reach(&scene, &everywhere), None);
        // A cloud that begins within reach ends there.
        scene.points.positions[0].z = 0.5;
        let found = region(&scene, &config);
        assert_eq!([found.min.z, found.max.z], [0.5, 5.0 * scene.extent()]);
        assert_eq!(out_of_reach(&scene, &config), None);
    }

    #[test]
    fn points_that_coincide_become_one_in_their_mean_colour() {
        let mut points = PointCloud::default();
        for (x, red) in [(1.0, 0.2), (0.0, 1.0), (1.0, 0.4), (-0.0, 0.5)] {
            points.push(Vec3::new(x, 2.0, 3.0), Vec3::new(red, 0.25, 0.1));
        }
        let merged = merged(&points);
        assert_eq!(merged.positions, [Vec3::new(1.0, 2.0, 3.0), Vec3::new(0.0, 2.0, 3.0)]);
        let expected = [Vec3::new(0.3, 0.25, 0.1), Vec3::new(0.75, 0.25, 0.1)];
        assert!(merged.colours.iter().zip(expected).all(|(own, other)| own.distance(other) < 1e-6), "{merged:?}");
    }

    #[test]
    fn distinct_points_are_not_changed() {
        let stream = &mut Stream::new(3, 0);
        let mut points = PointCloud::default();
        let region = Bounds { min: DVec3::ZERO, max: DVec3::ONE };
        add_uniform(&mut points, 1000, &region, stream);
        assert_eq!(merged(&points), points);
        assert_eq!(thinned(points.clone(), 1000, stream), points);
        let few = thinned(points.clone(), 300, stream);
        assert_eq!(few.len(), 300);
        let places: Vec<usize> = few
            .positions
            .iter()
            .map(|position| points.positions.iter().position(|other| other == position).expect("one of them"))
            .collect();
        assert!(places.is_sorted());
    }
}
