//! Masks of what moves, kept in a folder of their own beside a scene.

use std::path::{Path, PathBuf};

use image::GrayImage;
use tracing::{debug, warn};

use crate::frames::picture_named;
use crate::picture::file_size;
use crate::{DataError, Picture, Scene};

/// Which pixels of a picture count: for the loss of training and for scores.
#[derive(Clone, Debug)]
pub struct Mask {
    /// Its first channel says it.
    pub picture: Picture,
    /// Whether black counts and white is ignored. Else white counts, as nerfstudio and COLMAP have it.
    pub inverted: bool,
}

impl Mask {
    /// The mask: 255 where the picture's pixel counts, 0 where it is to be ignored. What lies between goes to the nearer.
    ///
    /// # Errors
    /// [`DataError::Image`] if the file cannot be read.
    pub fn read(&self) -> Result<GrayImage, DataError> {
        let mut mask = self.picture.mask()?;
        for pixel in mask.pixels_mut() {
            pixel.0[0] = if (pixel.0[0] >= 128) != self.inverted { 255 } else { 0 };
        }
        Ok(mask)
    }
}

/// The mask of a picture that lies in `masks/` beside the pictures' folder: `2clutter008.png`, or `2clutter008.JPG.png` as
/// COLMAP names it, for `2clutter008.JPG`.
pub(crate) fn mask_beside(folder: &Path, picture: &str) -> Option<PathBuf> {
    let masks = folder.join("masks");
    let candidates = [masks.join(picture).with_extension("png"), masks.join(format!("{picture}.png"))];
    candidates.into_iter().find(|path| path.is_file())
}

/// Sets [`Truth::dynamic_mask`](crate::Truth) of every view for which `folder` holds a file of the view's name, such as
/// `cam00/0003.png` or `2clutter008.png`, and returns for how many. White means moving. A mask of another size than its view's picture is
/// resized without blending when it is read.
///
/// # Errors
/// [`DataError::Folder`] if the folder does not exist, [`DataError::Image`] if a mask has no readable header,
/// [`DataError::Missing`] if no view has a mask.
pub fn attach_masks(scene: &mut Scene, folder: &Path) -> Result<usize, DataError> {
    if let Err(error) = std::fs::read_dir(folder) {
        let advice = "Give the folder that holds the masks, named as the frames (white = moving)";
        return Err(DataError::Folder { folder: folder.to_owned(), reason: error.to_string(), advice });
    }
    let mut attached = 0;
    for view in scene.train.iter_mut().chain(&mut scene.test) {
        let Some(path) = picture_named(folder, &view.name) else { continue };
        let (width, height) = (view.camera.width, view.camera.height);
        let (w, h) = file_size(&path)?;
        // Compared as fractions: sizes that were rounded differ by up to a pixel.
        if (w as f64 / h as f64 - width as f64 / height as f64).abs() * height as f64 > 2.0 {
            warn!(mask = %path.display(), "the mask is {w}x{h}, the picture {width}x{height}: their shapes differ");
        }
        view.truth.dynamic_mask = Some(Picture::file(path, (width as u32, height as u32)));
        attached += 1;
    }
    let views = scene.train.len() + scene.test.len();
    if attached == 0 {
        let example = scene.train.iter().chain(&scene.test).next().map_or("", |v| &v.name);
        return Err(DataError::Missing {
            what: "mask of any view".into(),
            folder: folder.to_owned(),
            advice: format!("Masks are named as the views, for example {example}.png"),
        });
    }
    debug!(masks = attached, views, "masks attached, white = moving");
    Ok(attached)
}
