//! Scenes of nerfstudio and its converters: `transforms.json` next to the images.
//!
//! Assumptions:
//! * Cameras follow the module `transforms`. `ply_file_path` names the points, in the cameras' world.
//! * `train_filenames` and `test_filenames` define the split. With one list, images outside of it belong to the other
//!   part. With both, images in neither list are unused. `val_filenames` replaces a missing `test_filenames`. Without
//!   any list, every 8th image by name is held out.
//! * Smaller copies of the images, `images_2`, are used as described in the module `reduced`.
//! * Frames with `time`, or else with `timestamp` in nanoseconds, are a video. Times within `[0, 1]` are kept, others
//!   are scaled to start at 0 and end at 1. Without either, the images are photos of one moment each, and their order,
//!   with numbers in names compared by value, is their time.

use std::collections::BTreeSet;
use std::path::Path;

use tracing::{info, warn};

use super::format::Format;
use super::options::{ReadOptions, every_so_many};
use super::reader::{Hints, Reader};
use super::shared::frame_numbers::places_in_time;
use super::shared::ply::read_points;
use super::shared::reduced::views_of_pictures;
use super::shared::shot::Shot;
use super::shared::transforms::{Frame, POSES, Transforms, ignored_masks, plain};
use crate::error::DataError;
use crate::files::{pictures_in, scene_name};
use crate::scene::{Capture, PointCloud, Scene};

impl Format {
    /// Scenes of nerfstudio and its converters: see [`nerfstudio`](crate::readers::nerfstudio).
    pub const NERFSTUDIO: Self = Self::new("nerfstudio", "nerfstudio");
}

/// The entry in the table of readers.
pub(super) const READER: Reader =
    Reader { format: Format::NERFSTUDIO, recognise, read, hints: Hints { ignored_masks, ..Hints::of_poses(POSES) } };

const CAMERAS: &str = "transforms.json";

/// The reason why `folder` is not in this format; `None` if it is.
pub fn recognise(folder: &Path) -> Option<String> {
    (!folder.join(CAMERAS).is_file()).then(|| format!("it needs {CAMERAS}, which is not there"))
}

/// The kind of capture in `folder`, judged only by its frames: with times it is a video. An unreadable file counts as
/// photos; [`read`] reports it.
pub fn capture(folder: &Path) -> Capture {
    match Transforms::read(&folder.join(CAMERAS)) {
        Ok(transforms) if transforms.frames.iter().any(is_timed) => Capture::Video,
        _ => Capture::Photos,
    }
}

fn is_timed(frame: &Frame) -> bool {
    frame.time.or(frame.timestamp).is_some()
}

/// Reads a nerfstudio scene.
///
/// # Errors
/// A [`DataError`] that names the problem with the folder, a file in it or an option.
pub fn read(folder: &Path, options: &ReadOptions) -> Result<Scene, DataError> {
    let transforms = Transforms::read(&folder.join(CAMERAS))?;
    let mut frames: Vec<&Frame> = transforms.frames.iter().collect();
    frames.sort_by(|a, b| a.name.cmp(&b.name));
    let (capture, times) = moments(&transforms, &frames)?;
    let parts = parts(&transforms, &frames, options.test_every)?;
    let of = |wanted: Part| {
        let used = frames.iter().zip(&times).zip(&parts).filter(move |(_, part)| **part == Some(wanted));
        used.map(|((frame, time), _)| frame.shot(*time))
    };
    let mut shots: Vec<Shot> = of(Part::Train).collect();
    let count = shots.len();
    if count == 0 {
        let advice = format!("{CAMERAS} holds out every image: list some in `train_filenames`, or make no such lists");
        return Err(DataError::Missing { what: "image to train on".into(), folder: folder.to_owned(), advice });
    }
    shots.extend(of(Part::Test));
    let mut train = views_of_pictures(folder, shots, options)?;
    let test = train.split_off(count);
    let points = points(&transforms, folder)?;
    let name = scene_name(folder);
    info!("{name}: {} images to train on, {} held out, {} points", train.len(), test.len(), points.len());
    let unlisted = unlisted(&frames);
    if unlisted > 0 {
        warn!(
            folder = %folder.display(),
            "{unlisted} images beside those of {CAMERAS} are not listed in it, so they are not used"
        );
    }
    Ok(Scene { name, capture, train, test, points, near: None })
}

