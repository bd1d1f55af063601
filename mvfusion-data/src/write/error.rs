//! Why a scene cannot be written.

use std::path::PathBuf;

use thiserror::Error;

use crate::error::DataError;

/// Why a scene does not fit a layout, as a clause behind a colon.
pub(super) type Misfit = String;

/// Why a scene cannot be written. Each message says what to do.
#[derive(Debug, Error)]
pub enum WriteError {
    /// The layout cannot represent the scene.
    #[error("the scene cannot be written as {layout}: {reason}. {advice}.")]
    Layout {
        /// The layout, as the command line names it.
        layout: &'static str,
        /// What does not fit.
        reason: String,
        /// The layouts that fit scenes of its kind.
        advice: String,
    },
    /// The target folder is not empty.
    #[error("{folder} is not empty, and nothing is overwritten. Give a folder that is new or empty.")]
    Occupied {
        /// The folder.
        folder: PathBuf,
    },
    /// A file or folder cannot be written.
    #[error("cannot write {path}: {reason}. Check that there is room and that you may write there.")]
    Unwritable {
        /// The file or folder.
        path: PathBuf,
        /// The operating system's message.
        reason: String,
    },
    /// A picture of the scene cannot be read.
    #[error(transparent)]
    Picture(#[from] DataError),
}
