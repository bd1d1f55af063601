//! The two initial clouds of Gaussians: on points (METHOD §3), where motion was detected, or from files of other
//! programs.

mod gaussians;
mod motion;
mod neighbours;
mod placement;
mod points;
mod seeding;

use std::path::{Path, PathBuf};

use mvfusion_data::{GaussianCloud, Lifetime, PointCloud, Scene};

pub use gaussians::{Masking, cloud_on, gaussians_of, gaussians_on};
pub use motion::{MotionPoints, SceneMotion};
pub use neighbours::{mean_squared_distances, nearest_others};
pub use placement::Placement;
pub use seeding::Seeding;

use crate::ModelError;
use crate::config::{Branches, Config, InitConfig};
use crate::random::Stream;
use neighbours::mean_squared_distances_within;
use points::{add_uniform, merged, out_of_reach, random_colour, region, sky, thinned};

/// Initial duration of a permanent Gaussian: a thousand times the length of the video.
const ALWAYS: f32 = 1000.0;

/// Minimum number of uniform Gaussians, also with births, because they determine the box of the HexPlane.
const LEAST_UNIFORM: usize = 64;

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
        let dynamic_points = if motion.is_some() { 0 } else { uniform_dynamic(config, scene) };
        let reduced = InitConfig { dynamic_points, ..init.clone() };
        let drawn = draw_points(scene, config.model.branches, &reduced, uniform(init), stream);
        let room = densify.dynamic.max_gaussians.saturating_sub(motion.map_or(0, |motion| motion.points.len()));
        let drawn = DrawnPoints {
            static_: drawn.static_.map(|points| {
                warn_of_excess("static", points.len(), densify.static_.max_gaussians, init.static_ply.as_deref());
                thinned(points, densify.static_.max_gaussians, stream)
            }),
            dynamic: {
                warn_of_excess("dynamic", drawn.dynamic.len(), room, init.dynamic_ply.as_deref());
                thinned(drawn.dynamic, room, stream)
            },
        };
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

/// Number of uniform Gaussians of a branch in a scene without points, if no other source reduces it.
fn uniform(init: &InitConfig) -> usize {
    init.dynamic_points.saturating_add(init.dynamic_from_cloud)
}

/// Number of uniform dynamic Gaussians without detected motion.
fn uniform_dynamic(config: &Config, scene: &Scene) -> usize {
    let init = &config.init;
    match config.has_births(scene) {
        true => init.dynamic_points.saturating_sub(init.photo_points).max(LEAST_UNIFORM),
        false => init.dynamic_points,
    }
}

/// Warns if a branch starts from fewer points than were drawn for it, because it never has more Gaussians than its
/// `max_gaussians`. A file of Gaussians replaces the points.
fn warn_of_excess(branch: &str, count: usize, most: usize, file: Option<&Path>) {
    if let Some(words) = excess(branch, count, most, file) {
        tracing::warn!("{words}");
    }
}

fn excess(branch: &str, count: usize, most: usize, file: Option<&Path>) -> Option<String> {
    (count > most && file.is_none()).then(|| {
        format!(
            "the {branch} branch starts from {most} of its {count} points, drawn at random, because of \
             `densify.{branch}.max_gaussians`"
        )
    })
}

