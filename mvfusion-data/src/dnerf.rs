//! Scenes of D-NeRF, and of NeRF's Blender export: `transforms_train.json`, `transforms_test.json` and the pictures.
//!
//! What is assumed of them:
//! * Cameras as the module `transforms` says; one `camera_angle_x` for all.
//! * `transforms_test.json` is held out. The moving `lego` shows another shape there than in the pictures to train on: of that
//!   scene, which is told by its folder's name, `transforms_val.json` is held out if it is there.
//! * `time` stands in every frame, or in none: then nothing moves, and every time is 0.
//! * Times are divided by the largest of both files, as 4DGS does (METHOD §5.6).
//! * Pictures are RGBA; what is transparent shows the colour behind the scene, `model.background`.
//! * Without a point cloud (`fused.ply`, `points3d.ply`) training starts from 2000 random points in a cube of side 2.6, where
//!   the synthetic objects stand; their colours are grey but for the last digit.
//! * Departure: 4DGS resizes all pictures to 800 x 800; here they stay as they are.

use std::path::Path;

use glam::Vec3;
use rand::RngExt;
use rand::SeedableRng;
use rand_chacha::ChaCha8Rng;
use tracing::info;

use crate::ply::{GREY, read_first};
use crate::reader::scene_name;
use crate::shot::views;
use crate::transforms::{Frame, Transforms};
use crate::{Capture, DataError, PointCloud, ReadOptions, Scene};

/// Name of the format, for messages.
pub const FORMAT: &str = "D-NeRF";

const TRAIN: &str = "transforms_train.json";
const TEST: &str = "transforms_test.json";
const VALIDATION: &str = "transforms_val.json";

/// The scene whose test pictures do not fit.
const LEGO: &str = "lego";

/// Point clouds, the first that exists.
const POINTS: [&str; 2] = ["fused.ply", "points3d.ply"];

/// Random points where there is no cloud (4DGS), and half the side of their cube.
const RANDOM_POINTS: usize = 2000;
const HALF_SIDE: f32 = 1.3;

/// Why `folder` is not in this format, or `None` if it is.
pub fn recognise(folder: &Path) -> Option<String> {
    (!folder.join(TRAIN).is_file()).then(|| format!("it needs {TRAIN} and {TEST}; {TRAIN} is not there"))
}

/// Whether `folder` has a point cloud, so that none is strewn.
pub(crate) fn has_points(folder: &Path) -> bool {
    POINTS.iter().any(|name| folder.join(name).is_file())
}

/// Reads a D-NeRF scene (METHOD §5.6).
///
/// # Errors
/// A [`DataError`] that says what is wrong with the folder, a file in it or an option.
pub fn read(folder: &Path, options: &ReadOptions) -> Result<Scene, DataError> {
    let train = Transforms::read(&folder.join(TRAIN))?;
    let held_out = held_out_file(folder, &train);
    let test = Transforms::read(&folder.join(held_out))?;
    let times = times(folder, [&train, &test])?;
    let shots = train.frames.iter().chain(&test.frames).zip(times).map(|(frame, time)| frame.shot(time)).collect();
    let mut train_views = views(folder, shots, options)?;
    let test_views = train_views.split_off(train.frames.len());
    let name = scene_name(folder);
    let points = read_first(folder, &POINTS)?.unwrap_or_else(random_points);
    info!("{name}: {} pictures to train on, {} held out, {} points", train_views.len(), test_views.len(), points.len());
    Ok(Scene { name, capture: Capture::Video, train: train_views, test: test_views, points, near: None })
}

/// The file whose pictures are held out.
fn held_out_file(folder: &Path, train: &Transforms) -> &'static str {
    let is_moving = train.frames.iter().any(|frame| frame.time.is_some());
    let is_lego = scene_name(folder).eq_ignore_ascii_case(LEGO) && is_moving;
    if !(is_lego && folder.join(VALIDATION).is_file()) {
        return TEST;
    }
    info!("{LEGO} shows another shape in {TEST}: the pictures of {VALIDATION} are held out instead");
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

/// Brightness per unit of a spherical harmonic of degree 0.
const HARMONIC: f32 = 0.282_094_8;

/// Points strewn where the object stands, the same each time. Their harmonics are random numbers below 1/255 (METHOD §5.6).
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
