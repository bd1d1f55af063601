//! Masks for COLMAP, which ignores what is black in them. Ours are white where something moves.

use std::fs;
use std::path::{Path, PathBuf};

use image::{GrayImage, imageops};

use super::error::PrepareError;
use crate::error::DataError;
use crate::files::picture_named;
use crate::scene::Picture;

/// A folder of masks for COLMAP.
#[derive(Debug)]
pub(super) struct Masks {
    folder: PathBuf,
    /// Number of masks in it.
    pub(super) count: usize,
}

impl Masks {
    /// An empty folder of masks.
    ///
    /// # Errors
    /// [`PrepareError::Unwritable`].
    pub(super) fn create(folder: PathBuf) -> Result<Self, PrepareError> {
        fs::create_dir_all(&folder).map_err(|error| PrepareError::unwritable(&folder, error))?;
        Ok(Self { folder, count: 0 })
    }

    /// Adds the mask, white = moving, of an image by its file name.
    ///
    /// # Errors
    /// [`PrepareError::Unwritable`].
    pub(super) fn add(&mut self, image: &str, mut moving: GrayImage) -> Result<(), PrepareError> {
        imageops::invert(&mut moving);
        let path = self.folder.join(format!("{image}.png"));
        moving.save(&path).map_err(|error| PrepareError::unwritable(&path, error))?;
        self.count += 1;
        Ok(())
    }

    /// The folder, if there is a mask in it.
    pub(super) fn folder(&self) -> Option<&Path> {
        (self.count > 0).then_some(self.folder.as_path())
    }
}

/// The given mask of an image of `size` pixels; `None` if the folder has none with one of these names.
///
/// # Errors
/// [`DataError::Image`] if it cannot be read, [`DataError::Denied`] if it may not be. [`DataError::Content`] if it has
/// another shape.
pub(super) fn given(folder: &Path, names: &[String], size: (u32, u32)) -> Result<Option<GrayImage>, DataError> {
    let path = names.iter().find_map(|name| picture_named(folder, name));
    path.map(|path| Picture::file(path, size).mask()).transpose()
}

/// The error of a folder that has the mask of no image.
pub(super) fn none_given(folder: &Path, example: &str) -> PrepareError {
    PrepareError::Data(DataError::Missing {
        what: "mask of any image".into(),
        folder: folder.to_owned(),
        advice: format!("Masks are white where something moves, and named as the images, for example {example}.png"),
    })
}

/// A mask in which every white pixel has white ones around it, `reach` pixels far.
pub(super) fn grown(mask: &GrayImage, reach: u32) -> GrayImage {
    let (width, height) = mask.dimensions();
    let spread = |source: &GrayImage, (dx, dy): (u32, u32)| {
        GrayImage::from_fn(width, height, |x, y| {
            let columns = x.saturating_sub(dx)..=(x + dx).min(width - 1);
            let mut rows = y.saturating_sub(dy)..=(y + dy).min(height - 1);
            let is_white = rows.any(|y| columns.clone().any(|x| source.get_pixel(x, y).0[0] > 0));
            image::Luma([if is_white { 255 } else { 0 }])
        })
    };
    spread(&spread(mask, (reach, 0)), (0, reach))
}

#[cfg(test)]
mod tests {
    use image::Luma;

    use super::*;

    #[test]
    fn colmaps_masks_are_black_where_ours_are_white() {
        let folder = tempfile::tempdir().expect("folder");
        let given_folder = folder.path().join("given");
        fs::create_dir(&given_folder).expect("made");
        let moving = GrayImage::from_fn(24, 18, |x, _| Luma([if x < 12 { 255 } else { 0 }]));
        moving.save(given_folder.join("a.png")).expect("written");
        let mut masks = Masks::create(folder.path().join("masks")).expect("made");
        assert_eq!(masks.folder(), None);
        assert!(given(&given_folder, &["b".into()], (24, 18)).expect("looked").is_none());
        let found = given(&given_folder, &["a".into()], (24, 18)).expect("read").expect("there");
        masks.add("a.jpg", found).expect("written");
        let made = image::open(masks.folder().expect("one").join("a.jpg.png")).expect("read").into_luma8();
        assert_eq!((made.get_pixel(3, 3).0[0], made.get_pixel(20, 3).0[0]), (0, 255));
        assert!(given(&given_folder, &["a".into()], (24, 24)).is_err(), "another shape");
    }

    #[test]
    fn masks_grow_on_all_sides_and_stop_at_the_border() {
        let one = GrayImage::from_fn(9, 7, |x, y| Luma([if (x, y) == (1, 3) { 255 } else { 0 }]));
        let grown = grown(&one, 2);
        let white: Vec<(u32, u32)> = grown.enumerate_pixels().filter(|p| p.2.0[0] > 0).map(|p| (p.0, p.1)).collect();
        assert_eq!(white.len(), 4 * 5);
        assert!(white.contains(&(3, 5)) && white.contains(&(0, 1)) && !white.contains(&(4, 3)));
    }
}
