//! Photo collections with a COLMAP model, as NeRF On-the-go and RobustNeRF are distributed: `images/` and
//! `sparse/0/{cameras,images,points3D}.{bin,txt}`.
//!
//! Assumptions:
//! * The scene is in the folder or, for RobustNeRF, in its subfolder `0`. The model is in `sparse/0`, or in `sparse`
//!   itself, where `colmap image_undistorter` writes it. Its files are all binary or all text; binary files take
//!   precedence. Of several models `sparse/0`, `sparse/1`, … the one with the most photos is read.
//! * Cameras may have any of COLMAP's models. Distorted images are undistorted when they are read.
//! * Poses map the world to OpenCV axes, quaternions are w, x, y, z, and pixel centres are at +0.5. This is our own
//!   convention, so nothing is converted.
//! * The photos are sorted by name, and the names define the split. `clutter` trains, `extra` is held out, and all
//!   others are unused. The number after the word is the time. If no name contains these words, every 8th photo is held
//!   out, and times follow the order of the names, with numbers compared by value.
//! * `train_list.txt` and `test_list.txt`, as in the undistorted On-the-go scenes, override the names.
//! * Smaller copies of the photos, `images_4`, are used as described in the module `reduced`.
//! * All photos have one size. It may differ from the cameras' if both sides were scaled by one factor.
//!
//! Departure: DeGauss ignores the principal point and processes the photos in the order of the model's numbers.

mod lists;
mod masks;
pub(crate) mod model;
mod purpose;
mod split;
#[cfg(test)]
mod tests;

use std::collections::BTreeSet;
use std::path::{Path, PathBuf};

use tracing::{info, warn};

use super::format::Format;
use super::onthego;
use super::options::ReadOptions;
use super::reader::{Hints, Reader, UsualSize};
use super::shared::reduced::{IMAGES, has_pictures, views_of_pictures};
use super::shared::shot::{FrameLens, Shot};
use crate::error::DataError;
use crate::files::{others_than, scene_name};
use crate::scene::{Capture, PictureSource, Scene, View};
use lists::Lists;
use model::Model;
use split::{Moment, split};

impl Format {
    /// Photos with a COLMAP model: see [`colmap`](crate::readers::colmap).
    pub const COLMAP: Self = Self::new("colmap", "COLMAP");
}

/// The entry in the table of readers.
pub(super) const READER: Reader = Reader {
    format: Format::COLMAP,
    recognise,
    read,
    hints: Hints { usual_size, ignored_masks, ..Hints::of_poses(POSES) },
};

/// The convention of the poses.
pub(super) const POSES: &str = "COLMAP's poses lead from the world to the camera: quaternion w, x, y, z and translation, \
                                x right, y down, z forward.";

/// Folder of the models.
const SPARSE: &str = "sparse";

/// Subfolder of the scene in RobustNeRF.
const INNER: &str = "0";

/// The reason why `folder` is not in this format; `None` if it is.
pub fn recognise(folder: &Path) -> Option<String> {
    let folder = inner(folder);
    let absent = match (has_pictures(&folder), folder.join(SPARSE).is_dir()) {
        (true, true) => return None,
        (false, _) => IMAGES,
        (true, false) => SPARSE,
    };
    Some(format!("it needs folders {IMAGES}, with photos, and {SPARSE}/0, with a model; {absent} is not there"))
}

/// The folder of photos and model.
fn inner(folder: &Path) -> PathBuf {
    let inner = folder.join(INNER);
    if inner.join(SPARSE).is_dir() && !folder.join(SPARSE).is_dir() { inner } else { folder.to_owned() }
}

/// The size at which papers train scenes of NeRF On-the-go, if the photos have such names.
fn usual_size(scene: &Scene, width: f64) -> Option<UsualSize> {
    let is_clutter = scene.train.iter().all(|view| view.name.contains("clutter"));
    is_clutter.then(|| onthego::usual_size(scene, width)).flatten()
}

/// The masks that no photo of a scene uses; `None` if there are none.
fn ignored_masks(folder: &Path, scene: &Scene) -> Option<String> {
    masks::ignored(&inner(folder), scene)
}

/// Reads a photo collection (METHOD §5.2). Only the headers of photos that are used are read here.
///
/// # Errors
/// A [`DataError`] that names the problem with the folder, a file in it or an option.
pub fn read(folder: &Path, options: &ReadOptions) -> Result<Scene, DataError> {
    if let Some(reason) = recognise(folder) {
        let what = format!("{} scene", Format::COLMAP.name());
        return Err(DataError::Missing { what, folder: folder.to_owned(), advice: format!("For that {reason}") });
    }
    let inner = &inner(folder);
    let images = inner.join(IMAGES);
    let Model { photos, points } = model::read(&inner.join(SPARSE))?;
    let placed: BTreeSet<PathBuf> = photos.iter().map(|photo| images.join(&photo.name)).collect();
    let lists = Lists::read(inner)?;
    masks::check_access(inner)?;
    let split = split(photos, lists.as_ref(), options.test_every, &images)?;
    let shot = |moment: &Moment| Shot {
        name: moment.photo.view_name(),
        source: PictureSource::Image(images.join(&moment.photo.name)),
        mask: masks::beside(inner, &moment.photo.name),
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
    let unplaced = others_than(&placed, &images);
    if unplaced > 0 {
        warn!(
            folder = %folder.display(),
            "{unplaced} of the images in {IMAGES} have no pose in {SPARSE}, so they are not used"
        );
    }
    if points.is_empty() {
        warn!(folder = %folder.display(), "the model has no points: training starts from random points");
    }
    Ok(Scene { name, capture: Capture::Photos, train, test, points, near: None })
}
