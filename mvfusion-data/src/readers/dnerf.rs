//! D-NeRF scenes and NeRF's Blender export: `transforms_train.json`, `transforms_test.json` and the images.
//!
//! Assumptions:
//! * Cameras follow the module `transforms`. All share one `camera_angle_x`.
//! * `transforms_test.json` is held out. Only the moving `lego`, recognised by its folder's name, has test images of
//!   another shape than its training images. Its `transforms_val.json` is held out instead, if present.
//! * Either all frames have `time` or none has. In the latter case nothing moves, and every time is 0.
//! * Times are divided by the largest time of both files, as in 4DGS (METHOD §5.6).
//! * Images are RGBA. Transparent pixels show the background colour, `model.background`.
//! * Without a point cloud (`fused.ply`, `points3d.ply`) training starts from 2000 random points. They fill a cube of
//!   side 2.6 around the synthetic objects and are nearly grey.
//! * Departure: 4DGS resizes all images to 800 x 800; we keep their size.

use std::path::Path;

use glam::Vec3;
use rand::RngExt;
use rand::SeedableRng;
use rand_chacha::ChaCha8Rng;
use tracing::info;

use super::format::Format;
use super::options::ReadOptions;
use super::reader::{Hints, Reader};
use super::shared::ply::{GREY, read_first};
use super::shared::transforms::{Frame, POSES, Transforms, ignored_masks};
use super::shared::views::views;
use crate::error::DataError;
use crate::files::scene_name;
use crate::scene::{Capture, PointCloud, Scene};

impl Format {
    /// Synthetic scenes: see [`dnerf`](crate::readers::dnerf).
    pub const DNERF: Self = Self::new("dnerf", "D-NeRF");
}

/// The entry in the table of readers.
pub(super) const READER: Reader = Reader {
    format: Format::DNERF,
    recognise,
    read,
    hints: Hints { has_random_points, ignored_masks, ..Hints::of_poses(POSES) },
};

const TRAIN: &str = "transforms_train.json";
const TEST: &str = "transforms_test.json";
const VALIDATION: &str = "transforms_val.json";

/// The scene whose test images do not fit.
const LEGO: &str = "lego";

/// Names of point clouds. The first that exists is read.
const POINTS: [&str; 2] = ["fused.ply", "points3d.ply"];

/// Number of random points if there is no point cloud (4DGS), and half the side of their cube.
const RANDOM_POINTS: usize = 2000;
const HALF_SIDE: f32 = 1.3;

/// The reason why `folder` is not in this format; `None` if it is.
pub fn recognise(folder: &Path) -> Option<String> {
    (!folder.join(TRAIN).is_file()).then(|| format!("it needs {TRAIN} and {TEST}; {TRAIN} is not there"))
}

/// Whether `folder` has no point cloud, so that random points replace it.
fn has_random_points(folder: &Path) -> bool {
    !POINTS.iter().any(|name| folder.join(name).is_file())
}

/// Reads a D-NeRF scene (METHOD §5.6).
///
/// # Errors
/// A [`DataError`] that names the problem with the folder, a file in it or an option.
pub fn read(folder: &Path, options: &ReadOptions) -> Result<Scene, DataError> {
    let train = Transforms::read(&folder.join(TRAIN))?;
    let held_out = held_out_file(folder, &train);
    if !folder.join(held_out).is_file() {
        let advice = format!(
            "{TRAIN} and {TEST} come together with the dataset; of footage of your own, move some frames of {TRAIN} to \
             {TEST}"
        );
        return Err(DataError::Missing { what: held_out.into(), folder: folder.to_owned(), advice });
    }
    let test = Transforms::read(&folder.join(held_out))?;
    let times = times(folder, [&train, &test])?;
    let shots = train.frames.iter().chain(&test.frames).zip(times).map(|(frame, time)| frame.shot(time)).collect();
    let mut train_views = views(folder, shots, options)?;
    let test_views = train_views.split_off(train.frames.len());
    let name = scene_name(folder);
    let points = read_first(folder, &POINTS)?.unwrap_or_else(random_points);
    info!("{name}: {} images to train on, {} held out, {} points", train_views.len(), test_views.len(), points.len());
    Ok(Scene { name, capture: Capture::Video, train: train_views, test: test_views, points, near: None })
}

/// The file of the held-out images.
fn held_out_file(folder: &Path, train: &Transforms) -> &'static str {
    let is_moving = train.frames.iter().any(|frame| frame.time.is_some());
    let is_lego = scene_name(folder).eq_ignore_ascii_case(LEGO) && is_moving;
    if !(is_lego && folder.join(VALIDATION).is_file()) {
        return TEST;
    }
    info!("{LEGO} shows another shape in {TEST}: the images of {VALIDATION} are held out instead");
    VALIDATION
}

/// The times of the frames of both files, divided by the largest.
fn times(folder: &Path, files: [&Transforms; 2]) -> Result<Vec<f64>, DataError> {
    let frames: Vec<(&Transforms, &Frame)> =
        files.into_iter().flat_map(|file| file.frames.iter().map(move |frame| (file, frame))).collect();
    let without: Vec<&Frame> = frames.iter().map(|(_, frame)| *frame).filter(|frame| frame.time.is_none()).collect();
    if let Some(first) = without.first().filter(|_| without.len() != frames.len()) {
        return Err(DataError::Disagreement {
            folder: folder.to_owned(),
            first: format!("{} of {} frames have no time ({})", without.len(), frames.len(), first.name),
            second: "the others have one".into(),
            advice: "Give every frame a `time`, or none".into(),
        });
    }
    let times: Vec<f64> = frames.iter().map(|(_, frame)| frame.time.unwrap_or(0.0)).collect();
    if let Some(at) = times.iter().position(|time| *time < 0.0) {
        let (file, frame) = frames[at];
        return Err(DataError::Content {
            path: file.path.clone(),
            reason: format!("the time of {} is {}", frame.name, times[at]),
            advice: "Times begin at 0",
        });
    }
    let largest = times.iter().copied().fold(0.0, f64::max);
    Ok(times.into_iter().map(|time| if largest > 0.0 { time / largest } else { 0.0 }).collect())
}

/// Value of the spherical harmonic of degree 0.
const HARMONIC: f32 = 0.282_094_8;

/// Random points around the object, the same each time. Their harmonics are random numbers below 1/255 (METHOD §5.6).
fn random_points() -> PointCloud {
    let mut random = ChaCha8Rng::seed_from_u64(0);
    let mut points = PointCloud::default();
    for _ in 0..RANDOM_POINTS {
        let mut triple =
            |low: f32, high: f32| Vec3::from_array(std::array::from_fn(|_| random.random_range(low..high)));
        let position = triple(-HALF_SIDE, HALF_SIDE);
        points.push(position, GREY + HARMONIC / 255.0 * triple(0.0, 1.0));
    }
    points
}
