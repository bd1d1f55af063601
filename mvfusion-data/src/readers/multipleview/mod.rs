//! Custom multi-camera videos as 4DGaussians prepares them: `camNN/frame_00001.jpg`, a COLMAP model in `sparse_`, and
//! `points3D_multipleview.ply`.
//!
//! Assumptions:
//! * The model has one image per camera: `imageN.jpg` for `camNN`, matched by number. Cameras that COLMAP could not
//!   place are skipped, and so are images without a camera folder. Both are logged.
//! * Frames are sorted and matched by the number at the end of the file name, as in the module `neu3d`. A frame's time
//!   is its index divided by the number of frames (`ReadOptions::time`).
//! * Every frame trains. As in 4DGS (METHOD §5.7), the test views are also training views: the first frame of each
//!   camera, and those after a third and two thirds of the time. Metrics on them measure the fit of the training
//!   images, not novel views. The option `test_cameras` holds whole cameras out instead.
//! * Lenses may have any of COLMAP's models. 4DGS takes the first camera's focal length for all; here each camera has
//!   its own.
//! * Only the near bounds of `poses_bounds_multipleview.npy` are read, in the model's world.

#[cfg(test)]
mod tests;

use std::collections::BTreeMap;
use std::path::Path;

use tracing::{info, warn};

use super::colmap;
use super::colmap::model;
use super::colmap::model::{Model, Photo};
use super::format::Format;
use super::options::ReadOptions;
use super::reader::{Hints, Reader};
use super::shared::frames::{CameraFrames, Frame, camera_names, list_frames};
use super::shared::ply::read_first;
use super::shared::poses::{near_bound, read_rows};
use super::shared::shot::{FrameLens, Shot};
use super::shared::views::views;
use crate::error::DataError;
use crate::files::scene_name;
use crate::scene::{Capture, Scene, View};

impl Format {
    /// Multi-camera videos as 4DGaussians prepares them: see [`multipleview`](crate::readers::multipleview).
    pub const MULTIPLEVIEW: Self = Self::new("multipleview", "MultipleView");
}

/// The entry in the table of readers.
pub(super) const READER: Reader =
    Reader { format: Format::MULTIPLEVIEW, recognise, read, hints: Hints::of_poses(colmap::POSES) };

/// Folder of the model.
const SPARSE: &str = "sparse_";

const BOUNDS: &str = "poses_bounds_multipleview.npy";

/// Names of point clouds. The first that exists is read. The model also has points.
const POINTS: [&str; 2] = ["points3D_multipleview.ply", "fused.ply"];

/// The reason why `folder` is not in this format; `None` if it is.
pub fn recognise(folder: &Path) -> Option<String> {
    let known = folder.join(POINTS[0]).is_file() || folder.join(SPARSE).is_dir();
    (!known).then(|| format!("it needs folders cam01, cam02, … with frames, {SPARSE} and {}", POINTS[0]))
}

/// Reads a scene (METHOD §5.7). Only the headers of the images are read here.
///
/// # Errors
/// A [`DataError`] that names the problem with the folder, a file in it or an option.
pub fn read(folder: &Path, options: &ReadOptions) -> Result<Scene, DataError> {
    let Model { photos, points } = model::read(&folder.join(SPARSE))?;
    let posed = posed_cameras(folder, photos)?;
    let names: Vec<String> = posed.iter().map(|(name, _)| name.clone()).collect();
    let rig = list_frames(folder, &names, "", options)?;
    let count = rig[0].frames.len();
    let divisor = options.times_divisor(count)?;
    let shots = rig.iter().zip(&posed).flat_map(|(camera, (_, photo))| shots(camera, photo, divisor)).collect();
    let train = views(folder, shots, options)?;
    let test = looked_at(&train, count);
    let points = read_first(folder, &POINTS)?.unwrap_or(points);
    let near = near(folder)?;
    let name = scene_name(folder);
    info!(
        "{name}: {} cameras x {count} frames, {} points; the test views are {} of the training views, as in 4DGS: hold \
         cameras out with `--set 'scene.test_cameras=[{:?}]'`",
        names.len(),
        points.len(),
        test.len(),
        names[0]
    );
    Ok(Scene { name, capture: Capture::Video, train, test, points, near })
}

