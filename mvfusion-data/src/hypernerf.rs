//! Captures of Nerfies and HyperNeRF, and DyCheck's in their format: one or two hand-held cameras and things that move.
//!
//! What is assumed of them:
//! * `dataset.json` lists the pictures' names, `ids`, and parts them, `train_ids` and `val_ids`. Where `val_ids` is empty,
//!   every fourth picture trains and the second after each of these is held out, but for the last (METHOD §5.5).
//! * `camera/<id>.json` holds OpenCV's camera for pictures of `image_size`: `orientation` leads from the world to the camera,
//!   `position` is its centre, `pixel_aspect_ratio` makes the focal length along y of the one along x, pixel centres lie at
//!   +0.5. There is no skew.
//! * `rgb/<k>x/<id>.png` are the pictures, k times smaller. The option `downscale` chooses the folder: the one of that number,
//!   else the next finer one, else the finest; only what is left is resized. (4DGS and DeGauss read `2x`, whatever is asked.)
//! * A picture's time is its `warp_id` in `metadata.json`, divided by the largest.
//! * Points (`fused.ply`, `points3D_downsample2.ply`, `points.npy`) and cameras stand in one world, as they are in the files:
//!   `center` and `scale` of `scene.json`, which Nerfies applies to both, are a similarity, and METHOD §5.5 leaves it out.
//!   `near` is in scaled units.
//! * `covisible/` of DyCheck says which pixels count for scores; it is no mask for training and is not read here.

use std::collections::{BTreeMap, BTreeSet};
use std::path::{Path, PathBuf};

use serde::Deserialize;
use tracing::{info, warn};

use crate::npy::read_npy;
use crate::paths::{below, read_json};
use crate::ply::{GREY, read_first, warn_of_none};
use crate::reader::scene_name;
use crate::shot::{Shot, views};
use crate::{Capture, DataError, PictureSource, PointCloud, ReadOptions, Scene};

mod camera;

/// Name of the format, for messages.
pub const FORMAT: &str = "HyperNeRF";

const DATASET: &str = "dataset.json";
const METADATA: &str = "metadata.json";
const SCENE: &str = "scene.json";

/// Folder of the folders of pictures.
const PICTURES: &str = "rgb";

/// Points without colours, the last of the point clouds that are looked for.
const BARE_POINTS: &str = "points.npy";

/// Point clouds, the first that exists.
const POINTS: [&str; 2] = ["fused.ply", "points3D_downsample2.ply"];

/// What to do about a file of the capture that cannot be used.
const ADVICE: &str = "Copy the file again from the dataset, or mend the entry by hand";

/// `dataset.json`.
#[derive(Debug, Deserialize)]
struct Dataset {
    #[serde(default)]
    ids: Vec<Id>,
    #[serde(default)]
    train_ids: Vec<Id>,
    #[serde(default)]
    val_ids: Vec<Id>,
}

/// The name of a picture; some tools write numbers.
#[derive(Debug, Deserialize)]
#[serde(untagged, expecting = "a picture's id is neither a text nor a whole number")]
enum Id {
    Text(String),
    Number(u64),
}

/// An entry of `metadata.json`.
#[derive(Debug, Deserialize)]
struct Moment {
    warp_id: u32,
}

/// What interests us of `scene.json`.
#[derive(Debug, Deserialize)]
struct SceneRecord {
    scale: Option<f64>,
    near: Option<f64>,
}

/// What a picture is for.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Part {
    Train,
    Test,
}

/// Why `folder` is not in this format, or `None` if it is.
pub fn recognise(folder: &Path) -> Option<String> {
    (!folder.join(DATASET).is_file())
        .then(|| format!("it needs {DATASET}, {METADATA} and folders camera and {PICTURES}/2x; {DATASET} is not there"))
}