/// The number of images in the folders of the frames that are no frame. Converters leave out what COLMAP did not place.
fn unlisted(frames: &[&Frame]) -> usize {
    let files = || frames.iter().map(|frame| frame.file.as_path());
    let masks = frames.iter().filter_map(|frame| frame.mask.as_deref());
    let known: BTreeSet<&Path> = files().chain(masks).collect();
    let folders: BTreeSet<&Path> = files().filter_map(Path::parent).collect();
    let others = |folder: &Path| {
        let pictures = pictures_in(folder).unwrap_or_default();
        pictures.iter().filter(|path| !known.contains(path.as_path())).count()
    };
    folders.into_iter().map(others).sum()
}

/// The points that the file names. There may be none.
fn points(transforms: &Transforms, folder: &Path) -> Result<PointCloud, DataError> {
    match &transforms.points {
        Some(path) if path.is_file() => read_points(path),
        Some(path) => Err(DataError::Missing {
            what: format!("point cloud {}", path.strip_prefix(folder).unwrap_or(path).display()),
            folder: folder.to_owned(),
            advice: format!("Put it there, or remove `ply_file_path` from {CAMERAS} to start without points"),
        }),
        None => {
            warn!(folder = %folder.display(), "{CAMERAS} names no ply_file_path: training starts from random points");
            Ok(PointCloud::default())
        }
    }
}

/// The purpose of an image.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Part {
    Train,
    Test,
}

/// The part of each frame. Frames that the lists leave out belong to none.
fn parts(transforms: &Transforms, frames: &[&Frame], test_every: usize) -> Result<Vec<Option<Part>>, DataError> {
    if transforms.train.is_none() && transforms.test.is_none() {
        let is_test = every_so_many(test_every)?;
        let part = |place: usize| Some(if is_test(place) { Part::Test } else { Part::Train });
        return Ok((0..frames.len()).map(part).collect());
    }
    let listed = |names: &Option<Vec<String>>| -> Option<BTreeSet<String>> {
        names.as_ref().map(|names| names.iter().map(|name| plain(name).to_owned()).collect())
    };
    let (train, test) = (listed(&transforms.train), listed(&transforms.test));
    let known: BTreeSet<&str> = frames.iter().map(|frame| plain(&frame.name)).collect();
    if let Some(unknown) = train.iter().chain(&test).flatten().find(|name| !known.contains(name.as_str())) {
        return Err(DataError::Content {
            path: transforms.path.clone(),
            reason: format!("its split names {unknown}, which is no frame"),
            advice: "Names in train_filenames, val_filenames and test_filenames must be those of file_path",
        });
    }
    let part = |frame: &&Frame| {
        let is_in = |list: &Option<BTreeSet<String>>| list.as_ref().map(|names| names.contains(plain(&frame.name)));
        match (is_in(&train), is_in(&test)) {
            (_, Some(true)) | (Some(false), None) => Some(Part::Test),
            (Some(true), _) | (None, _) => Some(Part::Train),
            (Some(false), Some(false)) => None,
        }
    };
    Ok(frames.iter().map(part).collect())
}

/// The kind of capture, and the time of each frame.
fn moments(transforms: &Transforms, frames: &[&Frame]) -> Result<(Capture, Vec<f64>), DataError> {
    // All frames need one unit: a `time` of 0.5 is not in nanoseconds.
    let all = |of: fn(&Frame) -> Option<f64>| frames.iter().map(|frame| of(frame)).collect::<Option<Vec<f64>>>();
    let Some(times) = all(|frame| frame.time).or_else(|| all(|frame| frame.timestamp)) else {
        if let Some(frame) = frames.iter().find(|frame| is_timed(frame)) {
            return Err(DataError::Content {
                path: transforms.path.clone(),
                reason: format!("{} has a time, but other frames have none of the kind", frame.name),
                advice: "Give every frame a `time`, or every frame a `timestamp`, or none either",
            });
        }
        let (count, places) = (frames.len() as f64, places_in_time(frames.iter().map(|frame| frame.name.as_str())));
        return Ok((Capture::Photos, places.into_iter().map(|place| place as f64 / count).collect()));
    };
    let (first, last) = times.iter().fold((f64::INFINITY, f64::NEG_INFINITY), |(a, b), &t| (a.min(t), b.max(t)));
    if first >= 0.0 && last <= 1.0 {
        return Ok((Capture::Video, times));
    }
    // Halved, because the difference of the largest numbers is not finite.
    let since_first = |time: f64| 0.5 * time - 0.5 * first;
    let length = Some(since_first(last)).filter(|length| *length > 0.0).unwrap_or(1.0);
    Ok((Capture::Video, times.into_iter().map(|time| since_first(time) / length).collect()))
}
