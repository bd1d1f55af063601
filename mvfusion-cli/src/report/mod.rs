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

use anyhow::bail;
use mvfusion_data::files::read_text;

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
/// As [`html()`]; if the folder holds a page of another program under that name; if the file cannot be written.
pub fn write(run: &Path) -> anyhow::Result<PathBuf> {
    let path = run.join(run::REPORT);
    let page = html(run)?;
    // Others use names like those of a run as well, so a folder with some of them may be theirs.
    if path.exists() && !run::is_run(run) && !is_ours(&path) {
        bail!(
            "{} was not written by this program, and its folder has no {} of a run, so the report does not replace it. \
             Move it away, or give another folder.",
            path.display(),
            run::RECORD
        );
    }
    atomic::write(&path, page.as_bytes())?;
    Ok(path)
}

/// Whether a file is a report of this program, of any version.
fn is_ours(path: &Path) -> bool {
    read_text(path, run::MOST_OF_RECORDS).is_ok_and(|text| text.contains(page::MARK))
}

#[cfg(test)]
mod tests;
