//! `report.html`: a run on one page, made from the files of its folder alone.
//!
//! The page needs nothing but itself: style, script and pictures are inside, and its security policy forbids it the
//! network. Whatever the run's files say is text, which [`maud`] escapes. A file that is missing or broken costs its
//! section, which then says so.

mod album;
mod curve;
mod files;
mod head;
mod images;
mod log;
mod meaning;
mod page;
mod picture;
mod record;
mod scores;
mod snippet;
mod training;
mod views;

use std::path::{Path, PathBuf};

use album::Album;
use files::RunFiles;

use crate::{atomic, run};

/// The report of a run as HTML.
///
/// # Errors
/// If the folder does not exist or is no run.
pub fn html(run: &Path) -> anyhow::Result<String> {
    let files = RunFiles::read(run)?;
    let album = Album::read(&files);
    Ok(page::page(&files, &album).into_string())
}

/// Writes the report into the run's folder, and returns where it lies.
///
/// # Errors
/// As [`html()`], and if the file cannot be written.
pub fn write(run: &Path) -> anyhow::Result<PathBuf> {
    let path = run.join(run::REPORT);
    atomic::write(&path, html(run)?.as_bytes())?;
    Ok(path)
}

#[cfg(test)]
mod tests;