/// The cameras with frames and a pose, by folder name.
fn posed_cameras(folder: &Path, photos: Vec<Photo>) -> Result<Vec<(String, Photo)>, DataError> {
    let mut numbered = BTreeMap::new();
    for photo in photos {
        let number = number_of(&photo.view_name(), "image").ok_or_else(|| odd_photo(folder, &photo.name))?;
        if let Some(twin) = numbered.insert(number, photo) {
            return Err(twins(folder, format!("the image {} of the model", twin.name), number));
        }
    }
    let (mut posed, mut unposed) = (BTreeMap::new(), Vec::new());
    for name in camera_names(folder)? {
        let Some(number) = number_of(&name, "cam") else { continue };
        if let Some((twin, _)) = posed.get(&number) {
            return Err(twins(folder, format!("the camera {twin}"), number));
        }
        match numbered.remove(&number) {
            Some(photo) => drop(posed.insert(number, (name, photo))),
            None => unposed.push(name),
        }
    }
    if !unposed.is_empty() {
        let unposed = unposed.join(", ");
        warn!(folder = %folder.display(), "{unposed} have no pose in {SPARSE} and are left out");
    }
    if !numbered.is_empty() {
        let names = numbered.into_values().map(|photo| photo.name).collect::<Vec<_>>().join(", ");
        warn!(folder = %folder.display(), "{names} of {SPARSE} have no camera folder and are left out");
    }
    if posed.is_empty() {
        let advice =
            format!("The image1.jpg of {SPARSE} is that of the camera cam01, and its frames lie in a folder cam01");
        let what = "camera with frames and a pose".into();
        return Err(DataError::Missing { what, folder: folder.to_owned(), advice });
    }
    Ok(posed.into_values().collect())
}

/// The number in a name that consists of a word and a number.
fn number_of(name: &str, word: &str) -> Option<u32> {
    let digits = name.strip_prefix(word)?;
    // The parser would accept a sign.
    digits.parse().ok().filter(|_| digits.bytes().all(|b| b.is_ascii_digit()))
}

/// The frames of a camera.
fn shots(camera: &CameraFrames, photo: &Photo, divisor: f64) -> Vec<Shot> {
    let shot = |(index, frame): (usize, &Frame)| Shot {
        name: format!("{}/{}", camera.name, frame.name),
        source: frame.source.clone(),
        mask: None,
        lens: FrameLens::Known { lens: photo.lens, size: photo.size },
        rotation: photo.rotation,
        translation: photo.translation,
        time: index as f64 / divisor,
    };
    camera.frames.iter().enumerate().map(shot).collect()
}

/// The test views, for cameras of `count` frames each.
fn looked_at(views: &[View], count: usize) -> Vec<View> {
    let mut frames = vec![0, count / 3, 2 * count / 3];
    frames.dedup();
    views.chunks(count).flat_map(|camera| frames.iter().map(|&frame| camera[frame].clone())).collect()
}

/// The smallest near bound, if all cameras have one.
fn near(folder: &Path) -> Result<Option<f64>, DataError> {
    let path = folder.join(BOUNDS);
    if !path.is_file() {
        return Ok(None);
    }
    let bounds: Option<Vec<f64>> = read_rows(&path)?.iter().map(near_bound).collect();
    Ok(bounds.map(|bounds| bounds.into_iter().fold(f64::INFINITY, f64::min)))
}

fn odd_photo(folder: &Path, name: &str) -> DataError {
    DataError::Content {
        path: folder.join(SPARSE),
        reason: format!("its image {name} is of no camera that could be told"),
        advice: "Images of the model are named image1.jpg for cam01, and so on",
    }
}

fn twins(folder: &Path, first: String, number: u32) -> DataError {
    DataError::Disagreement {
        folder: folder.to_owned(),
        first: format!("{first} has the number {number}"),
        second: "another one has it as well".into(),
        advice: "Cameras and images belong together by their numbers: rename or remove one of the two".into(),
    }
}
