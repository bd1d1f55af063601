//! A folder of masks that no image uses, mostly because they are named in another way.

use std::fs;
use std::path::Path;

use crate::scene::Scene;

/// Folder of the masks, beside that of the images.
pub(crate) const MASKS: &str = "masks";

/// Levels of subfolders that are searched.
const LEVELS: usize = 8;

/// The files in the folder of masks that no view of the scene uses, with the reason `why`; `None` if there are none, or
/// a view has a mask.
pub(crate) fn ignored_masks(folder: &Path, scene: &Scene, why: &str) -> Option<String> {
    if scene.train.iter().chain(&scene.test).any(|view| view.mask.is_some()) {
        return None;
    }
    let files = match files_in(&folder.join(MASKS), LEVELS) {
        0 => return None,
        1 => "1 file".to_owned(),
        many => format!("{many} files"),
    };
    Some(format!("{MASKS}/ contains {files}, but {why}"))
}

/// The number of files in a folder and its subfolders that are not hidden.
fn files_in(folder: &Path, levels: usize) -> usize {
    let Ok(entries) = fs::read_dir(folder) else { return 0 };
    let visible = entries.flatten().filter(|entry| !entry.file_name().to_string_lossy().starts_with('.'));
    let files = visible.map(|entry| match entry.file_type() {
        // Links to folders are not followed: they may lead in circles.
        Ok(kind) if kind.is_dir() && levels > 0 => files_in(&entry.path(), levels - 1),
        Ok(kind) if !kind.is_dir() && entry.path().is_file() => 1,
        _ => 0,
    });
    files.sum()
}
