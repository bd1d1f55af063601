//! The two initial clouds of Gaussians: on points (METHOD §3), where motion was detected, or from files of other
//! programs.

mod gaussians;
mod motion;
mod neighbours;
mod placement;
mod points;
mod seeding;

use std::path::Path;

use mvfusion_data::{GaussianCloud, Lifetime, PointCloud, Scene};

pub use gaussians::{Masking, cloud_on, gaussians_of, gaussians_on};
pub use motion::{MotionPoints, SceneMotion};
pub use neighbours::mean_squared_distances;
pub use placement::Placement;
pub use seeding::Seeding;

use crate::ModelError;
use crate::config::{Branches, Config, InitConfig};
use crate::random::Stream;
use neighbours::mean_squared_distances_within;
use points::{random_colour, region, sky, strew};

/// Initial duration of a permanent Gaussian: a thousand times the length of the video.
const ALWAYS: f32 = 1000.0;

/// Minimum number of uniform Gaussians, also with births, because they determine the box of the HexPlane.
const LEAST_STREWN: usize = 64;

/// The initial Gaussians of the branches. Gaussians on points have SH degree 0, Gaussians from a file the degree of the
/// file.
#[derive(Clone, Debug, PartialEq)]
pub struct InitialClouds {
    /// The static branch, if there is one.
    pub static_: Option<GaussianCloud>,
    /// The dynamic branch.
    pub dynamic: GaussianCloud,
}

impl InitialClouds {
    /// Draws the clouds of a scene, or reads them from the configured files. A single dynamic branch also starts from
    /// the points that would otherwise be static. Points on detected motion replace the uniform points.
    ///
    /// # Errors
    /// If a file of Gaussians cannot be read, or contains none or more than the configuration allows.
    pub fn draw(
        scene: &Scene,
        motion: Option<&MotionPoints>,
        config: &Config,
        stream: &mut Stream,
    ) -> Result<Self, ModelError> {
        let (init, densify, degree) = (&config.init, &config.densify, config.model.sh_degree);
        let motion = motion.filter(|motion| !motion.points.is_empty());
        // Always drawn, so that a drawn branch does not depend on the source of the other branch.
        let strewn = match motion {
            Some(_) => 0,
            None if config.has_births(scene) => init.dynamic_points.saturating_sub(init.photo_points).max(LEAST_STREWN),
            None => init.dynamic_points,
        };
        let drawn =
            draw_points(scene, config.model.branches, &InitConfig { dynamic_points: strewn, ..init.clone() }, stream);
        let mut dynamic = match &init.dynamic_ply {
            Some(path) => DYNAMIC_FILE.read(path, densify.dynamic.max_gaussians, degree)?,
            None => dynamic_cloud(&drawn.dynamic, motion, config),
        };
        if !config.model.lifetime {
            dynamic.lifetimes = None;
        } else if dynamic.lifetimes.is_none() {
            dynamic.lifetimes = Some(vec![always(); dynamic.len()]);
        }
        let static_ = match (&drawn.static_, &init.static_ply) {
            (Some(_), Some(path)) => Some(STATIC_FILE.read(path, densify.static_.max_gaussians, degree)?),
            (points, _) => points.as_ref().map(|points| on_points(points, init.opacity)),
        };
        // Static Gaussians have no lifetimes, also if their file contains some.
        let static_ = static_.map(|cloud| GaussianCloud { lifetimes: None, ..cloud });
        Ok(Self { static_, dynamic })
    }
}

/// Isotropic Gaussians with scales from the distances between the points of a cloud.
fn on_points(points: &PointCloud, opacity: f64) -> GaussianCloud {
    cloud_on(points, &mean_squared_distances(&points.positions), opacity)
}

/// The initial lifetime of a permanent Gaussian; training may shorten it.
fn always() -> Lifetime {
    Lifetime { centre: 0.5, log_duration: ALWAYS.ln(), velocity: [0.0; 3] }
}

