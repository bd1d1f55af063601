//! Scenes as nerfstudio and its converters write them: `transforms.json` beside the pictures.
//!
//! What is assumed of them:
//! * Cameras as the module `transforms` says; `ply_file_path` names the points, in the cameras' world.
//! * `train_filenames` and `test_filenames` part the pictures; where they are absent, every 8th of the pictures, sorted by
//!   name, is held out.
//! * Smaller copies of the pictures, `images_2`, are used as the module `reduced` says.
//! * Frames with `time`, or with `timestamp` in nanoseconds, are a video. Times within `[0, 1]` stay as they are, others are
//!   laid out between the first and the last. Without either, the pictures are photos of one moment each, and their order
//!   is their time.

use std::collections::BTreeSet;
use std::path::Path;

use tracing::{info, warn};

use crate::reader::scene_name;
use crate::reduced::views_of_pictures;
use crate::shot::Shot;
use crate::transforms::{Frame, Transforms};
use crate::{Capture, DataError, PictureSource, PointCloud, ReadOptions, Scene, View, read_points};

/// Name of the format, for messages.
pub const FORMAT: &str = "nerfstudio";

const CAMERAS: &str = "transforms.json";

/// Why `folder` is not in this format, or `None` if it is.
pub fn recognise(folder: &Path) -> Option<String> {
    (!folder.join(CAMERAS).is_file()).then(|| format!("it needs {CAMERAS}, which is not there"))
}

/// How the scene in `folder` was captured, going by its frames alone: with times it is a video. A file that cannot be read,
/// which [`read`] will say, counts as photos.
pub fn capture(folder: &Path) -> Capture {
    let timed = |frame: &Frame| frame.time.or(frame.timestamp).is_some();
    match Transforms::read(&folder.join(CAMERAS)) {
        Ok(transforms) if transforms.frames.iter().any(timed) => Capture::Video,
        _ => Capture::Photos,
    }
}

/// Reads a nerfstudio scene.
///
/// # Errors
/// A [`DataError`] that says what is wrong with the folder, a file in it or an option.
pub fn read(folder: &Path, options: &ReadOptions) -> Result<Scene, DataError> {
    let transforms = Transforms::read(&folder.join(CAMERAS))?;
    let mut frames: Vec<&Frame> = transforms.frames.iter().collect();
    frames.sort_by(|a, b| a.name.cmp(&b.name));
    let (capture, times) = moments(&transforms, &frames)?;
    let held_out = held_out(&transforms, &frames, options.test_every)?;
    let shot = |(frame, time): (&&Frame, f64)| Shot {
        name: frame.view_name(),
        source: PictureSource::Image(frame.file.clone()),
        mask: frame.mask.clone(),
        lens: frame.lens,
        rotation: frame.rotation,
        translation: frame.translation,
        time,
    };
    let all = views_of_pictures(folder, frames.iter().zip(times).map(shot).collect(), options)?;
    let mut parts: [Vec<View>; 2] = Default::default();
    for (view, part) in all.into_iter().zip(held_out) {
        match part {
            Part::Train => parts[0].push(view),
            Part::Test => parts[1].push(view),
            Part::Neither => {}
        }
    }
    let [train, test] = parts;
    if train.is_empty() {
        let advice = format!("{CAMERAS} holds out every picture: list some in `train_filenames`, or none at all");
        return Err(DataError::Missing { what: "picture to train on".into(), folder: folder.to_owned(), advice });
    }
    let points = match &transforms.points {
        Some(path) => read_points(path)?,
        None => {
            warn!(folder = %folder.display(), "{CAMERAS} names no ply_file_path: training starts from random points");
            PointCloud::default()
        }
    };
    let name = scene_name(folder);
    info!("{name}: {} pictures to train on, {} held out, {} points", train.len(), test.len(), points.len());
    Ok(Scene { name, capture, train, test, points, near: None })
}

/// What a picture is for.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Part {
    Train,
    Test,
    Neither,
}

/// What each frame is for.
fn held_out(transforms: &Transforms, frames: &[&Frame], test_every: usize) -> Result<Vec<Part>, DataError> {
    let (Some(train), Some(test)) = (&transforms.train, &transforms.test) else {
        let is_test = |index: usize| test_every > 0 && index.is_multiple_of(test_every);
        return Ok((0..frames.len()).map(|index| if is_test(index) { Part::Test } else { Part::Train }).collect());
    };
    let names: BTreeSet<&str> = frames.iter().map(|frame| frame.name.as_str()).collect();
    if let Some(unknown) = train.iter().chain(test).find(|name| !names.contains(name.as_str())) {
        return Err(DataError::Content {
            path: transforms.path.clone(),
            reason: format!("its split names {unknown}, which is no frame"),
            advice: "Names in train_filenames and test_filenames must be those of file_path",
        });
    }
    let part = |frame: &&Frame| {
        if test.contains(&frame.name) {
            Part::Test
        } else if train.contains(&frame.name) {
            Part::Train
        } else {
            Part::Neither
        }
    };
    Ok(frames.iter().map(part).collect())
}

/// How the scene was captured, and the time of each frame.
fn moments(transforms: &Transforms, frames: &[&Frame]) -> Result<(Capture, Vec<f64>), DataError> {
    let raw: Vec<Option<f64>> = frames.iter().map(|frame| frame.time.or(frame.timestamp)).collect();
    let Some(times) = raw.iter().copied().collect::<Option<Vec<f64>>>() else {
        if let Some(at) = raw.iter().position(Option::is_some) {
            return Err(DataError::Content {
                path: transforms.path.clone(),
                reason: format!("{} has a time, but other frames have none", frames[at].name),
                advice: "Give every frame a `time` or a `timestamp`, or none",
            });
        }
        let count = frames.len() as f64;
        return Ok((Capture::Photos, (0..frames.len()).map(|index| index as f64 / count).collect()));
    };
    let (first, last) = times.iter().fold((f64::INFINITY, f64::NEG_INFINITY), |(a, b), &t| (a.min(t), b.max(t)));
    if first >= 0.0 && last <= 1.0 {
        return Ok((Capture::Video, times));
    }
    let length = if last > first { last - first } else { 1.0 };
    Ok((Capture::Video, times.into_iter().map(|time| (time - first) / length).collect()))
}
