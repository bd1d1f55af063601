//! Writers for common layouts, for other programs and for our own readers.
//!
//! Every layout is built in memory first (`package`), so an unsuitable scene is rejected before anything is written.
//! Images are always lossless PNG files, whatever the layout's own tools write.
//!
//! Ground truth is stored in folders next to the photos, with the view names of our readers: [`MASKS_TRUTH`],
//! [`MOVERS_TRUTH`], [`BACKGROUND_TRUTH`] and [`DEPTH_TRUTH`]. These folders belong to no layout, so no tool trains on
//! them by mistake.
//!
//! What a layout cannot express is lost: see [`Layout`].

mod colmap;
mod depths;
mod dnerf;
mod encode;
mod error;
mod gaussians;
mod hypernerf;
mod layout;
mod multipleview;
mod nerfstudio;
mod neu3d;
mod npz;
mod onthego;
mod package;
mod panoptic;
mod photos;
mod poses;
mod rig;
#[cfg(test)]
mod tests;
mod transforms;

use std::path::Path;

use tracing::{info, warn};

pub use encode::ply;
pub use error::WriteError;
pub use gaussians::gaussian_ply;
pub use layout::Layout;
pub use npz::gaussian_npz;
pub use package::{BACKGROUND_TRUTH, DEPTH_TRUTH, MASKS_TRUTH, MOVERS_TRUTH};

use crate::scene::{Capture, Scene, View};
use error::Misfit;
use package::Package;

/// Writes `scene` in `layout` to `folder`, which must be empty or not exist.
///
/// # Errors
/// [`WriteError::Layout`] if the layout cannot represent the scene, [`WriteError::Occupied`] if the folder is not
/// empty. [`WriteError::Unwritable`] if a file cannot be written, [`WriteError::Picture`] if an image of the scene
/// cannot be read.
pub fn write(scene: &Scene, layout: Layout, folder: &Path) -> Result<(), WriteError> {
    let package = package(scene, layout).map_err(|reason| refusal(scene.capture, layout, reason))?;
    let unplaced = package.pictures.iter().filter(|p| p.view.mask.is_some() && p.mask.is_none()).count();
    if unplaced > 0 {
        warn!("{} has no place for masks: those of {unplaced} images are left out", layout.key());
    }
    package.store(folder)?;
    let (pictures, points) = (package.pictures.len(), scene.points.len());
    info!("{}: {pictures} images and {points} points as {}", folder.display(), layout.key());
    Ok(())
}

/// The content of the folder.
fn package(scene: &Scene, layout: Layout) -> Result<Package<'_>, Misfit> {
    if scene.capture != layout.capture() {
        let is = match scene.capture {
            Capture::Video => "it is a video, and that layout is for photos of one moment each",
            Capture::Photos => "it is a collection of photos, and that layout is for videos",
        };
        return Err(is.into());
    }
    let Some(first) = scene.train.first() else { return Err("it has no view to train on".into()) };
    let size = |v: &View| (v.camera.width, v.camera.height);
    if let Some(other) = scene.train.iter().chain(&scene.test).find(|view| size(view) != size(first)) {
        let ((w, h), (v, g)) = (size(first), size(other));
        return Err(format!("its images differ in size ({} is {w}x{h}, {} is {v}x{g})", first.name, other.name));
    }
    if scene.test.is_empty() && layout.needs_test_views() {
        return Err("it holds nothing out, and that layout has no word for this".into());
    }
    layout.package(scene)
}

fn refusal(capture: Capture, layout: Layout, reason: Misfit) -> WriteError {
    let fitting: Vec<&str> = Layout::ALL.into_iter().filter(|l| l.capture() == capture).map(Layout::key).collect();
    let kind = match capture {
        Capture::Video => "Videos",
        Capture::Photos => "Photos",
    };
    WriteError::Layout { layout: layout.key(), reason, advice: format!("{kind} are written as {}", fitting.join(", ")) }
}
