//! Images in a folder, recognised by their extensions.

use std::collections::BTreeSet;
use std::fs::{self, DirEntry};
use std::path::{Path, PathBuf};

use super::denied::or_denied;
use crate::error::DataError;

/// Extensions of images, in lower case and in search order. Some cameras write capitals.
const PICTURE_EXTENSIONS: [&str; 4] = ["png", "jpg", "jpeg", "exr"];

/// Levels of subfolders that are searched.
const LEVELS: usize = 8;

/// The images in a folder, sorted by name.
///
/// # Errors
/// [`DataError::Folder`] if it cannot be listed, [`DataError::Denied`] if it may not be.
pub(crate) fn pictures_in(folder: &Path) -> Result<Vec<PathBuf>, DataError> {
    let mut paths = entries(folder, "Put the photos there")?;
    paths.retain(|path| is_picture(path));
    Ok(paths)
}

/// The number of images in a folder and its subfolders that are not among `known`.
pub(crate) fn others_than(known: &BTreeSet<PathBuf>, folder: &Path) -> usize {
    others(known, folder, LEVELS)
}

fn others(known: &BTreeSet<PathBuf>, folder: &Path, levels: usize) -> usize {
    let Ok(entries) = fs::read_dir(folder) else { return 0 };
    let count = |entry: DirEntry| match entry.file_type() {
        // Links to folders are not followed: they may lead in circles.
        Ok(kind) if kind.is_dir() && levels > 0 => others(known, &entry.path(), levels - 1),
        Ok(kind) if !kind.is_dir() => usize::from(is_picture(&entry.path()) && !known.contains(&entry.path())),
        _ => 0,
    };
    entries.flatten().map(count).sum()
}

/// The image with this name in a folder or below it, whatever its extension.
pub(crate) fn picture_named(folder: &Path, stem: &str) -> Option<PathBuf> {
    let spellings = PICTURE_EXTENSIONS.iter().flat_map(|extension| [(*extension).to_owned(), extension.to_uppercase()]);
    spellings.map(|extension| folder.join(format!("{stem}.{extension}"))).find(|path| path.is_file())
}

fn is_picture(path: &Path) -> bool {
    let extension = path.extension().and_then(|e| e.to_str()).unwrap_or("").to_ascii_lowercase();
    // macOS creates a file `._0000.png` next to each `0000.png` on foreign disks. It is not an image.
    let is_hidden = path.file_name().is_some_and(|name| name.to_string_lossy().starts_with('.'));
    PICTURE_EXTENSIONS.contains(&extension.as_str()) && !is_hidden
}

/// The entries of a folder, sorted by name.
pub(crate) fn entries(folder: &Path, advice: &'static str) -> Result<Vec<PathBuf>, DataError> {
    let fail =
        |e: std::io::Error| or_denied(DataError::Folder { folder: folder.to_owned(), reason: e.to_string(), advice });
    let listing: Result<Vec<_>, _> = fs::read_dir(folder).map_err(fail)?.map(|e| e.map(|e| e.path())).collect();
    let mut paths = listing.map_err(fail)?;
    paths.sort();
    Ok(paths)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn pictures_are_found_whatever_the_case_of_their_extension_and_hidden_files_are_none() {
        let folder = tempfile::tempdir().expect("folder");
        for name in ["b.JPG", "a.png", "._a.png", "notes.txt", "c.1.exr"] {
            fs::write(folder.path().join(name), "").expect("written");
        }
        let names = ["a.png", "b.JPG", "c.1.exr"].map(|name| folder.path().join(name));
        assert_eq!(pictures_in(folder.path()).expect("listed"), names);
        assert_eq!(["a", "b", "c.1"].map(|stem| picture_named(folder.path(), stem)), names.map(Some));
        assert_eq!(picture_named(folder.path(), "c"), None);
    }
}
