//! `report.html`: a run on one page, built only from the files of its folder.
//!
//! The page is self-contained: it includes style, script and images, and its security policy forbids network access.
//! Its size is bounded by two budgets for images (`album`, `film`); everything else takes some hundred kilobytes.
//! Text from the run's files is escaped by [`maud`]. If a file is missing or broken, its section says so, and the other
//! sections are not affected.

mod album;
mod curve;
mod files;
mod film;
mod head;
mod images;
mod log;
mod meaning;
mod modules;
mod page;
mod picture;
mod record;
mod rig;
mod scores;
mod snippet;
mod training;
mod views;

use std::path::{Path, PathBuf};

use album::Album;
use files::RunFiles;
use film::Film;

use crate::{atomic, run};

/// The report of a run as HTML.
///
/// # Errors
/// If the folder does not exist or is not a run.
pub fn html(run: &Path) -> anyhow::Result<String> {
    let files = RunFiles::read(run)?;
    let (album, film) = (Album::read(&files), Film::read(&files));
    Ok(page::page(&files, &album, &film).into_string())
}

/// Writes the report to the run folder, and returns its path.
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
