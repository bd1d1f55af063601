//! The two clouds of Gaussians before the first step: on points (METHOD §3), or from files of other programs.

use std::path::Path;

use burn::tensor::{DType, Device, Tensor};
use glam::{DVec3, Vec3};
use kiddo::{ImmutableKdTree, SquaredEuclidean};
use mvfusion_data::{Bounds, GaussianCloud, PointCloud, Scene, rest_width};
use rayon::prelude::*;

use crate::ModelError;
use crate::config::{Branches, Config, InitConfig};
use crate::gaussians::{Attribute, Gaussians, SH_C0, attribute_tensor};
use crate::random::Stream;

/// Mean squared distances below this are taken as this, so that a scale has a logarithm (3DGS).
const MIN_SQUARED_DISTANCE: f64 = 1e-7;

/// What a branch starts from.
#[derive(Clone, Debug, PartialEq)]
pub enum Seeds {
    /// Points, on each of which a round Gaussian is put.
    Points(PointCloud),
    /// Gaussians from a file.
    Gaussians(GaussianCloud),
}

/// What the branches of a scene start from.
#[derive(Clone, Debug, PartialEq)]
pub struct InitialClouds {
    /// Seeds of the static branch, if there is one.
    pub static_: Option<Seeds>,
    /// Seeds of the dynamic branch.
    pub dynamic: Seeds,
}

impl Seeds {
    /// How many Gaussians there will be.
    pub fn len(&self) -> usize {
        match self {
            Self::Points(points) => points.len(),
            Self::Gaussians(gaussians) => gaussians.len(),
        }
    }

    /// Whether there will be none.
    pub fn is_empty(&self) -> bool {
        self.len() == 0
    }

    /// Smallest and largest coordinate along each axis, or `None` if there are no seeds.
    pub fn bounds(&self) -> Option<(Vec3, Vec3)> {
        match self {
            Self::Points(points) => points.bounds(),
            Self::Gaussians(gaussians) => gaussians.bounds(),
        }
    }
}

impl InitialClouds {
    /// Draws the clouds of a scene, or reads those of which the configuration names a file. Where the dynamic branch
    /// is the only one, it starts from the points that would otherwise be the static one's as well.
    ///
    /// # Errors
    /// If a file of Gaussians cannot be read, holds none, or more than the configuration allows.
    pub fn draw(scene: &Scene, config: &Config, stream: &mut Stream) -> Result<Self, ModelError> {
        let (init, densify) = (&config.init, &config.densify);
        // Drawn in any case, so that a branch which is drawn does not depend on where the other one comes from.
        let (static_, dynamic) = draw_points(scene, config.model.branches, init, stream);
        let dynamic = match &init.dynamic_ply {
            Some(path) => DYNAMIC_FILE.read(path, densify.dynamic.max_gaussians, config.model.sh_degree)?,
            None => Seeds::Points(dynamic),
        };
        let static_ = match (static_, &init.static_ply) {
            (Some(_), Some(path)) => {
                Some(STATIC_FILE.read(path, densify.static_.max_gaussians, config.model.sh_degree)?)
            }
            (points, _) => points.map(Seeds::Points),
        };
        Ok(Self { static_, dynamic })
    }
}

/// A key that names a file of Gaussians.
struct FileKey {
    key: &'static str,
    /// What to do about a file of too many.
    too_many: &'static str,
}

const STATIC_FILE: FileKey = FileKey {
    key: "init.static_ply",
    too_many: "that is more than `densify.static.max_gaussians`; raise that, or thin the file out",
};

const DYNAMIC_FILE: FileKey = FileKey {
    key: "init.dynamic_ply",
    too_many: "that is more than `densify.dynamic.max_gaussians`; raise that, or thin the file out",
};

impl FileKey {
    /// The Gaussians of a file.
    fn read(&self, path: &Path, most: usize, sh_degree: usize) -> Result<Seeds, ModelError> {
        let cloud = mvfusion_data::read_gaussians(path)?;
        let count = cloud.len();
        let refuse = |reason| ModelError::Config {
            key: self.key,
            value: format!("{} with {count} Gaussians", path.display()),
            reason,
        };
        if count == 0 {
            return Err(refuse("a branch needs at least one to start from"));
        }
        if count > most {
            return Err(refuse(self.too_many));
        }
        if cloud.sh_degree > sh_degree {
            let (has, file) = (cloud.sh_degree, path.display());
            tracing::warn!("{file} has colours of degree {has}, `model.sh_degree` is {sh_degree}: the rest is dropped");
        }
        Ok(Seeds::Gaussians(cloud))
    }
}

