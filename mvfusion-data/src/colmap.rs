//! Photo collections with a COLMAP model, as NeRF On-the-go and RobustNeRF are passed on: `images/` and
//! `sparse/0/{cameras,images,points3D}.{bin,txt}`.
//!
//! What is assumed of them:
//! * The scene lies in the folder, or in a folder `0` of it (RobustNeRF). The model lies in `sparse/0`, or in `sparse`
//!   itself, where `colmap image_undistorter` puts it; all of it is binary or all of it is text, and binary comes first.
//!   Of several models `sparse/0`, `sparse/1`, … the one with the most photos is read.
//! * Cameras are of any of COLMAP's models; pictures of lenses that bend are straightened as they are read.
//! * Poses lead from the world to OpenCV axes, quaternions are w, x, y, z, and pixel centres lie at +0.5. That is our
//!   own convention, so nothing is converted.
//! * The photos are sorted by name, and the names say what a photo is for: `clutter` trains, `extra` is held out, the
//!   rest is left out; the number after the word is the time. Where no name says so, every 8th photo is held out.
//! * `train_list.txt` and `test_list.txt`, as the undistorted On-the-go scenes have them, win over the names.
//! * Smaller copies of the photos, `images_4`, are used as the module `reduced` says.
//! * All photos have one size. It may be another than the cameras' if both sides were scaled by one factor.
//!
//! Departure: DeGauss ignores the principal point, and goes through the photos in the order of the model's numbers.

use std::path::{Path, PathBuf};

use tracing::{info, warn};

use crate::masks::mask_beside;
use crate::reader::scene_name;
use crate::reduced::{has_pictures, views_of_pictures};
use crate::shot::{FrameLens, Shot};
use crate::{Capture, DataError, PictureSource, ReadOptions, Scene, View};
use lists::Lists;
use model::Model;
use split::{Moment, split};

mod binary;
mod files;
mod lens;
mod lists;
pub(crate) mod model;
mod split;
mod text;

/// Name of the format, for messages.
pub const FORMAT: &str = "COLMAP";

/// Folder of the photos.
const IMAGES: &str = "images";

/// Folder of the models.
const SPARSE: &str = "sparse";

/// A folder of the scene that holds the rest, in RobustNeRF.
const INNER: &str = "0";

/// Why `folder` is not in this format, or `None` if it is.
pub fn recognise(folder: &Path) -> Option<String> {
    let folder = inner(folder);
    let absent = match (has_pictures(&folder), folder.join(SPARSE).is_dir()) {
        (true, true) => return None,
        (false, _) => IMAGES,
        (true, false) => SPARSE,
    };
    Some(format!("it needs folders {IMAGES}, with photos, and {SPARSE}/0, with a model; {absent} is not there"))
}

/// The folder that holds photos and model.
fn inner(folder: &Path) -> PathBuf {
    let inner = folder.join(INNER);
    if inner.join(SPARSE).is_dir() && !folder.join(SPARSE).is_dir() { inner } else { folder.to_owned() }
}

/// Reads a photo collection (METHOD §5.2). Only the headers of the photos are read here, and only of those that are used.
///
/// # Errors
/// A [`DataError`] that says what is wrong with the folder, a file in it or an option.
pub fn read(folder: &Path, options: &ReadOptions) -> Result<Scene, DataError> {
    if let Some(reason) = recognise(folder) {
        let what = format!("{FORMAT} scene");
        return Err(DataError::Missing { what, folder: folder.to_owned(), advice: format!("For that {reason}") });
    }
    let inner = &inner(folder);
    let images = inner.join(IMAGES);
    let Model { photos, points } = model::read(&inner.join(SPARSE))?;
    let lists = Lists::read(inner)?;
    let split = split(photos, lists.as_ref(), options.test_every, &images)?;
    let shot = |moment: &Moment| Shot {
        name: moment.photo.view_name(),
        source: PictureSource::Image(images.join(&moment.photo.name)),
        mask: mask_beside(inner, &moment.photo.name),
        lens: FrameLens::Known { lens: moment.photo.lens, size: moment.photo.size },
        rotation: moment.photo.rotation,
        translation: moment.photo.translation,
        time: moment.time,
    };
    let shots = split.train.iter().chain(&split.test).map(shot).collect();
    let mut train: Vec<View> = views_of_pictures(inner, shots, options)?;
    let test = train.split_off(split.train.len());
    let (width, height) = train[0].image.size();
    let name = scene_name(folder);
    info!(
        "{name}: {} photos to train on and {} held out ({}), {} unused, at {width}x{height}, {} points",
        train.len(),
        test.len(),
        split.rule,
        split.unused,
        points.len()
    );
    if points.is_empty() {
        warn!(folder = %folder.display(), "the model has no points: training starts from random points");
    }
    Ok(Scene { name, capture: Capture::Photos, train, test, points, near: None })
}

#[cfg(test)]
mod tests;