/// The dynamic branch: permanent Gaussians, then those on detected motion. With lifetimes, the latter live around their
/// moment, and their scale is from the distances between the points of that moment.
fn dynamic_cloud(points: &PointCloud, motion: Option<&MotionPoints>, config: &Config) -> GaussianCloud {
    let init = &config.init;
    let mut cloud = on_points(points, init.opacity);
    let Some(motion) = motion else { return cloud };
    let positions = &motion.points.positions;
    let squared = match config.model.lifetime {
        true => mean_squared_distances_within(
            positions,
            &motion.times.iter().map(|time| time.to_bits()).collect::<Vec<_>>(),
        ),
        false => mean_squared_distances(positions),
    };
    let seeds = cloud_on(&motion.points, &squared, init.opacity);
    let log_duration = (init.motion_duration * motion.frame).ln() as f32;
    let brief = |&time: &f64| Lifetime { centre: time as f32, log_duration, velocity: [0.0; 3] };
    let lifetimes = vec![always(); cloud.len()].into_iter().chain(motion.times.iter().map(brief)).collect();
    let logits = |count, dynamic: f64| vec![[0.0, 0.0, dynamic as f32]; count];
    let masks = [logits(cloud.len(), init.dynamic_logit), logits(seeds.len(), init.motion_logit)].concat();
    cloud = cloud.joined(seeds);
    (cloud.lifetimes, cloud.mask_logits) = (Some(lifetimes), Some(masks));
    cloud
}

/// A key for a file of Gaussians.
struct FileKey {
    key: &'static str,
    /// The remedy for too many Gaussians.
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
    /// Reads the Gaussians of a file.
    fn read(&self, path: &Path, most: usize, sh_degree: usize) -> Result<GaussianCloud, ModelError> {
        let cloud = mvfusion_data::read_gaussians(path)?;
        let count = cloud.len();
        let refuse = |reason: &str| ModelError::Config {
            key: self.key.to_owned(),
            value: format!("{} with {count} Gaussians", path.display()),
            reason: reason.to_owned(),
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
        Ok(cloud)
    }
}

/// The points of the two branches.
struct DrawnPoints {
    /// Points of the static branch, if there is one.
    static_: Option<PointCloud>,
    /// Points of the dynamic branch.
    dynamic: PointCloud,
}

/// Draws the initial points of the static branch, if there is one, and of the dynamic branch.
fn draw_points(scene: &Scene, branches: Branches, config: &InitConfig, stream: &mut Stream) -> DrawnPoints {
    let region = region(scene, config);
    let mut known = scene.points.clone();
    strew(&mut known, config.static_points, &region, stream);
    sky(&mut known, config.sky_points, scene, stream);
    if branches == Branches::Dynamic {
        strew(&mut known, config.dynamic_points, &region, stream);
        return DrawnPoints { static_: None, dynamic: known };
    }

    let mut dynamic = PointCloud::default();
    let most = (scene.points.len() as f64 * config.dynamic_cloud_share) as usize;
    for index in stream.permutation(scene.points.len()).into_iter().take(config.dynamic_from_cloud.min(most)) {
        let colour = if config.dynamic_cloud_colours { scene.points.colours[index] } else { random_colour(stream) };
        dynamic.push(scene.points.positions[index], colour);
    }
    // Without points, Gaussians for points are placed uniformly, too.
    let strewn = config.dynamic_points + if scene.points.is_empty() { config.dynamic_from_cloud } else { 0 };
    strew(&mut dynamic, strewn, &region, stream);
    if known.is_empty() && config.static_ply.is_none() {
        // Without points from structure from motion, the static branch also starts from random points.
        tracing::warn!("the scene has no points; the static branch starts from {} random ones", dynamic.len());
        known = dynamic.clone();
    }
    DrawnPoints { static_: Some(known), dynamic }
}
