//! Photo collections with a COLMAP model, as NeRF On-the-go and RobustNeRF are passed on: `images/` and
//! `sparse/0/{cameras,images,points3D}.{bin,txt}`.
//!
//! What is assumed of them:
//! * The model lies in `sparse/0`, or in `sparse` itself, where `colmap image_undistorter` puts it; all of it is binary
//!   or all of it is text, and binary comes first.
//! * Its cameras are pinholes: SIMPLE_PINHOLE, PINHOLE, and SIMPLE_RADIAL, RADIAL, OPENCV without distortion.
//! * Poses lead from the world to OpenCV axes, quaternions are w, x, y, z, and pixel centres lie at +0.5. That is our
//!   own convention, so nothing is converted.
//! * The photos are sorted by name, and the names say what a photo is for: `clutter` trains, `extra` is held out, the
//!   rest is left out; the number after the word is the time. Where no name says so, every 8th photo is held out.
//! * All photos have one size. It may be another than the cameras' if both sides were scaled by one factor.
//!
//! Departure: DeGauss undistorts the photos as it reads them, ignores the principal point, and goes through the photos in
//! the order of the model's numbers.

use std::path::Path;

use serde::{Deserialize, Serialize};
use tracing::{info, warn};

use crate::picture::{common_size, reduced_size};
use crate::{Capture, DataError, Picture, Scene, Truth, View};
use model::{Model, Photo};
use size::check_shapes;
use split::{Moment, split};

mod binary;
mod files;
mod lens;
mod model;
mod size;
mod split;
mod text;

/// Name of the format, for messages.
pub const FORMAT: &str = "COLMAP";

/// Folder of the photos.
const IMAGES: &str = "images";

/// Folder of the models.
const SPARSE: &str = "sparse";

/// How a photo collection is read.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct ColmapOptions {
    /// Photos are made smaller by this factor, at least 1. Default 1; DeGauss reads photo collections with 8 or 4.
    pub downscale: f64,
    /// Where no name says what a photo is for, every so many of the sorted photos is held out, from the first on; 0 holds
    /// none out. Default 8, LLFF's rule.
    pub test_every: usize,
}

impl Default for ColmapOptions {
    fn default() -> Self {
        Self { downscale: 1.0, test_every: 8 }
    }
}

/// Why `folder` is not in this format, or `None` if it is.
///
/// # Errors
/// [`DataError::Folder`] if the folder cannot be listed.
pub fn recognise(folder: &Path) -> Result<Option<String>, DataError> {
    if let Err(error) = std::fs::read_dir(folder) {
        let advice = "Give the folder of a scene";
        return Err(DataError::Folder { folder: folder.to_owned(), reason: error.to_string(), advice });
    }
    let absent = [IMAGES, SPARSE].into_iter().find(|name| !folder.join(name).is_dir());
    Ok(absent.map(|name| {
        format!("it needs folders {IMAGES}, with photos, and {SPARSE}/0, with a model; {name} is not there")
    }))
}

/// Reads a photo collection (METHOD §5.2). Only the headers of the photos are read here, and only of those that are used.
///
/// # Errors
/// A [`DataError`] that says what is wrong with the folder, a file in it or an option.
pub fn read(folder: &Path, options: &ColmapOptions) -> Result<Scene, DataError> {
    if let Some(reason) = recognise(folder)? {
        let what = format!("{FORMAT} scene");
        return Err(DataError::Missing { what, folder: folder.to_owned(), advice: format!("For that {reason}") });
    }
    let images = folder.join(IMAGES);
    let Model { photos, points } = model::read(folder)?;
    let split = split(photos, options.test_every, &images)?;
    let used = || split.train.iter().chain(&split.test).map(|moment| &moment.photo);
    check_presence(&images, used())?;
    let paths: Vec<_> = used().map(|photo| images.join(&photo.name)).collect();
    let size = common_size(folder, &paths, "All photos of a scene must have one size: scale them alike")?;
    check_shapes(folder, size, used())?;
    let (width, height) = reduced_size(size, options.downscale)?;

    let view = |moment: &Moment| View {
        name: moment.photo.view_name(),
        camera: moment.photo.camera.resized(width as usize, height as usize),
        time: moment.time,
        image: Picture::File { path: images.join(&moment.photo.name), width, height },
        truth: Truth::default(),
    };
    let train: Vec<View> = split.train.iter().map(view).collect();
    let test: Vec<View> = split.test.iter().map(view).collect();
    let name = folder.file_name().map_or_else(|| FORMAT.into(), |n| n.to_string_lossy().into_owned());
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

/// Every photo must be there.
fn check_presence<'a>(images: &Path, photos: impl Iterator<Item = &'a Photo>) -> Result<(), DataError> {
    let absent: Vec<&str> = photos.map(|p| p.name.as_str()).filter(|name| !images.join(name).is_file()).collect();
    let Some(first) = absent.first() else { return Ok(()) };
    Err(DataError::Missing {
        what: format!("photo {first}"),
        folder: images.to_owned(),
        advice: format!(
            "The model lists it ({} such): put the photos there under the names that the model has for them",
            absent.len()
        ),
    })
}

#[cfg(test)]
mod tests;
