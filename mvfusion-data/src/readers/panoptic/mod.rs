//! Scenes of Dynamic 3D Gaussians from CMU's Panoptic Studio: `train_meta.json`, `test_meta.json`, the images in `ims`,
//! and `init_pt_cld.npz`.
//!
//! Assumptions:
//! * `fn[time][camera]` is an image below `ims`. `k[time][camera]` is its 3x3 intrinsics for images of `w` by `h`
//!   pixels. `w2c[time][camera]` is the 4x4 pose from the world to OpenCV axes. There is no distortion.
//!   `cam_id[time][camera]` identifies the camera; without it, the position in the list does.
//! * Both files have the same times. An image's time is its time's index divided by the number of times
//!   (`ReadOptions::time`). If the names of a camera's images end in increasing numbers, these are the numbers of
//!   frames, and all images of one time have the same. The cameras of `test_meta.json` are held out.
//! * Views are named by the image, `0/000012`: the camera's number and the frame's.
//! * The array `data` of `init_pt_cld.npz` has one point per row: x, y, z, then red, green, blue up to 1. A foreground
//!   flag follows and is skipped. Without this file, `fused.ply` or `points3D.ply` is read.

mod matrices;
mod moments;
#[cfg(test)]
mod tests;

use std::path::Path;

use glam::{DVec2, Vec3};
use serde::Deserialize;
use tracing::info;

use super::format::Format;
use super::options::ReadOptions;
use super::reader::{Hints, Reader};
use super::shared::ply::{read_first, warn_of_none};
use super::shared::shot::{FrameLens, Shot};
use super::shared::views::views;
use crate::error::DataError;
use crate::files::{COPY_OR_MEND, below, read_json, read_npz, scene_name};
use crate::scene::{Capture, PictureSource, PointCloud, Scene, check_place};
use matrices::Matrix;
use moments::{ListedImage, Moments, common_times};

impl Format {
    /// Scenes of Dynamic 3D Gaussians: see [`panoptic`](crate::readers::panoptic).
    pub const PANOPTIC: Self = Self::new("panoptic", "Panoptic");
}

/// The entry in the table of readers.
pub(super) const READER: Reader = Reader { format: Format::PANOPTIC, recognise, read, hints: Hints::of_poses(POSES) };

/// The convention of the poses.
const POSES: &str = "A w2c leads from the world to the camera: x right, y down, z forward.";

const TRAIN: &str = "train_meta.json";
const TEST: &str = "test_meta.json";

/// Folder of the images.
const PICTURES: &str = "ims";

/// The file of the points, and the array in it.
const ARCHIVE: &str = "init_pt_cld.npz";
const ARRAY: &str = "data";

/// Names of point clouds that replace it. The first that exists is read.
const POINTS: [&str; 2] = ["fused.ply", "points3D.ply"];

/// A file of cameras as stored. All lists are indexed by time, then by camera.
#[derive(Debug, Deserialize)]
struct Record {
    w: f64,
    h: f64,
    k: Vec<Vec<Matrix>>,
    w2c: Vec<Vec<Matrix>>,
    #[serde(rename = "fn")]
    names: Vec<Vec<String>>,
    cam_id: Option<Vec<Vec<i64>>>,
}

/// A file of cameras.
#[derive(Debug)]
struct Meta {
    moments: Moments,
    /// Camera by camera, each with the index of its time.
    shots: Vec<(usize, Shot)>,
}

/// The reason why `folder` is not in this format; `None` if it is.
pub fn recognise(folder: &Path) -> Option<String> {
    (!folder.join(TRAIN).is_file())
        .then(|| format!("it needs {TRAIN}, {TEST}, {PICTURES} and {ARCHIVE}; {TRAIN} is not there"))
}

/// Reads a scene (METHOD §5.7). Only the headers of the images are read here.
///
/// # Errors
/// A [`DataError`] that names the problem with the folder, a file in it or an option.
pub fn read(folder: &Path, options: &ReadOptions) -> Result<Scene, DataError> {
    let limit = options.frame_limit()?;
    let metas = [read_meta(folder, TRAIN, limit)?, read_meta(folder, TEST, limit)?];
    let count = common_times(folder, metas.each_ref().map(|meta| &meta.moments), limit)?;
    options.warn_of_unused_frames(folder, metas[0].moments.times);
    let divisor = options.times_divisor(count)?;
    let [mut shots, held_out] = metas.map(|meta| meta.timed(count, divisor));
    let parted = shots.len();
    if parted == 0 {
        let advice = format!("{TRAIN} lists no camera: copy it again from the dataset");
        return Err(DataError::Missing { what: "image to train on".into(), folder: folder.to_owned(), advice });
    }
    shots.extend(held_out);
    let mut train = views(folder, shots, options)?;
    let test = train.split_off(parted);
    let points = points(folder)?;
    let name = scene_name(folder);
    info!(
        "{name}: {} images to train on and {} held out, at {count} times, {} points",
        train.len(),
        test.len(),
        points.len()
    );
    Ok(Scene { name, capture: Capture::Video, train, test, points, near: None })
}

impl Meta {
    /// The shots of the first `count` times.
    fn timed(self, count: usize, divisor: f64) -> Vec<Shot> {
        let shots = self.shots.into_iter().filter(|(time, _)| *time < count);
        shots.map(|(time, shot)| Shot { time: time as f64 / divisor, ..shot }).collect()
    }
}

