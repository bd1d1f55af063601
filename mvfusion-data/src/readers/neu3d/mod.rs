//! Scenes in the layout of Neu3D (DyNeRF): `camNN/images/*` or `camNN.mp4`, `poses_bounds.npy` and a point cloud.
//!
//! Assumptions:
//! * The rows of `poses_bounds.npy` follow the sorted names of the cameras. Their numbers may have gaps.
//! * Pixels are square and the principal point is centred. A row's focal length refers to the image width in that row.
//! * Extracted frames take precedence over a video of the same camera. They are sorted by the number at the end of the
//!   file name. Frames of several cameras with the same number show the same moment, and no camera lacks a number that
//!   another one has. Without such numbers, frames are matched by their order.
//! * The first camera is held out. A frame's time is its index divided by the number of frames (`ReadOptions::time`).

#[cfg(test)]
mod tests;

use std::path::Path;

use tracing::{info, warn};

pub use super::shared::poses::{ROW, camera_from_row};

use super::format::Format;
use super::multipleview;
use super::options::ReadOptions;
use super::reader::{Hints, Reader, UsualSize};
use super::shared::frames::{CameraFrames, Frame, camera_names, list_frames};
use super::shared::ply::{read_first, warn_of_none};
use super::shared::poses::{near_bound, read_rows};
use super::shared::shot::{FrameLens, Shot};
use super::shared::sizes::is_scaled;
use super::shared::views::views;
use crate::error::DataError;
use crate::files::scene_name;
use crate::scene::{Camera, Capture, PointCloud, Scene};

impl Format {
    /// Multi-camera videos in the layout of Neu3D: see [`neu3d`](crate::readers::neu3d).
    pub const NEU3D: Self = Self::new("neu3d", "Neu3D");
}

/// The entry in the table of readers.
pub(super) const READER: Reader = Reader { format: Format::NEU3D, recognise, read, hints: HINTS };

const HINTS: Hints = Hints { usual_size, odd_shape, ..Hints::of_poses(CONVENTION) };

/// The convention of the poses.
const CONVENTION: &str = "Rows of poses_bounds.npy lead from the camera to the world, and their columns are the camera's \
                          down, right and backward axes and its centre.";

/// Usual width for training and evaluation.
const USUAL_WIDTH: f64 = 1352.0;

const POSES: &str = "poses_bounds.npy";

/// Folder of the extracted frames within a camera's folder.
const FRAMES: &str = "images";

/// Names of point clouds in DeGauss, in 4DGaussians, and in common use. The first that exists is read.
const POINTS: [&str; 3] = ["fused.ply", "points3D_downsample2.ply", "points3D.ply"];

/// Largest relative deviation of the images' aspect ratio from `poses_bounds.npy` without a warning.
const SHAPE_TOLERANCE: f64 = 0.01;

/// The reason why `folder` is not in this format; `None` if it is.
pub fn recognise(folder: &Path) -> Option<String> {
    // A MultipleView scene also has folders of cameras, but its poses are elsewhere.
    let has_cameras = camera_names(folder).is_ok_and(|names| !names.is_empty());
    let is_known = folder.join(POSES).is_file() || (has_cameras && multipleview::recognise(folder).is_some());
    (!is_known).then(|| format!("it needs folders cam00/images, cam01/images, … with frames, and {POSES}"))
}

/// The size at which papers train the scene.
fn usual_size(_: &Scene, width: f64) -> Option<UsualSize> {
    Some(UsualSize { factor: (width / USUAL_WIDTH).round().max(2.0), source: "papers train Neu3D at 1352x1014" })
}

