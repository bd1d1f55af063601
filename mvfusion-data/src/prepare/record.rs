//! The record of what was done, for people and for programs: `prepare.json`.

use std::fs;
use std::path::{Path, PathBuf};

use serde::Serialize;

use super::draft::RECORD;
use super::error::PrepareError;
use super::placed::Placed;
use super::sync::Offset;

/// What the scene was made of.
#[derive(Clone, Debug, PartialEq, Serialize)]
#[serde(tag = "kind", rename_all = "kebab-case")]
pub enum Footage {
    /// Photos.
    Photos {
        /// Their number.
        photos: usize,
    },
    /// A hand-held video.
    Video {
        /// Indices of the frames that were taken, from 0.
        frames: Vec<usize>,
    },
    /// A video for each still camera.
    Rig {
        /// Frames per second of the scene.
        fps: f64,
        /// Number of moments.
        moments: usize,
        /// The cameras.
        cameras: Vec<RigCamera>,
    },
}

/// A camera of a rig.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct RigCamera {
    /// Its name in the scene: `cam03`.
    pub name: String,
    /// Whether COLMAP placed it; otherwise it is not in the scene.
    pub placed: bool,
    /// Its video.
    pub video: PathBuf,
    /// Index of its first frame in the scene, from 0.
    pub first_frame: usize,
    pub(super) offset: Offset,
    /// The share of its first frame's edges that change in later frames; near 0 if it stands still.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub changing_edges: Option<f64>,
    /// The share of its first frame that COLMAP ignored.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub masked: Option<f64>,
}

/// The whole record.
#[derive(Debug, Serialize)]
pub(super) struct Record<'a> {
    pub(super) input: &'a Path,
    pub(super) colmap: &'a str,
    pub(super) seed: u64,
    #[serde(flatten)]
    pub(super) footage: &'a Footage,
    #[serde(flatten)]
    pub(super) placed: &'a Placed,
}

impl Record<'_> {
    /// Writes it to a folder.
    ///
    /// # Errors
    /// [`PrepareError::Unwritable`].
    pub(super) fn write(&self, folder: &Path) -> Result<(), PrepareError> {
        let path = folder.join(RECORD);
        let text = serde_json::to_string_pretty(self).map_err(|error| PrepareError::unwritable(&path, error))?;
        fs::write(&path, text + "\n").map_err(|error| PrepareError::unwritable(&path, error))
    }
}