/// Reads a capture (METHOD §5.5). Only the headers of the pictures are read here.
///
/// # Errors
/// A [`DataError`] that says what is wrong with the folder, a file in it or an option.
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
        return Err(DataError::Missing { what: "picture to train on".into(), folder: folder.to_owned(), advice });
    }
    shots.extend(held_out);
    let mut train = views(folder, shots, &ReadOptions { downscale, ..options.clone() })?;
    let test = train.split_off(count);
    let points = points(folder)?;
    let near = near(folder)?;
    let name = scene_name(folder);
    info!(
        "{name}: {} pictures to train on, {} held out, {} unused, {} points",
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

/// The names of all pictures, and what each is for.
fn parts(path: &Path) -> Result<(Vec<String>, Vec<Option<Part>>), DataError> {
    let dataset: Dataset = read_json(path, ADVICE)?;
    let fail = |reason: String| DataError::Content { path: path.to_owned(), reason, advice: ADVICE };
    let names = |ids: Vec<Id>| -> Vec<String> {
        let name = |id| match id {
            Id::Text(text) => text,
            Id::Number(number) => number.to_string(),
        };
        ids.into_iter().map(name).collect()
    };
    let (mut ids, train, val) = (names(dataset.ids), names(dataset.train_ids), names(dataset.val_ids));
    if ids.is_empty() {
        ids = train.iter().chain(&val).cloned().collect();
    }
    let mut known = BTreeSet::new();
    for id in &ids {
        // The name becomes a part of paths.
        below(Path::new(""), id).map_err(|reason| fail(format!("the id `{id}` is no name: {reason}")))?;
        if !known.insert(id.as_str()) {
            return Err(fail(format!("it lists the id {id} twice")));
        }
    }
    if val.is_empty() {
        let parts = by_position(ids.len());
        return Ok((ids, parts));
    }
    let (train, val): (BTreeSet<_>, BTreeSet<_>) = (train.into_iter().collect(), val.into_iter().collect());
    if let Some(id) = train.iter().chain(&val).find(|id| !known.contains(id.as_str())) {
        return Err(fail(format!("`train_ids` or `val_ids` names {id}, which is not among `ids`")));
    }
    let both = train.intersection(&val).count();
    if both > 0 {
        warn!(file = %path.display(), "{both} pictures are in train_ids and in val_ids: they are held out");
    }
    let part = |id: &String| match (val.contains(id), train.contains(id)) {
        (true, _) => Some(Part::Test),
        (false, true) => Some(Part::Train),
        (false, false) => None,
    };
    let parts = ids.iter().map(part).collect();
    Ok((ids, parts))
}

/// The rule where nothing is held out by name.
fn by_position(count: usize) -> Vec<Option<Part>> {
    let last = count.saturating_sub(1) / 4;
    let part = |index: usize| match index % 4 {
        0 => Some(Part::Train),
        2 if index / 4 < last => Some(Part::Test),
        _ => None,
    };
    (0..count).map(part).collect()
}

/// The times of the pictures.
fn times(path: &Path, ids: &[String]) -> Result<Vec<f64>, DataError> {
    let moments: BTreeMap<String, Moment> = read_json(path, ADVICE)?;
    let warp = |id: &String| {
        moments.get(id).map(|moment| f64::from(moment.warp_id)).ok_or_else(|| DataError::Content {
            path: path.to_owned(),
            reason: format!("it has no entry for the picture {id} of {DATASET}"),
            advice: ADVICE,
        })
    };
    let warps: Vec<f64> = ids.iter().map(warp).collect::<Result<_, _>>()?;
    let largest = warps.iter().copied().fold(1.0, f64::max);
    Ok(warps.into_iter().map(|warp| warp / largest).collect())
}

/// The folder of the pictures, and what is left of `downscale` for them.
fn picture_folder(folder: &Path, downscale: f64) -> Result<(PathBuf, f64), DataError> {
    let pictures = folder.join(PICTURES);
    let fail = |e: std::io::Error| DataError::Folder {
        folder: pictures.clone(),
        reason: e.to_string(),
        advice: "Put the pictures there, in a folder 2x or the like",
    };
    let mut factors = Vec::new();
    for entry in std::fs::read_dir(&pictures).map_err(fail)? {
        let path = entry.map_err(fail)?.path();
        let number = path.file_name().and_then(|name| name.to_str()?.strip_suffix('x')).unwrap_or("");
        // Written as a number is, so that the name can be made of it again.
        let factor = number.parse::<u32>().ok().filter(|factor| *factor > 0 && factor.to_string() == number);
        factors.extend(factor.filter(|_| path.is_dir()));
    }
    factors.sort_unstable();
    let Some(&finest) = factors.first() else {
        let advice = "Pictures lie in folders 1x, 2x, …, named by how many times smaller they are".into();
        return Err(DataError::Missing { what: "folder 2x or the like".into(), folder: pictures, advice });
    };
    let factor = factors.into_iter().rfind(|&factor| f64::from(factor) <= downscale).unwrap_or(finest);
    // A senseless factor is refused where pictures are resized.
    let left = if downscale >= 1.0 { (downscale / f64::from(factor)).max(1.0) } else { downscale };
    if f64::from(factor) != downscale {
        let further = if left == 1.0 { "as they are".into() } else { format!("made smaller by {left}") };
        info!("for downscale = {downscale} the pictures in {PICTURES}/{factor}x are read {further}");
    }
    Ok((pictures.join(format!("{factor}x")), left))
}

/// The first point cloud that exists; none is allowed.
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
        if !position.is_finite() {
            return Err(format!("row {index} holds {row:?}, which is no finite place"));
        }
        points.push(position, glam::Vec3::splat(GREY));
    }
    Ok(points)
}

/// The near bound in the world of the cameras, where the capture has one.
fn near(folder: &Path) -> Result<Option<f64>, DataError> {
    let path = folder.join(SCENE);
    if !path.is_file() {
        return Ok(None);
    }
    let SceneRecord { scale, near } = read_json(&path, ADVICE)?;
    let near = near.zip(scale).map(|(near, scale)| near / scale);
    Ok(near.filter(|near| near.is_finite() && *near > 0.0))
}

#[cfg(test)]
mod tests;
