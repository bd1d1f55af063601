//! The content of a folder in some layout, and functions that write it to disk.

use std::fmt::Display;
use std::path::{Path, PathBuf};
use std::{fs, io};

use image::{ImageError, ImageFormat};
use rayon::prelude::*;

use super::{WriteError, encode};
use crate::files::TemporaryFolder;
use crate::scene::View;

/// Folder of the motion masks (white = moving), as [`attach_masks`](crate::attach_masks) reads it.
pub const MASKS_TRUTH: &str = "masks_truth";

/// Folder of the masks of movers, which exclude objects that sway in place.
pub const MOVERS_TRUTH: &str = "movers_truth";

/// Folder of the photos without anything that moves.
pub const BACKGROUND_TRUTH: &str = "background_truth";

/// Folder of the depths along the camera's axis: `.npy` files, float32, `[height, width]`.
pub const DEPTH_TRUTH: &str = "depth_truth";

/// Prefix of the folder that contains everything until it is complete.
const DRAFT: &str = ".unfinished-";

/// The content of the folder, with relative paths.
#[derive(Default)]
pub(super) struct Package<'a> {
    pub(super) pictures: Vec<PictureEntry<'a>>,
    /// All files except images and ground truth.
    pub(super) files: Vec<(String, Vec<u8>)>,
}

/// A view's image and its destination.
#[derive(Clone)]
pub(super) struct PictureEntry<'a> {
    pub(super) view: &'a View,
    pub(super) file: String,
    /// The view's name in our reader, under which its ground truth is stored.
    pub(super) name: String,
    /// Destination of its mask, if it has one and the layout supports masks.
    pub(super) mask: Option<String>,
}

impl Package<'_> {
    /// Writes everything to `folder`. Nothing appears there until all of it is written. An interrupted program leaves
    /// nothing that looks like a scene, and the next one removes it. An error leaves nothing at all.
    pub(super) fn store(&self, folder: &Path) -> Result<(), WriteError> {
        let made = make_room(folder)?;
        let stored = self.store_within(folder);
        if stored.is_err() {
            // A folder that somebody else has put something into stays.
            let _ = made.iter().try_for_each(fs::remove_dir);
        }
        stored
    }

    fn store_within(&self, folder: &Path) -> Result<(), WriteError> {
        // Within the folder, because that may be a link or a mount point.
        let fail = |e: io::Error| unwritable(folder, &e);
        let draft = TemporaryFolder::new(folder, &mut tempfile::Builder::new(), DRAFT).map_err(fail)?;
        let content = draft.path().join("scene");
        fs::create_dir(&content).map_err(fail)?;
        self.store_draft(&content)?;
        publish(&content, folder).map_err(fail)
    }

    /// Writes the images first. Without the files that describe them, they are not a scene.
    fn store_draft(&self, folder: &Path) -> Result<(), WriteError> {
        let stored: Vec<Result<(), WriteError>> = self.pictures.par_iter().map(|entry| entry.store(folder)).collect();
        // The first error in the order of the views, whichever thread found one first.
        stored.into_iter().collect::<Result<(), _>>()?;
        self.files.iter().try_for_each(|(name, bytes)| {
            save(&folder.join(name), |path| fs::write(path, bytes).map_err(ImageError::IoError))
        })
    }
}

impl PictureEntry<'_> {
    fn store(&self, folder: &Path) -> Result<(), WriteError> {
        let image = self.view.image.rgb()?;
        save(&folder.join(&self.file), |path| image.save_with_format(path, ImageFormat::Png))?;
        if let (Some(mask), Some(file)) = (&self.view.mask, &self.mask) {
            let mask = mask.read()?;
            save(&folder.join(file), |path| mask.save_with_format(path, ImageFormat::Png))?;
        }
        self.store_truth(folder)
    }

    fn store_truth(&self, folder: &Path) -> Result<(), WriteError> {
        let truth = &self.view.truth;
        let place = |kind: &str, extension: &str| folder.join(kind).join(format!("{}.{extension}", self.name));
        for (kind, mask) in [(MASKS_TRUTH, &truth.dynamic_mask), (MOVERS_TRUTH, &truth.movers_mask)] {
            if let Some(mask) = mask {
                let mask = mask.mask()?;
                save(&place(kind, "png"), |path| mask.save_with_format(path, ImageFormat::Png))?;
            }
        }
        if let Some(background) = &truth.background {
            let background = background.rgb()?;
            save(&place(BACKGROUND_TRUTH, "png"), |path| background.save_with_format(path, ImageFormat::Png))?;
        }
        if let Some(depth) = &truth.depth {
            let shape = [self.view.camera.height, self.view.camera.width];
            save(&place(DEPTH_TRUTH, "npy"), |path| {
                let bytes = encode::npy(&shape, depth.iter().copied())?;
                fs::write(path, bytes).map_err(ImageError::IoError)
            })?;
        }
        Ok(())
    }
}

/// Creates the folder. It must be empty. Returns the folders that did not exist before, the innermost first.
fn make_room(folder: &Path) -> Result<Vec<PathBuf>, WriteError> {
    let fail = |e: io::Error| unwritable(folder, &e);
    let missing = |folder: &&Path| !folder.as_os_str().is_empty() && !folder.exists();
    let made = folder.ancestors().take_while(missing).map(Path::to_owned).collect();
    fs::create_dir_all(folder).map_err(fail)?;
    TemporaryFolder::remove_abandoned(folder, DRAFT);
    // The same one is named every time.
    match fs::read_dir(folder).map_err(fail)?.flatten().map(|entry| entry.file_name()).min() {
        None => Ok(made),
        Some(entry) => {
            Err(WriteError::Occupied { folder: folder.to_owned(), entry: entry.to_string_lossy().into_owned() })
        }
    }
}

/// Moves the content of `draft` to `folder` with a few renames: folders first, then the files that describe them.
fn publish(draft: &Path, folder: &Path) -> io::Result<()> {
    let entry = |entry: io::Result<fs::DirEntry>| entry.map(|entry| (entry.path().is_file(), entry.file_name()));
    let mut entries = fs::read_dir(draft)?.map(entry).collect::<io::Result<Vec<_>>>()?;
    entries.sort();
    entries.iter().try_for_each(|(_, name)| fs::rename(draft.join(name), folder.join(name)))
}

/// Writes a file and creates its folders.
fn save(path: &Path, write: impl FnOnce(&Path) -> Result<(), ImageError>) -> Result<(), WriteError> {
    let made = path.parent().map_or(Ok(()), fs::create_dir_all).map_err(ImageError::IoError);
    made.and_then(|()| write(path)).map_err(|e| unwritable(path, &e))
}

fn unwritable(path: &Path, reason: &dyn Display) -> WriteError {
    WriteError::Unwritable { path: path.to_owned(), reason: reason.to_string() }
}
