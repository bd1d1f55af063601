//! Scenes in the layout of Neu3D (DyNeRF): `camNN/images/*`, `poses_bounds.npy` and a point cloud.

use std::path::{Path, PathBuf};

use serde::{Deserialize, Serialize};
use tracing::{info, warn};

pub use crate::poses::{ROW, camera_from_row};

use crate::frames::{CameraFrames, camera_names, list_frames};
use crate::picture::{common_size, reduced_size};
use crate::ply::read_points;
use crate::poses::{near_bound, read_rows};
use crate::{Camera, Capture, DataError, Picture, PointCloud, Scene, Truth, View};

/// Name of the format, for messages.
pub const FORMAT: &str = "Neu3D";

const POSES: &str = "poses_bounds.npy";

/// Point clouds, the first that exists: DeGauss' name, 4DGaussians' name, the name of others.
const POINTS: [&str; 3] = ["fused.ply", "points3D_downsample2.ply", "points3D.ply"];

/// Number of frames by which the original divides a frame's index (METHOD §5.1).
const ORIGINAL_FRAMES: usize = 300;

/// How the shape of the pictures may differ from that in `poses_bounds.npy` before the user is told.
const SHAPE_TOLERANCE: f64 = 0.01;

/// How a Neu3D scene is read.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct Neu3dOptions {
    /// Pictures are made smaller by this factor, at least 1. Default 1.
    pub downscale: f64,
    /// How many frames of each camera are used, from the first on; all if absent. Default 300, as in the original.
    pub frames: Option<usize>,
    /// How a frame's index becomes a time.
    pub time: TimeRule,
}

/// How a frame's index becomes a time in `[0, 1]`.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum TimeRule {
    /// Index / number of frames used; the same as the original for 300 frames. The default.
    #[default]
    FrameOverCount,
    /// Index / 300, as in the original (METHOD §5.1), however many frames there are.
    #[serde(rename = "frame-over-300")]
    FrameOver300,
}

impl Default for Neu3dOptions {
    fn default() -> Self {
        Self { downscale: 1.0, frames: Some(ORIGINAL_FRAMES), time: TimeRule::default() }
    }
}

/// Why `folder` is not in this format, or `None` if it is.
///
/// # Errors
/// [`DataError::Folder`] if the folder cannot be listed.
pub fn recognise(folder: &Path) -> Result<Option<String>, DataError> {
    let cameras = camera_names(folder)?;
    Ok((cameras.is_empty() && !folder.join(POSES).is_file())
        .then(|| format!("it needs folders cam00/images, cam01/images, … with frames, and {POSES}")))
}

/// Reads a Neu3D scene (METHOD §5.1). The first camera is the test camera, all others train. Only the headers of the
/// pictures are read here.
///
/// # Errors
/// A [`DataError`] that says what is wrong with the folder, a file in it or an option.
pub fn read(folder: &Path, options: &Neu3dOptions) -> Result<Scene, DataError> {
    if let Some(reason) = recognise(folder)? {
        let what = format!("{FORMAT} scene");
        return Err(DataError::Missing { what, folder: folder.to_owned(), advice: format!("For that {reason}") });
    }
    check_options(options)?;
    let names = camera_names(folder)?;
    let rows = rows_for(folder, &names)?;
    let rig = list_frames(folder, &names, options.frames.unwrap_or(usize::MAX))?;
    let files: Vec<&PathBuf> = rig.iter().flat_map(|camera| &camera.frames).collect();
    let size = common_size(folder, &files, "All frames of a scene must have one size: extract them again")?;
    let count = rig[0].frames.len();
    let divisor = times_divisor(options, count)?;
    let cameras = cameras(folder, &rows, size, options)?;

    let mut views = rig.iter().zip(&cameras).map(|(frames, camera)| views_of(frames, camera, divisor));
    // `rows_for` made sure that there are two cameras.
    let test = views.next().unwrap_or_default();
    let train = views.flatten().collect();
    let points = initial_points(folder)?;
    let name = folder.file_name().map_or_else(|| FORMAT.into(), |n| n.to_string_lossy().into_owned());
    let (width, height) = (cameras[0].width, cameras[0].height);
    info!(
        "{name}: {} cameras x {count} frames at {width}x{height}, {} points; {} is held out",
        names.len(),
        points.len(),
        names[0]
    );
    let bounds: Option<Vec<f64>> = rows[1..].iter().map(near_bound).collect();
    let near = bounds.map(|bounds| bounds.into_iter().fold(f64::INFINITY, f64::min));
    Ok(Scene { name, capture: Capture::Video, train, test, points, near })
}

fn check_options(options: &Neu3dOptions) -> Result<(), DataError> {
    if options.frames == Some(0) {
        let reason = "at least one frame is needed; leave it out for all".into();
        return Err(DataError::Setting { option: "frames", value: "0".into(), reason });
    }
    Ok(())
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

fn times_divisor(options: &Neu3dOptions, count: usize) -> Result<f64, DataError> {
    match options.time {
        TimeRule::FrameOverCount => Ok(count as f64),
        TimeRule::FrameOver300 if count <= ORIGINAL_FRAMES => Ok(ORIGINAL_FRAMES as f64),
        TimeRule::FrameOver300 => Err(DataError::Setting {
            option: "time",
            value: "frame-over-300".into(),
            reason: format!(
                "{count} frames would reach beyond time 1; set frames = 300 or time = \"frame-over-count\""
            ),
        }),
    }
}

/// The cameras for pictures of `size` pixels on disk, made smaller as the options say.
fn cameras(
    folder: &Path,
    rows: &[[f64; ROW]],
    (width, height): (u32, u32),
    options: &Neu3dOptions,
) -> Result<Vec<Camera>, DataError> {
    let (small_width, small_height) = reduced_size((width, height), options.downscale)?;
    let shape = f64::from(width) / f64::from(height);
    if let Some(row) = rows.iter().find(|r| (r[9] / r[4] / shape - 1.0).abs() > SHAPE_TOLERANCE) {
        let (w, h) = (row[9], row[4]);
        warn!(folder = %folder.display(), "the frames are {width}x{height}, {POSES} is for {w}x{h}: another shape");
    }
    let camera = |row| camera_from_row(row, width as usize, height as usize);
    Ok(rows.iter().map(|row| camera(row).resized(small_width as usize, small_height as usize)).collect())
}

fn views_of(rig: &CameraFrames, camera: &Camera, divisor: f64) -> Vec<View> {
    let view = |(index, path): (usize, &PathBuf)| View {
        name: format!("{}/{}", rig.name, path.file_stem().unwrap_or_default().to_string_lossy()),
        camera: *camera,
        time: index as f64 / divisor,
        image: Picture::File { path: path.clone(), width: camera.width as u32, height: camera.height as u32 },
        truth: Truth::default(),
    };
    rig.frames.iter().enumerate().map(view).collect()
}

/// The first point cloud that exists; none is allowed.
fn initial_points(folder: &Path) -> Result<PointCloud, DataError> {
    match POINTS.iter().map(|name| folder.join(name)).find(|path| path.is_file()) {
        Some(path) => read_points(&path),
        None => {
            let names = POINTS.join(", ");
            warn!(folder = %folder.display(), "no point cloud ({names}): training starts from random points");
            Ok(PointCloud::default())
        }
    }
}

#[cfg(test)]
mod tests;
