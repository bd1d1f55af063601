//! Errors of a dataset, with remedies.

use std::fmt;
use std::path::PathBuf;

use thiserror::Error;

/// Advice for a file or folder that this program may not read.
pub(crate) const MAKE_READABLE: &str = "Make it readable for the user who runs this program.";

/// Advice for an unusable image. The frames of several cameras belong together.
pub(crate) const REPLACE_IMAGE: &str = "Replace the file. If it is not needed, remove it: a photo together with its \
                                        pose, a frame of several cameras from every camera.";

/// The reason why a scene cannot be read, written or used. Each message names the file or view, and the remedy.
#[derive(Debug, Error)]
pub enum DataError {
    /// An image cannot be opened or decoded.
    #[error("cannot read the image {path}: {reason}. {REPLACE_IMAGE}")]
    Image {
        /// The file.
        path: PathBuf,
        /// The decoder's message.
        reason: String,
    },
    /// A file or folder exists, but this program may not read it.
    #[error("cannot read {path}: permission denied. {MAKE_READABLE}")]
    Denied {
        /// The file or folder.
        path: PathBuf,
    },
    /// A folder does not exist or cannot be listed.
    #[error("cannot open the folder {folder}: {reason}. {advice}")]
    Folder {
        /// The folder.
        folder: PathBuf,
        /// The operating system's message.
        reason: String,
        /// What to do.
        advice: &'static str,
    },
    /// Something that the format requires is missing.
    #[error("there is no {what} in {folder}. {advice}")]
    Missing {
        /// What is missing.
        what: String,
        /// Where it was expected.
        folder: PathBuf,
        /// What to do.
        advice: String,
    },
    /// The content of a file cannot be used.
    #[error("cannot use {path}: {reason}. {advice}")]
    Content {
        /// The file.
        path: PathBuf,
        /// The problem and its position in the file.
        reason: String,
        /// What to do.
        advice: &'static str,
    },
    /// Two numbers, or two lists of frames, that must agree differ.
    #[error("{folder}: {first}, but {second}. {advice}")]
    Disagreement {
        /// The scene's folder.
        folder: PathBuf,
        /// One side: `cam00 has 24 frames`.
        first: String,
        /// The other side.
        second: String,
        /// What to do.
        advice: String,
    },
    /// The value of an option of [`ReadOptions`](crate::ReadOptions) is invalid for this scene.
    #[error("scene.{option} = {value} cannot be used: {reason}. {advice}")]
    Setting {
        /// Name of the option, which is a key of `[scene]` in a configuration.
        option: &'static str,
        /// Its value, as given.
        value: String,
        /// The problem.
        reason: String,
        /// A valid value, and how to set it.
        advice: String,
    },
    /// A scene that a program built cannot be used: see [`Scene::check`](crate::Scene::check).
    #[error("the scene {scene} cannot be used: {reason}. {advice}")]
    Scene {
        /// The scene's name.
        scene: String,
        /// The problem, with the name of the view or the index of the point.
        reason: String,
        /// What to do.
        advice: &'static str,
    },
    /// No reader recognises the folder.
    #[error(
        "{folder} is in no format that can be read:{}\nFor images or videos without cameras, `mvfusion prepare` finds \
         them.", listed(.refusals)
    )]
    Unrecognised {
        /// The folder.
        folder: PathBuf,
        /// The reason of each reader.
        refusals: Vec<Refusal>,
    },
}

/// Why a reader does not recognise a folder.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Refusal {
    /// Name of the format.
    pub format: &'static str,
    /// What is missing.
    pub reason: String,
}

impl fmt::Display for Refusal {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{}: {}", self.format, self.reason)
    }
}

/// The refusals, one per line.
fn listed(refusals: &[Refusal]) -> String {
    refusals.iter().map(|r| format!("\n  {r}")).collect()
}
