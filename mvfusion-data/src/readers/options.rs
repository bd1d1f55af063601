//! Options for reading a scene.

use std::path::{Path, PathBuf};

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};
use tracing::warn;

use super::format::Format;
use crate::error::DataError;
use crate::scene::Capture;

/// Options for reading a scene.
#[derive(Clone, Debug, PartialEq)]
pub struct ReadOptions {
    /// The format. By default it is detected.
    pub format: Option<Format>,
    /// The kind of capture, instead of that of the format.
    pub capture: Option<Capture>,
    /// Factor by which images are downscaled, at least 1. Default 1.
    pub downscale: f64,
    /// Number of frames of each camera of a video that are used, from the first on. `None` uses all. Default 300, as in
    /// DeGauss.
    pub frames: Option<usize>,
    /// The map from a frame's index to a time.
    pub time: TimeRule,
    /// If nothing else defines the split, every n-th of the sorted photos is held out, from the first on. 0 holds none
    /// out. Default 8, LLFF's rule.
    pub test_every: usize,
    /// Names of the cameras to hold out instead of the format's default. For formats whose views are named
    /// `camera/frame`.
    pub test_cameras: Option<Vec<String>>,
    /// RGB colour behind transparent pixels. Default black.
    pub backdrop: [u8; 3],
    /// Whether black pixels of masks are valid instead of white ones.
    pub invert_masks: bool,
    /// Folder in which decoded frames of videos are kept. `None` uses a temporary one.
    pub frame_store: Option<PathBuf>,
}

/// Number by which the original divides a frame's index (METHOD §5.1).
const ORIGINAL_FRAMES: usize = 300;

impl Default for ReadOptions {
    fn default() -> Self {
        Self {
            format: None,
            capture: None,
            downscale: 1.0,
            frames: Some(ORIGINAL_FRAMES),
            time: TimeRule::default(),
            test_every: 8,
            test_cameras: None,
            backdrop: [0; 3],
            invert_masks: false,
            frame_store: None,
        }
    }
}

/// The map from a frame's index to a time in `[0, 1]`.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "kebab-case")]
pub enum TimeRule {
    /// Index / number of frames used. For 300 frames it equals the original. The default.
    #[default]
    FrameOverCount,
    /// Index / 300, as in the original (METHOD §5.1), however many frames there are.
    #[serde(rename = "frame-over-300")]
    FrameOver300,
}

impl ReadOptions {
    /// The largest number of frames of each camera.
    ///
    /// # Errors
    /// [`DataError::Setting`] if it is 0.
    pub(crate) fn frame_limit(&self) -> Result<usize, DataError> {
        match self.frames {
            Some(0) => {
                let (reason, advice) =
                    ("at least one frame is needed".into(), "Set it with `--set scene.frames=300`".into());
                Err(DataError::Setting { option: "frames", value: "0".into(), reason, advice })
            }
            limit => Ok(limit.unwrap_or(usize::MAX)),
        }
    }

    /// Warns if the default limit leaves out some of the `available` frames of a camera. Any other limit was chosen.
    pub(crate) fn warn_of_unused_frames(&self, folder: &Path, available: usize) {
        if self.frames == Some(ORIGINAL_FRAMES) && available > ORIGINAL_FRAMES {
            warn!(
                folder = %folder.display(),
                "only the first {ORIGINAL_FRAMES} of {available} frames of each camera are read (scene.frames)"
            );
        }
    }

    /// The number that divides the index of one of `count` frames to give its time.
    ///
    /// # Errors
    /// [`DataError::Setting`] if a time would exceed 1.
    pub(crate) fn times_divisor(&self, count: usize) -> Result<f64, DataError> {
        match self.time {
            TimeRule::FrameOverCount => Ok(count as f64),
            TimeRule::FrameOver300 if count <= ORIGINAL_FRAMES => Ok(ORIGINAL_FRAMES as f64),
            TimeRule::FrameOver300 => Err(DataError::Setting {
                option: "time",
                value: "frame-over-300".into(),
                reason: format!("{count} frames would reach beyond time 1"),
                advice: "Read fewer frames with `--set scene.frames=300`, or set `--set scene.time=frame-over-count`"
                    .into(),
            }),
        }
    }
}

/// Whether the photo at a place in the sorted order is held out, if nothing else defines the split: every n-th one, or
/// none for 0 (see [`ReadOptions::test_every`]).
///
/// # Errors
/// [`DataError::Setting`] if it would hold out every photo.
pub(crate) fn every_so_many(test_every: usize) -> Result<impl Fn(usize) -> bool, DataError> {
    if test_every == 1 {
        let reason = "it would hold out every photo".into();
        let advice = "Hold out every 8th, as usual, with `--set scene.test_every=8`, or none with 0".into();
        return Err(DataError::Setting { option: "test_every", value: test_every.to_string(), reason, advice });
    }
    Ok(move |place: usize| test_every > 0 && place.is_multiple_of(test_every))
}