/// An upper bound of the numbers of Gaussians before the first step: dynamic, static. Nothing is drawn; only files of
/// Gaussians are read.
///
/// # Errors
/// As [`InitialClouds::draw`].
pub(crate) fn initial_counts(scene: &Scene, config: &Config) -> Result<[usize; 2], ModelError> {
    let (init, densify, known) = (&config.init, &config.densify, scene.points.len());
    let from_cloud = init.dynamic_from_cloud.min((known as f64 * init.dynamic_cloud_share) as usize);
    let without_motion = uniform_dynamic(config, scene);
    let placed = without_motion.max(init.motion_points);
    let still = known.saturating_add(init.static_points).saturating_add(init.sky_points);
    let (dynamic, static_) = match config.model.branches {
        Branches::Dynamic => (still.saturating_add(placed), 0),
        Branches::Both if known == 0 => {
            let random = without_motion.saturating_add(init.dynamic_from_cloud).max(uniform(init));
            (placed.saturating_add(init.dynamic_from_cloud), if still == 0 { random } else { still })
        }
        Branches::Both => (placed.saturating_add(from_cloud), still),
    };
    let [dynamic_most, static_most] = [densify.dynamic.max_gaussians, densify.static_.max_gaussians];
    let of_file = |file: &FileKey, path: &Option<PathBuf>, most| {
        path.as_ref().map(|path| Ok::<_, ModelError>(file.checked(path, most)?.len())).transpose()
    };
    let of_dynamic = of_file(&DYNAMIC_FILE, &init.dynamic_ply, dynamic_most)?;
    let of_static = of_file(&STATIC_FILE, &init.static_ply, static_most)?;
    Ok([of_dynamic.unwrap_or(dynamic.min(dynamic_most)), of_static.unwrap_or(static_.min(static_most))])
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
    /// Reads the Gaussians of a file, and warns of colours that are lost.
    fn read(&self, path: &Path, most: usize, sh_degree: usize) -> Result<GaussianCloud, ModelError> {
        let cloud = self.checked(path, most)?;
        if cloud.sh_degree > sh_degree {
            let (has, file) = (cloud.sh_degree, path.display());
            tracing::warn!("{file} has colours of degree {has}, `model.sh_degree` is {sh_degree}: the rest is dropped");
        }
        Ok(cloud)
    }

    /// Reads the Gaussians of a file, of which there are at least one and at most `most`.
    fn checked(&self, path: &Path, most: usize) -> Result<GaussianCloud, ModelError> {
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

/// Draws the initial points of the static branch, if there is one, and of the dynamic branch. `config` has the uniform
/// dynamic Gaussians that no other source replaces. A static branch without points has at least `uniform` random ones.
fn draw_points(
    scene: &Scene,
    branches: Branches,
    config: &InitConfig,
    uniform: usize,
    stream: &mut Stream,
) -> DrawnPoints {
    let region = region(scene, config);
    // A file of Gaussians replaces the points of its branch. One branch has those of both.
    let of_static = if branches == Branches::Dynamic { &config.dynamic_ply } else { &config.static_ply };
    let draws = (config.static_points > 0 && of_static.is_none())
        || (config.dynamic_points > 0 && config.dynamic_ply.is_none());
    if let Some(words) = out_of_reach(scene, config).filter(|_| draws) {
        tracing::warn!("{words}");
    }
    // Points that coincide would be Gaussians of no size, and show nothing that one of them does not.
    let points = merged(&scene.points);
    let coinciding = scene.points.len() - points.len();
    if coinciding > 0 {
        tracing::warn!("{coinciding} of {} points coincide with others and were merged with them", scene.points.len());
    }
    let mut known = points.clone();
    add_uniform(&mut known, config.static_points, &region, stream);
    sky(&mut known, config.sky_points, scene, &region, stream);
    if branches == Branches::Dynamic {
        add_uniform(&mut known, config.dynamic_points, &region, stream);
        return DrawnPoints { static_: None, dynamic: known };
    }

    let mut dynamic = PointCloud::default();
    let most = (points.len() as f64 * config.dynamic_cloud_share) as usize;
    for index in stream.permutation(points.len()).into_iter().take(config.dynamic_from_cloud.min(most)) {
        let colour = if config.dynamic_cloud_colours { points.colours[index] } else { random_colour(stream) };
        dynamic.push(points.positions[index], colour);
    }
    // Without points, Gaussians for points are placed uniformly, too.
    let count = config.dynamic_points + if points.is_empty() { config.dynamic_from_cloud } else { 0 };
    add_uniform(&mut dynamic, count, &region, stream);
    if known.is_empty() && config.static_ply.is_none() {
        // Without points from structure from motion, the static branch also starts from random points: those of the
        // dynamic branch, unless seeds or births replace some of them.
        if dynamic.len() < uniform {
            add_uniform(&mut known, uniform, &region, stream);
        } else {
            known = dynamic.clone();
        }
        tracing::warn!("the scene has no points; the static branch starts from {} random ones", known.len());
    }
    DrawnPoints { static_: Some(known), dynamic }
}

#[cfg(test)]
mod tests {
    use mvfusion_data::{BuiltinKind, BuiltinOptions, builtin};

    use super::*;
    use crate::random::Streams;

    /// The numbers of Gaussians that are drawn: dynamic, static.
    fn drawn(scene: &Scene, config: &Config) -> [usize; 2] {
        let stream = &mut Streams::new(config.seed).clouds;
        let clouds = InitialClouds::draw(scene, None, config, stream).expect("no files are needed");
        [clouds.dynamic.len(), clouds.static_.map_or(0, |cloud| cloud.len())]
    }

    /// Scenes with points and without, of both kinds.
    fn scenes() -> Vec<Scene> {
        let of = |kind| BuiltinOptions { width: 16, height: 12, frames: 2, photos: 4, ..BuiltinOptions::of_kind(kind) };
        let with = [BuiltinKind::Video, BuiltinKind::Casual].map(|kind| builtin::builtin(&of(kind)));
        let without = with.clone().map(|scene| Scene { points: PointCloud::default(), ..scene });
        with.into_iter().chain(without).collect()
    }

    #[test]
    fn counts_are_known_before_anything_is_drawn() {
        for scene in scenes() {
            for branches in [Branches::Both, Branches::Dynamic] {
                for (sky, births) in [(0, 0), (50, 0), (50, 30)] {
                    let mut config = Config::default();
                    (config.init.dynamic_points, config.init.sky_points) = (300, sky);
                    (config.init.photo_points, config.model.lifetime) = (births, births > 0);
                    config.model.branches = branches;
                    let counts = initial_counts(&scene, &config).expect("no files are needed");
                    assert_eq!(counts, drawn(&scene, &config), "{} {branches:?} {sky} {births}", scene.name);
                }
            }
        }
    }

    #[test]
    fn seeds_on_motion_take_no_points_from_the_static_branch() {
        // A video without points.
        let scene = scenes().remove(2);
        let mut config = Config::default();
        (config.init.dynamic_points, config.init.motion_points) = (300, 5);
        let mut points = PointCloud::default();
        (0..5).for_each(|index| points.push(glam::Vec3::splat(index as f32), glam::Vec3::ONE));
        let motion = MotionPoints { times: vec![0.0; 5], points, frame: 1.0 };
        let stream = &mut Streams::new(config.seed).clouds;
        let clouds = InitialClouds::draw(&scene, Some(&motion), &config, stream).expect("no files are needed");
        let from_cloud = config.init.dynamic_from_cloud;
        let static_ = clouds.static_.map_or(0, |cloud| cloud.len());
        assert_eq!([clouds.dynamic.len(), static_], [from_cloud + 5, from_cloud + 300]);
        assert_eq!(initial_counts(&scene, &config).expect("no files are needed")[1], static_);
    }

    #[test]
    fn no_branch_starts_with_more_gaussians_than_it_may_have() {
        for scene in scenes() {
            let mut config = Config::default();
            (config.init.dynamic_points, config.init.static_points) = (300, 100);
            (config.densify.dynamic.max_gaussians, config.densify.static_.max_gaussians) = (70, 90);
            assert_eq!(drawn(&scene, &config), [70, 90]);
            assert_eq!(initial_counts(&scene, &config).expect("no files are needed"), [70, 90]);
        }
    }

    #[test]
    fn only_points_that_a_branch_starts_from_are_said_to_be_too_many() {
        let said = excess("static", 100, 90, None).expect("ten are left out");
        assert!(said.starts_with("the static branch starts from 90 of its 100 points"), "{said}");
        assert_eq!(excess("static", 100, 90, Some(Path::new("static.ply"))), None);
        assert_eq!(excess("dynamic", 90, 90, None), None);
    }

    #[test]
    fn points_that_coincide_give_one_gaussian() {
        let mut scene = scenes().remove(0);
        let (all, one) = (scene.points.clone(), scene.points.positions[7]);
        (0..1000).for_each(|_| scene.points.push(one, glam::Vec3::ONE));
        let config = Config::default();
        assert_eq!(drawn(&scene, &config)[1], all.len());
    }
}
