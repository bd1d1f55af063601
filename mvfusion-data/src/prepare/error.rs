//! Errors of preparing a scene.

use std::path::PathBuf;

use thiserror::Error;

use crate::error::DataError;

/// The ways to get COLMAP.
const INSTALL: &str = "Install it with `apt install colmap` (Debian, Ubuntu), `brew install colmap` (macOS) or `conda \
                       install -c conda-forge colmap`; for Windows, unpack the zip from \
                       https://github.com/colmap/colmap/releases and give --colmap PATH/COLMAP.bat. Footage whose \
                       poses are known needs no COLMAP (docs/data.md)";

/// The reason why no scene can be made. Each message contains the remedy.
#[derive(Debug, Error)]
pub enum PrepareError {
    /// COLMAP cannot be started.
    #[error("COLMAP finds the poses of the cameras, and `{program}` {reason}. {INSTALL}.")]
    NoColmap {
        /// The program that was tried.
        program: String,
        /// What happened, as a clause.
        reason: String,
    },
    /// The input is not what can be prepared.
    #[error("cannot prepare {input}: {reason}.")]
    Input {
        /// The file or folder.
        input: PathBuf,
        /// What is wrong, and what to do.
        reason: String,
    },
    /// An option does not fit the input.
    #[error("the option {option} cannot be used: {reason}.")]
    Option {
        /// Its name on the command line.
        option: &'static str,
        /// The reason, and the valid values.
        reason: String,
    },
    /// The output folder holds something that must not be replaced.
    #[error("{folder} is there already{reason}.")]
    Occupied {
        /// The folder.
        folder: PathBuf,
        /// What to do.
        reason: String,
    },
    /// A step of COLMAP failed.
    #[error("COLMAP's {step} failed ({status}){said}. Its log is {log}. {advice}.")]
    Step {
        /// Its command.
        step: &'static str,
        /// How the program ended.
        status: String,
        /// Its last words, after a colon.
        said: String,
        /// The whole log.
        log: PathBuf,
        /// What to do.
        advice: &'static str,
    },
    /// COLMAP placed too few images.
    #[error("COLMAP placed {placed} of {total} {what}; {failed} failed: {names}. {help} Its log is {log}.")]
    Unplaced {
        /// Number of placed images.
        placed: usize,
        /// Number of all images.
        total: usize,
        /// Number of those that were not placed.
        failed: usize,
        /// `photos` or `cameras`.
        what: &'static str,
        /// Those that were not placed.
        names: String,
        /// What helps, in sentences.
        help: String,
        /// The whole log.
        log: PathBuf,
    },
    /// The listener ended the preparation.
    #[error("the preparation was ended, and nothing is left of it.")]
    Interrupted,
    /// A photo, a video or a mask cannot be used.
    #[error(transparent)]
    Data(#[from] DataError),
    /// A file or folder cannot be written.
    #[error("cannot write {path}: {reason}. Check free space and write permission.")]
    Unwritable {
        /// The file or folder.
        path: PathBuf,
        /// The operating system's message.
        reason: String,
    },
}

impl PrepareError {
    /// Whether the command line or the installation is at fault, and not the footage.
    pub fn is_usage(&self) -> bool {
        matches!(self, Self::NoColmap { .. } | Self::Input { .. } | Self::Option { .. } | Self::Occupied { .. })
    }

    /// In a clause, for a note about a step whose failure ends nothing.
    pub(super) fn in_short(&self) -> String {
        match self {
            Self::Step { step, status, said, .. } => format!("COLMAP's {step} failed ({status}){said}"),
            other => other.to_string().trim_end_matches('.').to_owned(),
        }
    }

    pub(super) fn unwritable(path: &std::path::Path, error: impl ToString) -> Self {
        Self::Unwritable { path: path.to_owned(), reason: error.to_string() }
    }
}
