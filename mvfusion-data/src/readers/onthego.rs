//! NeRF On-the-go as published: `images/`, `transforms.json` and `split.json`.
//!
//! Assumptions:
//! * Cameras follow the module `transforms`.
//! * `split.json` contains lists `clutter`, `extra` and `clean` of indices into the frames of `transforms.json` whose
//!   photos exist, sorted by the names of their files, as in the published loader. A photo without a frame has no
//!   index. Clutter trains, extra is held out, clean is unused.
//! * A photo's time is the last number in its name, rescaled so that the smallest such number of all photos is 0 and
//!   the largest is 1. The counters of cameras start anywhere (METHOD §5.2).
//! * Smaller copies of the photos, `images_8`, are used as described in the module `reduced`.
//! * The published scenes have no points. A `points3D.ply` or `fused.ply` is read if it was added.

use std::path::{Path, PathBuf};

use serde::Deserialize;
use tracing::{info, warn};

use super::format::Format;
use super::options::ReadOptions;
use super::reader::{Hints, Reader, UsualSize};
use super::shared::ply::{read_first, warn_of_none};
use super::shared::reduced::{listing_folder, views_of_pictures};
use super::shared::shot::Shot;
use super::shared::transforms::{Frame, POSES, Transforms, ignored_masks};
use crate::error::DataError;
use crate::files::{denied, picture_named, read_json, scene_name};
use crate::scene::{Capture, Scene};

impl Format {
    /// NeRF On-the-go as published: see [`onthego`](crate::readers::onthego).
    pub const ONTHEGO: Self = Self::new("onthego", "NeRF On-the-go");
}

/// The entry in the table of readers.
pub(super) const READER: Reader = Reader {
    format: Format::ONTHEGO,
    recognise,
    read,
    hints: Hints { usual_size, ignored_masks, ..Hints::of_poses(POSES) },
};

const CAMERAS: &str = "transforms.json";
const SPLIT: &str = "split.json";
const IMAGES: &str = "images";

/// Advice for an unusable split.
const ADVICE: &str = "It must hold lists `clutter`, `extra` and `clean` of indices into the frames of transforms.json \
                      whose photos exist, sorted by file name, from 0 on";

/// Scenes that were published at half the size of the others.
const SMALL: [&str; 2] = ["patio", "arcdetriomphe"];

/// Names of point clouds. The first that exists is read.
const POINTS: [&str; 2] = ["points3D.ply", "fused.ply"];

/// `split.json`: indices into the sorted frames.
#[derive(Debug, Deserialize)]
struct Split {
    clutter: Vec<usize>,
    extra: Vec<usize>,
    #[serde(default)]
    clean: Vec<usize>,
}

/// The reason why `folder` is not in this format; `None` if it is.
pub fn recognise(folder: &Path) -> Option<String> {
    let absent = [CAMERAS, SPLIT].into_iter().find(|name| !folder.join(name).is_file())?;
    Some(format!("it needs {IMAGES}, {CAMERAS} and {SPLIT}; {absent} is not there"))
}

/// The size at which papers train the scene.
pub(super) fn usual_size(scene: &Scene, _: f64) -> Option<UsualSize> {
    let is_small = SMALL.contains(&scene.name.trim_end_matches("_new"));
    Some(UsualSize {
        factor: if is_small { 4.0 } else { 8.0 },
        source: "papers train photos with passers-by at an 8th of their size (patio and arcdetriomphe: a 4th)",
    })
}

/// Reads a scene of NeRF On-the-go (METHOD §5.2).
///
/// # Errors
/// A [`DataError`] that names the problem with the folder, a file in it or an option.
pub fn read(folder: &Path, options: &ReadOptions) -> Result<Scene, DataError> {
    let cameras = Transforms::read(&folder.join(CAMERAS))?;
    let listing = listing_folder(folder, options)?;
    // Photos that may not be read would seem to be absent, and the indices of the split to be wrong.
    if let Some(path) = denied(&listing) {
        return Err(DataError::Denied { path });
    }
    let photos = Photos::new(&cameras, folder, &listing);
    let absent = cameras.frames.len() - photos.frames.len();
    if absent > 0 {
        warn!(folder = %folder.display(), "{absent} frames of {CAMERAS} have no photo: {SPLIT} does not count them");
    }
    let split = read_split(&folder.join(SPLIT), &photos.frames)?;
    if split.clutter.is_empty() {
        let advice = format!("`clutter` in {SPLIT} lists the photos to train on, and {CAMERAS} has their cameras");
        return Err(DataError::Missing { what: "photo to train on".into(), folder: folder.join(IMAGES), advice });
    }
    let mut shots = photos.shots(&split.clutter)?;
    shots.extend(photos.shots(&split.extra)?);
    let mut train = views_of_pictures(folder, shots, options)?;
    let test = train.split_off(split.clutter.len());
    let points = read_first(folder, &POINTS)?;
    if points.is_none() {
        warn_of_none(folder, &POINTS);
    }
    let points = points.unwrap_or_default();
    let name = scene_name(folder);
    info!(
        "{name}: {} photos to train on, {} held out, {} unused, {} points",
        train.len(),
        test.len(),
        photos.frames.len() - train.len() - test.len(),
        points.len()
    );
    Ok(Scene { name, capture: Capture::Photos, train, test, points, near: None })
}

