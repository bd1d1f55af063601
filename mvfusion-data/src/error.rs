//! What can be wrong with a dataset, said so that its owner can mend it.

use std::path::PathBuf;

use thiserror::Error;

/// Why a scene could not be read. Each message names the file and says what to do.
#[derive(Debug, Error)]
pub enum DataError {
    /// A picture that cannot be opened or decoded.
    #[error("cannot read the picture {path}: {reason}. Replace the file, or remove it if the frame is not needed.")]
    Image {
        /// The file.
        path: PathBuf,
        /// What the decoder said.
        reason: String,
    },
}