/// Reads a file. All lists must have the same shape, all entries must be valid cameras, and all images of one of the
/// first `limit` times must have the same number.
fn read_meta(folder: &Path, file: &'static str, limit: usize) -> Result<Meta, DataError> {
    let path = folder.join(file);
    if !path.is_file() {
        let advice = format!("{TRAIN} and {TEST} come together with the dataset");
        return Err(DataError::Missing { what: file.into(), folder: folder.to_owned(), advice });
    }
    let record: Record = read_json(&path, COPY_OR_MEND)?;
    let shots = record.shots(&folder.join(PICTURES));
    let shots = shots.map_err(|reason| DataError::Content { path, reason, advice: COPY_OR_MEND })?;
    Ok(Meta { moments: Moments::of(folder, file, record.names.len(), limit, record.images())?, shots })
}

impl Record {
    /// The shots camera by camera, each with the index of its time.
    fn shots(&self, pictures: &Path) -> Result<Vec<(usize, Shot)>, String> {
        self.check_shapes()?;
        let size = DVec2::new(self.w, self.h);
        if !(size.is_finite() && size.min_element() > 0.0) {
            return Err(format!("its w and h are {} and {}", self.w, self.h));
        }
        let mut shots = Vec::new();
        for (time, names) in self.names.iter().enumerate() {
            for (place, name) in names.iter().enumerate() {
                let shot = self.shot(time, place, size, pictures);
                let shot = shot.map_err(|reason| format!("time {time}, camera {place} ({name}): {reason}"))?;
                shots.push((self.camera(time, place), (time, shot)));
            }
        }
        // Camera by camera, like the views of other formats. The times of each camera stay in order.
        shots.sort_by_key(|(camera, _)| *camera);
        Ok(shots.into_iter().map(|(_, shot)| shot).collect())
    }

    /// The camera of an image of the lists, whose shapes were checked.
    fn camera(&self, time: usize, place: usize) -> i64 {
        self.cam_id.as_ref().map_or(place as i64, |ids| ids[time][place])
    }

    /// All images of the lists, in the order of time.
    fn images(&self) -> impl Iterator<Item = ListedImage<'_>> {
        self.names.iter().enumerate().flat_map(move |(time, names)| {
            let image = move |(place, name)| ListedImage { time, camera: self.camera(time, place), name };
            names.iter().map(String::as_str).enumerate().map(image)
        })
    }

    /// Checks that every list has an entry for each image.
    fn check_shapes(&self) -> Result<(), String> {
        let of = |lists: Vec<usize>, what: &str| {
            let wanted = self.names.iter().map(Vec::len);
            if lists.len() != self.names.len() {
                return Err(format!("`{what}` has {} times, but `fn` has {}", lists.len(), self.names.len()));
            }
            let other = lists.iter().zip(wanted).enumerate().find(|(_, (count, wanted))| *count != wanted);
            other.map_or(Ok(()), |(time, (count, wanted))| {
                Err(format!("`{what}` has {count} cameras at time {time}, but `fn` has {wanted}"))
            })
        };
        of(self.k.iter().map(Vec::len).collect(), "k")?;
        of(self.w2c.iter().map(Vec::len).collect(), "w2c")?;
        self.cam_id.as_ref().map_or(Ok(()), |ids| of(ids.iter().map(Vec::len).collect(), "cam_id"))
    }

    /// The shot of an image. Its time is set once the number of times is known.
    fn shot(&self, time: usize, place: usize, size: DVec2, pictures: &Path) -> Result<Shot, String> {
        let name = &self.names[time][place];
        let path = below(pictures, name)?;
        let lens = FrameLens::Known { lens: matrices::lens(&self.k[time][place])?, size };
        let (rotation, translation) = matrices::pose(&self.w2c[time][place])?;
        let name = Path::new(name.strip_prefix("./").unwrap_or(name)).with_extension("");
        let name = name.to_string_lossy().into_owned();
        Ok(Shot { name, source: PictureSource::Image(path), mask: None, lens, rotation, translation, time: 0.0 })
    }
}

/// The first point cloud that exists. There may be none.
fn points(folder: &Path) -> Result<PointCloud, DataError> {
    let path = folder.join(ARCHIVE);
    if path.is_file() {
        return archived_points(&path).map_err(|reason| DataError::Content {
            path: path.clone(),
            reason,
            advice: "Copy it again from the dataset, or remove it to start without these points",
        });
    }
    let points = read_first(folder, &POINTS)?;
    if points.is_none() {
        warn_of_none(folder, &[ARCHIVE, POINTS[0], POINTS[1]]);
    }
    Ok(points.unwrap_or_default())
}

fn archived_points(path: &Path) -> Result<PointCloud, String> {
    let mut points = PointCloud::default();
    for (index, row) in read_npz(path, ARRAY, 6..=usize::MAX)?.rows().enumerate() {
        let [position, colour] = [0, 3].map(|at| Vec3::from_array(std::array::from_fn(|axis| row[at + axis] as f32)));
        if !(position.is_finite() && colour.is_finite()) {
            return Err(format!("row {index} of `{ARRAY}` holds a number that is not finite: {row:?}"));
        }
        check_place(position).map_err(|reason| format!("row {index} of `{ARRAY}` {reason}"))?;
        points.push(position, colour.clamp(Vec3::ZERO, Vec3::ONE));
    }
    Ok(points)
}
