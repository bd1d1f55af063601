//! Masks of valid pixels, in `masks/` next to the folder of the images.

use std::path::{Path, PathBuf};

use crate::error::DataError;
use crate::files::entries;
use crate::readers::shared::ignored_masks::{MASKS, ignored_masks};
use crate::scene::{Picture, Scene, View};

/// The mask of an image. For `2clutter008.JPG` it is `2clutter008.png` or, as COLMAP names it, `2clutter008.JPG.png`.
pub(super) fn beside(scene: &Path, picture: &str) -> Option<PathBuf> {
    let masks = scene.join(MASKS);
    let candidates = [masks.join(picture).with_extension("png"), masks.join(format!("{picture}.png"))];
    candidates.into_iter().find(|path| path.is_file())
}

/// Checks that the folder may be read if there is one: masks that may not be would seem to be absent.
pub(super) fn check_access(scene: &Path) -> Result<(), DataError> {
    let masks = scene.join(MASKS);
    if masks.is_dir() {
        entries(&masks, "Remove the folder to train without masks")?;
    }
    Ok(())
}

/// The masks that are named like no image that is used; `None` if there are none, or an image has a mask. `folder` holds
/// the folder of the images.
pub(super) fn ignored(folder: &Path, scene: &Scene) -> Option<String> {
    let view = scene.train.first()?;
    let (name, extension) = (&view.name, extension(view));
    let why = format!("none is named like an image that is used (expected {name}.png or {name}.{extension}.png)");
    ignored_masks(folder, scene, &why)
}

/// The extension of the image of a view.
fn extension(view: &View) -> String {
    let extension = match &view.image {
        Picture::File(file) => file.source.path().extension().map(|extension| extension.to_string_lossy().into_owned()),
        Picture::Memory(_) => None,
    };
    extension.unwrap_or_else(|| "jpg".into())
}