/// The points that the static branch starts from, if there is one, and those of the dynamic branch.
fn draw_points(
    scene: &Scene,
    branches: Branches,
    config: &InitConfig,
    stream: &mut Stream,
) -> (Option<PointCloud>, PointCloud) {
    let region = region(scene, config);
    let mut known = scene.points.clone();
    strew(&mut known, config.static_points, &region, stream);
    sky(&mut known, config.sky_points, scene, stream);
    if branches == Branches::Dynamic {
        strew(&mut known, config.dynamic_points, &region, stream);
        return (None, known);
    }

    let mut dynamic = PointCloud::default();
    let most = (scene.points.len() as f64 * config.dynamic_cloud_share) as usize;
    for index in stream.permutation(scene.points.len()).into_iter().take(config.dynamic_from_cloud.min(most)) {
        let colour = if config.dynamic_cloud_colours { scene.points.colours[index] } else { random_colour(stream) };
        dynamic.push(scene.points.positions[index], colour);
    }
    // What was to be put on points is strewn as well where there are none.
    let strewn = config.dynamic_points + if scene.points.is_empty() { config.dynamic_from_cloud } else { 0 };
    strew(&mut dynamic, strewn, &region, stream);
    if known.is_empty() && config.static_ply.is_none() {
        // Without points from structure from motion, the static branch starts from random ones as well.
        tracing::warn!("the scene has no points; the static branch starts from {} random ones", dynamic.len());
        known = dynamic.clone();
    }
    (Some(known), dynamic)
}

