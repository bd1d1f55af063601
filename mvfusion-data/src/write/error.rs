//! Errors of writing a scene.

use std::path::PathBuf;

use thiserror::Error;

use crate::error::DataError;

/// The reason why a scene does not fit a layout, as a clause after a colon.
pub(super) type Misfit = String;

/// An error of writing a scene. Each message contains the remedy.
#[derive(Debug, Error)]
pub enum WriteError {
    /// The layout cannot represent the scene.
    #[error("the scene cannot be written as {layout}: {reason}. {advice}.")]
    Layout {
        /// The layout's name on the command line.
        layout: &'static str,
        /// The part that does not fit.
        reason: String,
        /// The layouts for scenes of its kind.
        advice: String,
    },
    /// The target folder is not empty.
    #[error(
        "{folder} is not empty (`{entry}` is in it), and nothing is overwritten. Give a folder that is new or empty."
    )]
    Occupied {
        /// The folder.
        folder: PathBuf,
        /// What is in it. Names that begin with a point are hidden from most listings.
        entry: String,
    },
    /// A file or folder cannot be written.
    #[error("cannot write {path}: {reason}. Check free space and write permission.")]
    Unwritable {
        /// The file or folder.
        path: PathBuf,
        /// The operating system's message.
        reason: String,
    },
    /// An image of the scene cannot be read.
    #[error(transparent)]
    Picture(#[from] DataError),
}
