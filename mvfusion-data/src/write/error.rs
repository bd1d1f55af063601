//! Why a scene cannot be written.

use std::path::PathBuf;

use thiserror::Error;

use crate::DataError;

/// Why a scene cannot be written. Each message says what to do.
#[derive(Debug, Error)]
pub enum WriteError {
    /// A scene that a layout to be written has no words for.
    #[error("the scene cannot be written as {layout}: {reason}. {advice}.")]
    Layout {
        /// The layout, as the command line names it.
        layout: &'static str,
        /// What does not fit.
        reason: String,
        /// Which layouts are for scenes of its kind.
        advice: String,
    },
    /// A folder to write to that already holds something.
    #[error("{folder} is not empty, and nothing is overwritten. Give a folder that is new or empty.")]
    Occupied {
        /// The folder.
        folder: PathBuf,
    },
    /// A file or folder that cannot be written.
    #[error("cannot write {path}: {reason}. Check that there is room and that you may write there.")]
    Unwritable {
        /// The file or folder.
        path: PathBuf,
        /// What the operating system said.
        reason: String,
    },
    /// A picture of the scene that cannot be read.
    #[error(transparent)]
    Picture(#[from] DataError),
}