/// The frames whose photos exist, sorted by the names of their files.
struct Photos {
    frames: Vec<Frame>,
    /// The smallest and the largest number in the names.
    range: (u32, u32),
}

impl Photos {
    /// `listing` is `images` in the folder, or the smaller copy that replaces it.
    fn new(cameras: &Transforms, folder: &Path, listing: &Path) -> Self {
        let images = folder.join(IMAGES);
        let is_of_another = |file: &PathBuf| cameras.frames.iter().any(|frame| frame.file == *file);
        // The photo, or its smaller copy, may have another extension.
        let found = |frame: &Frame| {
            if frame.file.is_file() {
                return Some(frame.clone());
            }
            let stem = frame.file.strip_prefix(&images).ok()?.with_extension("");
            let found = picture_named(listing, &stem.to_string_lossy()).filter(|file| !is_of_another(file))?;
            // Whoever reads a copy looks for it by the name of the photo.
            let file = if listing == images { found } else { frame.file.clone() };
            Some(Frame { file, ..frame.clone() })
        };
        let mut frames: Vec<Frame> = cameras.frames.iter().filter_map(found).collect();
        frames.sort_by(|a, b| a.file.file_name().cmp(&b.file.file_name()));
        let numbers = || frames.iter().filter_map(|frame| number_of(&frame.file));
        let range = (numbers().min().unwrap_or(0), numbers().max().unwrap_or(0));
        Self { frames, range }
    }

    /// The photos of a list.
    fn shots(&self, indices: &[usize]) -> Result<Vec<Shot>, DataError> {
        let (smallest, largest) = self.range;
        let shot = |&index: &usize| {
            let frame = &self.frames[index];
            let number = number_of(&frame.file).ok_or_else(|| no_number(&frame.file))?;
            // A single photo is at time 0.
            Ok(frame.shot(f64::from(number - smallest) / f64::from((largest - smallest).max(1))))
        };
        indices.iter().map(shot).collect()
    }
}

/// Reads the split. Each index must exist and be in only one list.
fn read_split(path: &Path, photos: &[Frame]) -> Result<Split, DataError> {
    let fail = |reason: String| DataError::Content { path: path.to_owned(), reason, advice: ADVICE };
    let split: Split = read_json(path, ADVICE)?;
    let mut uses = vec![0u32; photos.len()];
    for &index in split.clutter.iter().chain(&split.extra).chain(&split.clean) {
        let count = photos.len();
        let none = || fail(format!("it lists photo {index}, but there are {count} with a frame in {CAMERAS}"));
        let uses = uses.get_mut(index).ok_or_else(none)?;
        *uses += 1;
    }
    match uses.iter().position(|&uses| uses > 1) {
        Some(twice) => Err(fail(format!("it lists photo {twice} ({}) twice", photos[twice].name))),
        None => Ok(split),
    }
}

/// The last number in a photo's name, if it fits into 32 bits.
fn number_of(photo: &Path) -> Option<u32> {
    let stem = photo.file_stem()?.to_str()?;
    let end = stem.rfind(|c: char| c.is_ascii_digit())? + 1;
    let begin = stem[..end]
        .rfind(|c: char| !c.is_ascii_digit())
        .map_or(0, |at| at + stem[at..].chars().next().map_or(1, char::len_utf8));
    stem[begin..end].parse().ok()
}

fn no_number(photo: &Path) -> DataError {
    DataError::Content {
        path: photo.to_owned(),
        reason: "its name has no number of use, so its time is not known".into(),
        advice: "Name photos by their order, like IMG_0012.JPG, in the folder and in transforms.json",
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_last_number_of_a_name_counts() {
        for (name, number) in [
            ("IMG_0012.JPG", Some(12)),
            ("2clutter008.jpg", Some(8)),
            ("IMG_7_b.png", Some(7)),
            ("größe12é3.png", Some(3)),
            ("front.png", None),
            ("99999999999.png", None),
        ] {
            assert_eq!(number_of(Path::new(name)), number, "{name}");
        }
    }
}
