//! What can be wrong with a dataset, said so that its owner can mend it.

use std::fmt;
use std::path::PathBuf;

use thiserror::Error;

/// Why a scene could not be read or written. Each message names the file and says what to do.
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
    /// A folder that was named does not exist, or cannot be listed.
    #[error("cannot open the folder {folder}: {reason}. {advice}")]
    Folder {
        /// The folder.
        folder: PathBuf,
        /// What the operating system said.
        reason: String,
        /// What to do.
        advice: &'static str,
    },
    /// Something that the format demands is not there.
    #[error("there is no {what} in {folder}. {advice}")]
    Missing {
        /// What was looked for.
        what: String,
        /// Where it was looked for.
        folder: PathBuf,
        /// What to do.
        advice: String,
    },
    /// A file other than a picture whose content cannot be used.
    #[error("cannot use {path}: {reason}. {advice}")]
    Content {
        /// The file.
        path: PathBuf,
        /// What is wrong in it, with the place.
        reason: String,
        /// What to do.
        advice: &'static str,
    },
    /// Two numbers that must agree do not.
    #[error("{folder}: {first}, but {second}. {advice}")]
    Disagreement {
        /// The scene's folder.
        folder: PathBuf,
        /// One side, with its number: `cam00 has 24 frames`.
        first: String,
        /// The other side, with its number.
        second: String,
        /// What to do.
        advice: String,
    },
    /// An option whose value makes no sense for this scene.
    #[error("the option {option} = {value} cannot be used: {reason}.")]
    Setting {
        /// Name of the option.
        option: &'static str,
        /// Its value as given.
        value: String,
        /// Why not, and which values can be used.
        reason: String,
    },
    /// A folder that no reader takes for its own.
    #[error("{folder} is in no format that can be read:{}", listed(.refusals))]
    Unrecognised {
        /// The folder.
        folder: PathBuf,
        /// Why each reader refused.
        refusals: Vec<Refusal>,
    },
}

/// Why one reader does not take a folder for its own.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Refusal {
    /// Name of the format.
    pub format: &'static str,
    /// What the reader missed.
    pub reason: String,
}

impl fmt::Display for Refusal {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{}: {}", self.format, self.reason)
    }
}

/// The refusals, a line each.
fn listed(refusals: &[Refusal]) -> String {
    refusals.iter().map(|r| format!("\n  {r}")).collect()
}
