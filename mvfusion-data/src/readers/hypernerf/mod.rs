//! Captures of Nerfies and HyperNeRF, and DyCheck's in their format: moving scenes from one or two hand-held cameras.
//!
//! Assumptions:
//! * `dataset.json` lists the images' names, `ids`, and splits them into `train_ids` and `val_ids`. If `val_ids` is
//!   empty, every fourth image trains. The second after each of these is held out, except the last (METHOD §5.5).
//! * `camera/<id>.json` contains an OpenCV camera for images of `image_size`. `orientation` rotates from the world to
//!   the camera, `position` is its centre. `pixel_aspect_ratio` is the focal length along y divided by that along x.
//!   Pixel centres are at +0.5, and there is no skew.
//! * `rgb/<k>x/<id>.png` are the images, k times smaller. The option `downscale` selects the folder with that number,
//!   otherwise the next finer one, otherwise the finest. Images are resized only by the remaining factor. (4DGS and
//!   DeGauss always read `2x`.)
//! * An image's time is its `warp_id` in `metadata.json`, divided by the largest.
//! * Points (`fused.ply`, `points3D_downsample2.ply`, `points.npy`) and cameras share one world and are not
//!   transformed. Nerfies applies the similarity `center` and `scale` of `scene.json` to both; METHOD §5.5 omits it.
//!   `near` is in scaled units.
//! * `covisible/` of DyCheck marks the valid pixels of its metrics. It is not a training mask and is not read here.

mod camera;
mod dataset;
#[cfg(test)]
mod tests;

use std::path::{Path, PathBuf};

use serde::Deserialize;
use tracing::info;

use super::format::Format;
use super::options::ReadOptions;
use super::reader::{Hints, Reader};
use super::shared::ply::{GREY, read_first, warn_of_none};
use super::shared::shot::Shot;
use super::shared::views::views;
use crate::error::DataError;
use crate::files::{COPY_OR_MEND, read_json, read_npy, scene_name};
use crate::scene::{Capture, LARGEST_COORDINATE, PictureSource, PointCloud, Scene, check_place};
use dataset::{DATASET, METADATA, Part, parts, times};

impl Format {
    /// Captures of Nerfies and HyperNeRF: see [`hypernerf`](crate::readers::hypernerf).
    pub const HYPERNERF: Self = Self::new("hypernerf", "HyperNeRF");
}

/// The entry in the table of readers.
pub(super) const READER: Reader = Reader { format: Format::HYPERNERF, recognise, read, hints: Hints::of_poses(POSES) };

/// The convention of the poses.
const POSES: &str = "An orientation leads from the world to the camera (x right, y down, z forward), a position is the \
                     camera's centre.";

const SCENE: &str = "scene.json";

/// Folder of the folders of images.
const PICTURES: &str = "rgb";

/// Points without colours. They are read if no other point cloud exists.
const BARE_POINTS: &str = "points.npy";

/// Names of point clouds. The first that exists is read.
const POINTS: [&str; 2] = ["fused.ply", "points3D_downsample2.ply"];

/// The entries of `scene.json` that we use.
#[derive(Debug, Deserialize)]
struct SceneRecord {
    scale: Option<f64>,
    near: Option<f64>,
}

/// The reason why `folder` is not in this format; `None` if it is.
pub fn recognise(folder: &Path) -> Option<String> {
    (!folder.join(DATASET).is_file())
        .then(|| format!("it needs {DATASET}, {METADATA} and folders camera and {PICTURES}/2x; {DATASET} is not there"))
}

/// Reads a capture (METHOD §5.5). Only the headers of the images are read here.
///
/// # Errors
/// A [`DataError`] that names the problem with the folder, a file in it or an option.
pub fn read(folder: &Path, options: &ReadOptions) -> Result<Scene, DataError> {
    let (ids, parts) = parts(&folder.join(DATASET))?;
    let times = times(&folder.join(METADATA), &ids)?;
    let (pictures, downscale) = picture_folder(folder, options.downscale)?;
    let of = |wanted: Part| {
        let used = ids.iter().zip(&times).zip(&parts).filter(move |(_, part)| **part == Some(wanted));
        used.map(|((id, time), _)| shot(folder, &pictures, id, *time)).collect::<Result<Vec<_>, _>>()
    };
    let (mut shots, held_out) = (of(Part::Train)?, of(Part::Test)?);
    let count = shots.len();
    if count == 0 {
        let advice = format!("{DATASET} must list some in `ids`, and in `train_ids` unless `val_ids` is empty");
        return Err(DataError::Missing { what: "image to train on".into(), folder: folder.to_owned(), advice });
    }
    shots.extend(held_out);
    let mut train = views(folder, shots, &ReadOptions { downscale, ..options.clone() })?;
    let test = train.split_off(count);
    let points = points(folder)?;
    let near = near(folder)?;
    let name = scene_name(folder);
    info!(
        "{name}: {} images to train on, {} held out, {} unused, {} points",
        train.len(),
        test.len(),
        ids.len() - train.len() - test.len(),
        points.len()
    );
    Ok(Scene { name, capture: Capture::Video, train, test, points, near })
}