/// Reads a Neu3D scene (METHOD §5.1). The first camera is the test camera, all others train. Only the headers of the
/// images are read here.
///
/// # Errors
/// A [`DataError`] that names the problem with the folder, a file in it or an option.
pub fn read(folder: &Path, options: &ReadOptions) -> Result<Scene, DataError> {
    let names = camera_names(folder)?;
    if let Some(reason) = recognise(folder) {
        let what = format!("{} scene", Format::NEU3D.name());
        return Err(DataError::Missing { what, folder: folder.to_owned(), advice: format!("For that {reason}") });
    }
    let rows = rows_for(folder, &names)?;
    let rig = list_frames(folder, &names, FRAMES, options)?;
    let count = rig[0].frames.len();
    let divisor = options.times_divisor(count)?;
    let shots = rig.iter().zip(&rows).flat_map(|(camera, row)| shots(camera, row, divisor)).collect();
    let mut test = views(folder, shots, options)?;
    let train = test.split_off(count);
    let camera = &test[0].camera;
    if let Some(difference) = difference_in_shape(&rows, camera) {
        warn!(folder = %folder.display(), "{difference}");
    }
    let points = initial_points(folder)?;
    let name = scene_name(folder);
    info!(
        "{name}: {} cameras x {count} frames at {}x{}, {} points; {} is held out",
        names.len(),
        camera.width,
        camera.height,
        points.len(),
        names[0]
    );
    // If other cameras are held out (see `open`), the first one trains.
    let training = if options.test_cameras.is_some() { &rows[..] } else { &rows[1..] };
    let bounds: Option<Vec<f64>> = training.iter().map(near_bound).collect();
    let near = bounds.map(|bounds| bounds.into_iter().fold(f64::INFINITY, f64::min));
    Ok(Scene { name, capture: Capture::Video, train, test, points, near })
}

/// The rows of `poses_bounds.npy`. There must be one for each camera.
fn rows_for(folder: &Path, names: &[String]) -> Result<Vec<[f64; ROW]>, DataError> {
    let path = folder.join(POSES);
    if !path.is_file() {
        let advice = "It holds the cameras of the scene and comes with the dataset. For videos of your own, `mvfusion \
                      prepare` finds the cameras"
            .into();
        return Err(DataError::Missing { what: POSES.into(), folder: folder.to_owned(), advice });
    }
    if names.len() < 2 {
        let what = format!("second camera folder camNN/images ({} found)", names.len());
        let advice = "The first camera is held out for testing, so at least two are needed".into();
        return Err(DataError::Missing { what, folder: folder.to_owned(), advice });
    }
    let rows = read_rows(&path)?;
    if rows.len() != names.len() {
        return Err(DataError::Disagreement {
            folder: folder.to_owned(),
            first: format!("{POSES} has {} rows", rows.len()),
            second: format!("there are {} cameras ({} … {})", names.len(), names[0], names[names.len() - 1]),
            advice: "Rows follow the sorted names of the cameras: remove the rows or the cameras that have no partner"
                .into(),
        });
    }
    Ok(rows)
}

/// The frames of a camera.
fn shots(camera: &CameraFrames, row: &[f64; ROW], divisor: f64) -> Vec<Shot> {
    // The pose does not depend on the size of the image.
    let pose = camera_from_row(row, 1, 1);
    let shot = |(index, frame): (usize, &Frame)| Shot {
        name: format!("{}/{}", camera.name, frame.name),
        source: frame.source.clone(),
        mask: None,
        lens: FrameLens::Angle { focal_in_widths: row[14] / row[9], focal_in_heights: None },
        rotation: pose.rotation,
        translation: pose.translation,
        time: index as f64 / divisor,
    };
    camera.frames.iter().enumerate().map(shot).collect()
}

/// As [`difference_in_shape`], for a scene that was read.
fn odd_shape(folder: &Path, scene: &Scene) -> Option<String> {
    let rows = read_rows(&folder.join(POSES)).ok()?;
    difference_in_shape(&rows, &scene.train.first()?.camera)
}

/// How the aspect ratio of the images differs from that of the cameras; `None` if it does not.
fn difference_in_shape(rows: &[[f64; ROW]], camera: &Camera) -> Option<String> {
    let (width, height) = (camera.width, camera.height);
    let shape = width as f64 / height as f64;
    let is_odd = |row: &&[f64; ROW]| {
        (row[9] / row[4] / shape - 1.0).abs() > SHAPE_TOLERANCE
            && !is_scaled((row[9], row[4]), (width as f64, height as f64))
    };
    let row = rows.iter().find(is_odd)?;
    Some(format!("the frames are {width}x{height}, but {POSES} is for {}x{}, which is another shape", row[9], row[4]))
}

/// The first point cloud that exists. There may be none.
fn initial_points(folder: &Path) -> Result<PointCloud, DataError> {
    let points = read_first(folder, &POINTS)?;
    if points.is_none() {
        warn_of_none(folder, &POINTS);
    }
    Ok(points.unwrap_or_default())
}
