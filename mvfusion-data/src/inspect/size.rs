//! Checks the size of the images against the usual training size.

use std::path::Path;

use super::origin::Origin;
use super::problem::{Problem, Subject};
use crate::readers::{Format, Reader, UsualSize, reader_of};
use crate::scene::Scene;

/// Width above which 3DGS downscales images by default.
const WIDE: f64 = 1600.0;

pub(super) fn problems(scene: &Scene, origin: &Origin) -> Vec<Problem> {
    let Some(view) = scene.train.first() else { return Vec::new() };
    let (width, height) = view.image.size();
    if f64::from(width) <= WIDE {
        return Vec::new();
    }
    // The factor refers to the files' size.
    let on_disk = f64::from(width) * origin.downscale;
    let UsualSize { factor, source } = usual_size(scene, origin.format, on_disk);
    let what = format!("the images are {width}x{height}: training is slow, and {source}");
    vec![Problem::note(Subject::Size, what, format!("Add `--set scene.downscale={factor}`."))]
}

/// Images in another shape than the cameras were calibrated for.
pub(super) fn odd_shape(reader: &Reader, folder: &Path, scene: &Scene) -> Option<Problem> {
    let what = (reader.hints.odd_shape)(folder, scene)?;
    let remedy = "A centre and a focal length that belong to other images blur everything. Scale the frames without \
                  cropping them, or correct height, width and focal length in the rows.";
    Some(Problem::warning(Subject::Size, what, remedy))
}

/// The usual size for images of this width on disk: that of the format, otherwise that of 3DGS.
fn usual_size(scene: &Scene, format: Option<Format>, width: f64) -> UsualSize {
    let known = format.and_then(reader_of).and_then(|reader| (reader.hints.usual_size)(scene, width));
    let source = "3DGS, too, trains on at most 1600 pixels across";
    known.unwrap_or(UsualSize { factor: (width / WIDE).ceil(), source })
}
