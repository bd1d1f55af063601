//! What a run replaces waits in a subfolder until the new run is complete.
//!
//! The subfolder is inside the run folder, because that folder may be a link or a mount point that cannot be renamed.
//! Its entries move one by one, but each change of meaning is one rename, so that a process can be killed anywhere:
//!
//! | folder | contents | after an interruption |
//! |---|---|---|
//! | `.moving` | entries on their way | they move back to the top |
//! | `.replaced` | everything that was replaced, an older `.replaced` included | it waits |
//! | `.discarded` | what nobody needs | it is removed |
//!
//! Whoever calls these functions holds the lock of the folder.

use std::ffi::OsStr;
use std::fs;
use std::io;
use std::path::Path;

use mvfusion_model::files::is_unfinished;

use super::folder::Contents;

/// What waits until its successor is complete.
pub(super) const REPLACED: &str = ".replaced";
/// What is on its way.
const MOVING: &str = ".moving";
/// What is being removed.
const DISCARDED: &str = ".discarded";

/// Whether an entry of a folder belongs to this module.
pub(super) fn is_aside(name: &OsStr) -> bool {
    [REPLACED, MOVING, DISCARDED].iter().any(|known| name == *known)
}

/// Whether something waits in a folder, or was on its way back when a process was killed.
pub fn waits(folder: &Path) -> bool {
    [REPLACED, MOVING].iter().any(|name| folder.join(name).is_dir())
}

/// Whether a folder has a file of this name, among what waits or is on its way as well.
pub fn has_anywhere(folder: &Path, name: &str) -> bool {
    let places = [folder.to_owned(), folder.join(REPLACED), folder.join(MOVING)];
    places.iter().any(|place| place.join(name).is_file())
}

/// Completes what a killed process began, and removes its half-written files.
pub(super) fn settle(folder: &Path, contents: &Contents) -> io::Result<()> {
    remove_discarded(folder)?;
    if folder.join(MOVING).is_dir() {
        move_back(folder)?;
    }
    if (contents.is_complete)(folder) {
        discard_replaced(folder)?;
    }
    remove_unfinished(folder)?;
    let folders = contents.entries.iter().filter(|name| !contents.foreign.contains(name));
    folders
        .map(|name| folder.join(name))
        .filter(|path| path.is_dir())
        .try_for_each(|path| remove_unfinished_below(&path))
}

/// Moves the entries of a folder aside. If something waits already, what would be lost now waits before it; the rest of
/// an output that never came to anything is removed instead.
pub(super) fn set_aside(folder: &Path, contents: &Contents) -> io::Result<()> {
    let has_replaced = folder.join(REPLACED).is_dir();
    if has_replaced && !(contents.is_of_use)(folder) {
        return discard_entries(folder, contents);
    }
    move_entries(folder, contents, has_replaced)?;
    match folder.join(MOVING).is_dir() {
        true => fs::rename(folder.join(MOVING), folder.join(REPLACED)),
        false => Ok(()),
    }
}

/// Brings back what waits, in place of the entries that are there now.
pub(super) fn bring_back(folder: &Path, contents: &Contents) -> io::Result<()> {
    discard_entries(folder, contents)?;
    if folder.join(REPLACED).is_dir() {
        fs::rename(folder.join(REPLACED), folder.join(MOVING))?;
        move_back(folder)?;
    }
    Ok(())
}

/// Removes what waits.
pub(super) fn discard_replaced(folder: &Path) -> io::Result<()> {
    if !folder.join(REPLACED).is_dir() {
        return Ok(());
    }
    fs::rename(folder.join(REPLACED), folder.join(DISCARDED))?;
    remove_discarded(folder)
}

/// Removes the entries of a folder.
fn discard_entries(folder: &Path, contents: &Contents) -> io::Result<()> {
    move_entries(folder, contents, false)?;
    if folder.join(MOVING).is_dir() {
        fs::rename(folder.join(MOVING), folder.join(DISCARDED))?;
    }
    remove_discarded(folder)
}

/// Moves all entries, and what waits if `with_replaced`, to [`MOVING`].
fn move_entries(folder: &Path, contents: &Contents, with_replaced: bool) -> io::Result<()> {
    let known = contents.entries.iter().copied().chain(with_replaced.then_some(REPLACED));
    let present: Vec<&str> = known.filter(|name| folder.join(name).symlink_metadata().is_ok()).collect();
    if present.is_empty() {
        return Ok(());
    }
    let moving = folder.join(MOVING);
    fs::create_dir(&moving)?;
    present.into_iter().try_for_each(|name| fs::rename(folder.join(name), moving.join(name)))
}

/// Moves everything in [`MOVING`] back.
fn move_back(folder: &Path) -> io::Result<()> {
    let moving = folder.join(MOVING);
    for entry in fs::read_dir(&moving)? {
        let entry = entry?;
        fs::rename(entry.path(), folder.join(entry.file_name()))?;
    }
    fs::remove_dir(moving)
}

fn remove_discarded(folder: &Path) -> io::Result<()> {
    match fs::remove_dir_all(folder.join(DISCARDED)) {
        Err(error) if error.kind() != io::ErrorKind::NotFound => Err(error),
        _ => Ok(()),
    }
}

/// Removes the unfinished files of a killed process in a folder of this program.
fn remove_unfinished(folder: &Path) -> io::Result<()> {
    remove_files(folder, is_unfinished)
}

/// Removes the files of a folder whose names are such.
pub(crate) fn remove_files(folder: &Path, is_such: fn(&OsStr) -> bool) -> io::Result<()> {
    for entry in fs::read_dir(folder)? {
        let entry = entry?;
        if is_such(&entry.file_name()) && entry.file_type()?.is_file() {
            fs::remove_file(entry.path())?;
        }
    }
    Ok(())
}

/// The same in a folder and all folders below, without following links.
fn remove_unfinished_below(folder: &Path) -> io::Result<()> {
    remove_unfinished(folder)?;
    for entry in fs::read_dir(folder)? {
        let entry = entry?;
        if entry.file_type()?.is_dir() {
            remove_unfinished_below(&entry.path())?;
        }
    }
    Ok(())
}