fn shot(folder: &Path, pictures: &Path, id: &str, time: f64) -> Result<Shot, DataError> {
    let camera = camera::read(&folder.join("camera").join(format!("{id}.json")))?;
    Ok(Shot {
        name: id.to_owned(),
        source: PictureSource::Image(pictures.join(format!("{id}.png"))),
        mask: None,
        lens: camera.lens,
        rotation: camera.rotation,
        translation: camera.translation,
        time,
    })
}

/// The folder of the images, and the factor of `downscale` that remains to be applied.
fn picture_folder(folder: &Path, downscale: f64) -> Result<(PathBuf, f64), DataError> {
    let pictures = folder.join(PICTURES);
    let fail = |e: std::io::Error| DataError::Folder {
        folder: pictures.clone(),
        reason: e.to_string(),
        advice: "Put the images there, in a folder 2x or the like",
    };
    let mut factors = Vec::new();
    for entry in std::fs::read_dir(&pictures).map_err(fail)? {
        let path = entry.map_err(fail)?.path();
        let number = path.file_name().and_then(|name| name.to_str()?.strip_suffix('x')).unwrap_or("");
        // Only canonical numbers count, so that the name can be restored from the number.
        let factor = number.parse::<u32>().ok().filter(|factor| *factor > 0 && factor.to_string() == number);
        factors.extend(factor.filter(|_| path.is_dir()));
    }
    factors.sort_unstable();
    let Some(&finest) = factors.first() else {
        let advice = "Images lie in folders 1x, 2x, …, named by how many times smaller they are".into();
        return Err(DataError::Missing { what: "folder 2x or the like".into(), folder: pictures, advice });
    };
    let factor = factors.into_iter().rfind(|&factor| f64::from(factor) <= downscale).unwrap_or(finest);
    // An invalid factor is rejected where images are resized.
    let left = if downscale >= 1.0 { (downscale / f64::from(factor)).max(1.0) } else { downscale };
    if f64::from(factor) != downscale {
        let further = if left == 1.0 { "as they are".into() } else { format!("made smaller by {left}") };
        info!("for scene.downscale = {downscale} the images in {PICTURES}/{factor}x are read {further}");
    }
    Ok((pictures.join(format!("{factor}x")), left))
}

/// The first point cloud that exists. There may be none.
fn points(folder: &Path) -> Result<PointCloud, DataError> {
    if let Some(points) = read_first(folder, &POINTS)? {
        return Ok(points);
    }
    let path = folder.join(BARE_POINTS);
    if !path.is_file() {
        warn_of_none(folder, &[POINTS[0], POINTS[1], BARE_POINTS]);
        return Ok(PointCloud::default());
    }
    bare_points(&path).map_err(|reason| DataError::Content {
        path: path.clone(),
        reason,
        advice: "It must hold one row of 3 floating-point numbers a point; remove it to start without points",
    })
}

/// Points without colours.
fn bare_points(path: &Path) -> Result<PointCloud, String> {
    let mut points = PointCloud::default();
    for (index, row) in read_npy(path, 3..=3)?.rows().enumerate() {
        let position = glam::Vec3::from_array(std::array::from_fn(|axis| row[axis] as f32));
        check_place(position).map_err(|reason| format!("row {index} {reason}"))?;
        points.push(position, glam::Vec3::splat(GREY));
    }
    Ok(points)
}

/// The near bound in the cameras' world, if the capture has one.
fn near(folder: &Path) -> Result<Option<f64>, DataError> {
    let path = folder.join(SCENE);
    if !path.is_file() {
        return Ok(None);
    }
    let SceneRecord { scale, near } = read_json(&path, COPY_OR_MEND)?;
    let near = near.zip(scale).map(|(near, scale)| near / scale);
    Ok(near.filter(|near| *near > 0.0 && *near <= LARGEST_COORDINATE))
}