/// The box that random points are strewn in: the cloud's with its margin, but not farther from the cameras than
/// `box_reach` extents.
/// Without a cloud it is the cameras' own neighbourhood.
fn region(scene: &Scene, config: &InitConfig) -> Bounds {
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

fn strew(cloud: &mut PointCloud, count: usize, region: &Bounds, stream: &mut Stream) {
    for _ in 0..count {
        let position =
            DVec3::from_array(std::array::from_fn(|axis| stream.uniform(region.min[axis], region.max[axis])));
        cloud.push(position.as_vec3(), random_colour(stream));
    }
}

/// Points on a sphere around the cameras, twice as far as the farthest point, in random colours (METHOD §3, "sky").
fn sky(cloud: &mut PointCloud, count: usize, scene: &Scene, stream: &mut Stream) {
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

/// DeGauss' random colour: a constant coefficient drawn from `[0, 1)`, so a colour of 0.5 to 0.78.
fn random_colour(stream: &mut Stream) -> Vec3 {
    Vec3::from_array(std::array::from_fn(|_| (0.5 + SH_C0 * stream.unit()) as f32))
}

/// Whether Gaussians carry mask logits.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Masking {
    /// They do: those of a dynamic branch that is blended with a static one.
    Blended {
        /// Logit of belonging to the foreground; the other two start at 0.
        dynamic_logit: f64,
    },
    /// They do not.
    Absent,
}

/// Gaussians on the points of a cloud (METHOD §1.1, column "init").
pub fn gaussians_on(
    cloud: &PointCloud,
    masking: Masking,
    sh_degree: usize,
    opacity: f64,
    device: &Device,
    dtype: DType,
) -> Gaussians {
    let count = cloud.len();
    let flat = |values: &[Vec3]| -> Vec<f64> { values.iter().flat_map(|v| v.to_array().map(f64::from)).collect() };
    let logit = (opacity / (1.0 - opacity)).ln();
    let log_scales = mean_squared_distances(&cloud.positions)
        .into_iter()
        .flat_map(|squared| [squared.max(MIN_SQUARED_DISTANCE).sqrt().ln(); 3])
        .collect();

    let tensor = |values, columns| attribute_tensor(values, columns, device, dtype);
    // Proof of the `expect`: `from_tensors` needs every attribute but the mask logits, and each arm but theirs is `Some`.
    Gaussians::from_tensors(|attribute| match attribute {
        Attribute::Means => Some(tensor(flat(&cloud.positions), 3)),
        Attribute::ShDc => Some(tensor(flat(&cloud.colours).into_iter().map(|c| (c - 0.5) / SH_C0).collect(), 3)),
        Attribute::ShRest => {
            Some(rest_tensor(vec![0.0; count * rest_width(sh_degree)], count, sh_degree, device, dtype))
        }
        Attribute::OpacityLogits => Some(tensor(vec![logit; count], 1)),
        Attribute::LogScales => Some(tensor(Vec::clone(&log_scales), 3)),
        Attribute::Quaternions => Some(tensor([1.0, 0.0, 0.0, 0.0].repeat(count), 4)),
        Attribute::MaskLogits => match masking {
            Masking::Blended { dynamic_logit } => Some(tensor([0.0, 0.0, dynamic_logit].repeat(count), 3)),
            Masking::Absent => None,
        },
    })
    // Proof: each arm above is `Some` but that of the mask logits, which a cloud without masking may lack.
    .expect("every attribute but the mask logits is given above")
}

/// The Gaussians of a cloud, with colours of the given degree. Masks are the cloud's; where it has none, or they are
/// of no use, it is as on points.
pub fn gaussians_of(
    cloud: &GaussianCloud,
    masking: Masking,
    sh_degree: usize,
    device: &Device,
    dtype: DType,
) -> Gaussians {
    let cloud = cloud.clone().at_degree(sh_degree);
    let masks = match (masking, &cloud.mask_logits) {
        (Masking::Absent, _) => None,
        (Masking::Blended { .. }, Some(logits)) => Some(doubles(logits.as_flattened())),
        (Masking::Blended { dynamic_logit }, None) => Some([0.0, 0.0, dynamic_logit].repeat(cloud.len())),
    };
    let tensor = |values, columns| attribute_tensor(values, columns, device, dtype);
    Gaussians::from_tensors(|attribute| match attribute {
        Attribute::Means => Some(tensor(doubles(cloud.means.as_flattened()), 3)),
        Attribute::ShDc => Some(tensor(doubles(cloud.sh_dc.as_flattened()), 3)),
        Attribute::ShRest => Some(rest_tensor(doubles(&cloud.sh_rest), cloud.len(), sh_degree, device, dtype)),
        Attribute::OpacityLogits => Some(tensor(doubles(&cloud.opacity_logits), 1)),
        Attribute::LogScales => Some(tensor(doubles(cloud.log_scales.as_flattened()), 3)),
        Attribute::Quaternions => Some(tensor(doubles(cloud.quaternions.as_flattened()), 4)),
        Attribute::MaskLogits => masks.clone().map(|masks| tensor(masks, 3)),
    })
    // Proof: each arm above is `Some` but that of the mask logits, which a cloud without masking may lack.
    .expect("every attribute but the mask logits is given above")
}

/// The higher colour coefficients of `count` Gaussians. No numbers would not tell how many rows there are.
fn rest_tensor(values: Vec<f64>, count: usize, sh_degree: usize, device: &Device, dtype: DType) -> Tensor<2> {
    match rest_width(sh_degree) {
        0 => Tensor::zeros([count, 0], (device, dtype)),
        width => attribute_tensor(values, width, device, dtype),
    }
}

fn doubles(values: &[f32]) -> Vec<f64> {
    values.iter().map(|&value| f64::from(value)).collect()
}

/// Mean of the squared distances to the three nearest other points, in double precision. Fewer than four points count the
/// points there are; a single point has distance 0.
pub fn mean_squared_distances(positions: &[Vec3]) -> Vec<f64> {
    /// Neighbours that set the scale of a Gaussian (3DGS).
    const NEIGHBOURS: usize = 3;
    let points: Vec<[f64; 3]> = positions.iter().map(|p| p.to_array().map(f64::from)).collect();
    if points.len() < 2 {
        return vec![0.0; points.len()];
    }
    // Proof: a leaf of this tree takes however many points coincide, and 2^32 Gaussians with the two moments of each of
    // their 59 numbers would need 3 TB.
    let tree: ImmutableKdTree<f64, 3> =
        ImmutableKdTree::new_from_slice(&points).expect("only more than 2^32 points cannot be indexed");
    let wanted = std::num::NonZeroUsize::MIN.saturating_add(NEIGHBOURS);
    points
        .par_iter()
        .map(|point| {
            // The point itself is among its nearest, at distance 0: dropping one zero drops it or an equal twin.
            let mut squared: Vec<f64> = tree
                .query(point)
                .nearest_n::<SquaredEuclidean<f64>>(wanted)
                .execute()
                .iter()
                .map(|found| found.distance)
                .collect();
            squared.sort_by(f64::total_cmp);
            let others = &squared[1..];
            others.iter().sum::<f64>() / others.len() as f64
        })
        .collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_scale_of_a_gaussian_comes_from_its_three_nearest_neighbours() {
        let line: Vec<Vec3> = (0..5).map(|i| Vec3::new(i as f32, 0.0, 0.0)).collect();
        let squared = mean_squared_distances(&line);
        assert!((squared[0] - (1.0 + 4.0 + 9.0) / 3.0).abs() < 1e-12);
        assert!((squared[2] - (1.0 + 1.0 + 4.0) / 3.0).abs() < 1e-12);
    }

    #[test]
    fn twins_are_neighbours_at_distance_zero() {
        let squared = mean_squared_distances(&[Vec3::ONE; 6]);
        assert!(squared.iter().all(|&s| s == 0.0));
        assert_eq!(mean_squared_distances(&[Vec3::ONE]), [0.0]);
        assert_eq!(mean_squared_distances(&[]), Vec::<f64>::new());
    }
}
