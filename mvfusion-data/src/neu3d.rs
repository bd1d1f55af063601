//! Scenes in the layout of Neu3D (DyNeRF): `camNN/images/*` or `camNN.mp4`, `poses_bounds.npy` and a point cloud.
//!
//! What is assumed of them:
//! * The rows of `poses_bounds.npy` follow the sorted names of the cameras, whose numbering may have gaps.
//! * Pixels are square and the principal point lies in the middle; a row's focal length is for its own picture width.
//! * All cameras have equally many frames, in the order of the numbers at the end of the files' names. Extracted frames come
//!   before a video of the same camera.
//! * The first camera is held out. A frame's time is its index / number of frames (`ReadOptions::time`).

use std::path::Path;

use tracing::{info, warn};

pub use crate::poses::{ROW, camera_from_row};

use crate::frames::{CameraFrames, Frame, camera_names, list_frames};
use crate::ply::{read_first, warn_of_none};
use crate::poses::{near_bound, read_rows};
use crate::reader::scene_name;
use crate::shot::{FrameLens, Shot, views};
use crate::{Camera, Capture, DataError, PointCloud, ReadOptions, Scene, multipleview};

/// Name of the format, for messages.
pub const FORMAT: &str = "Neu3D";

const POSES: &str = "poses_bounds.npy";

/// Folder of the extracted frames in that of a camera.
const FRAMES: &str = "images";

/// Point clouds, the first that exists: DeGauss' name, 4DGaussians' name, the name of others.
const POINTS: [&str; 3] = ["fused.ply", "points3D_downsample2.ply", "points3D.ply"];

/// How the shape of the pictures may differ from that in `poses_bounds.npy` before the user is told.
const SHAPE_TOLERANCE: f64 = 0.01;

/// Why `folder` is not in this format, or `None` if it is.
///
/// # Errors
/// [`DataError::Folder`] if the folder cannot be listed.
pub fn recognise(folder: &Path) -> Result<Option<String>, DataError> {
    // A scene of that format has folders of cameras as well, and its poses elsewhere.
    let cameras = !camera_names(folder)?.is_empty() && multipleview::recognise(folder).is_some();
    Ok((!cameras && !folder.join(POSES).is_file())
        .then(|| format!("it needs folders cam00/images, cam01/images, … with frames, and {POSES}")))
}

/// Reads a Neu3D scene (METHOD §5.1). The first camera is the test camera, all others train. Only the headers of the
/// pictures are read here.
///
/// # Errors
/// A [`DataError`] that says what is wrong with the folder, a file in it or an option.
pub fn read(folder: &Path, options: &ReadOptions) -> Result<Scene, DataError> {
    if let Some(reason) = recognise(folder)? {
        let what = format!("{FORMAT} scene");
        return Err(DataError::Missing { what, folder: folder.to_owned(), advice: format!("For that {reason}") });
    }
    let names = camera_names(folder)?;
    let rows = rows_for(folder, &names)?;
    let rig = list_frames(folder, &names, FRAMES, options)?;
    let count = rig[0].frames.len();
    let divisor = options.times_divisor(count)?;
    let shots = rig.iter().zip(&rows).flat_map(|(camera, row)| shots(camera, row, divisor)).collect();
    let mut test = views(folder, shots, options)?;
    let train = test.split_off(count);
    let camera = &test[0].camera;
    warn_of_shape(folder, &rows, camera);
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
    // With other cameras held out (see `open`) the first one trains.
    let training = if options.test_cameras.is_some() { &rows[..] } else { &rows[1..] };
    let bounds: Option<Vec<f64>> = training.iter().map(near_bound).collect();
    let near = bounds.map(|bounds| bounds.into_iter().fold(f64::INFINITY, f64::min));
    Ok(Scene { name, capture: Capture::Video, train, test, points, near })
}

/// The rows of `poses_bounds.npy`, of which there must be one for each camera.
fn rows_for(folder: &Path, names: &[String]) -> Result<Vec<[f64; ROW]>, DataError> {
    let path = folder.join(POSES);
    if !path.is_file() {
        let advice = "It holds the cameras of the scene and comes with the dataset".into();
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

/// What a camera filmed.
fn shots(camera: &CameraFrames, row: &[f64; ROW], divisor: f64) -> Vec<Shot> {
    // The pose does not depend on the size of the picture.
    let pose = camera_from_row(row, 1, 1);
    let shot = |(index, frame): (usize, &Frame)| Shot {
        name: format!("{}/{}", camera.name, frame.name),
        source: frame.source.clone(),
        mask: None,
        lens: FrameLens::Angle { focal_in_widths: row[14] / row[9] },
        rotation: pose.rotation,
        translation: pose.translation,
        time: index as f64 / divisor,
    };
    camera.frames.iter().enumerate().map(shot).collect()
}

/// Says so if the pictures have another shape than those that the cameras were made for.
fn warn_of_shape(folder: &Path, rows: &[[f64; ROW]], camera: &Camera) {
    let (width, height) = (camera.width, camera.height);
    let shape = width as f64 / height as f64;
    if let Some(row) = rows.iter().find(|r| (r[9] / r[4] / shape - 1.0).abs() > SHAPE_TOLERANCE) {
        let (w, h) = (row[9], row[4]);
        warn!(folder = %folder.display(), "the frames are {width}x{height}, {POSES} is for {w}x{h}: another shape");
    }
}

/// The first point cloud that exists; none is allowed.
fn initial_points(folder: &Path) -> Result<PointCloud, DataError> {
    let points = read_first(folder, &POINTS)?;
    if points.is_none() {
        warn_of_none(folder, &POINTS);
    }
    Ok(points.unwrap_or_default())
}

#[cfg(test)]
mod tests;
