//! How a scene is read: what its owner may choose.

use std::path::PathBuf;

use serde::{Deserialize, Serialize};

use crate::{DataError, Format};

/// How a scene is read.
#[derive(Clone, Debug, PartialEq)]
pub struct ReadOptions {
    /// The format; tried in turn if absent.
    pub format: Option<Format>,
    /// Pictures are made smaller by this factor, at least 1. Default 1.
    pub downscale: f64,
    /// How many frames of each camera of a video are used, from the first on; all if absent. Default 300, as DeGauss.
    pub frames: Option<usize>,
    /// How a frame's index becomes a time.
    pub time: TimeRule,
    /// Where nothing says what a photo is for, every so many of the sorted photos is held out, from the first on; 0 holds
    /// none out. Default 8, LLFF's rule.
    pub test_every: usize,
    /// Names of the cameras to hold out instead of those that the format holds out; for formats whose views are named
    /// `camera/frame`.
    pub test_cameras: Option<Vec<String>>,
    /// RGB that shows where pictures are transparent. Default black.
    pub backdrop: [u8; 3],
    /// Whether black counts in masks, not white.
    pub invert_masks: bool,
    /// Folder in which the decoded frames of videos stay; a temporary one if absent.
    pub frame_store: Option<PathBuf>,
}

/// Number of frames by which the original divides a frame's index (METHOD §5.1).
const ORIGINAL_FRAMES: usize = 300;

impl Default for ReadOptions {
    fn default() -> Self {
        Self {
            format: None,
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

/// How a frame's index becomes a time in `[0, 1]`.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum TimeRule {
    /// Index / number of frames used; the same as the original for 300 frames. The default.
    #[default]
    FrameOverCount,
    /// Index / 300, as in the original (METHOD §5.1), however many frames there are.
    #[serde(rename = "frame-over-300")]
    FrameOver300,
}

impl ReadOptions {
    /// How many frames of each camera are used at most.
    ///
    /// # Errors
    /// [`DataError::Setting`] for none.
    pub(crate) fn frame_limit(&self) -> Result<usize, DataError> {
        match self.frames {
            Some(0) => {
                let reason = "at least one frame is needed; leave it out for all".into();
                Err(DataError::Setting { option: "frames", value: "0".into(), reason })
            }
            limit => Ok(limit.unwrap_or(usize::MAX)),
        }
    }

    /// What the index of one of `count` frames is divided by to become a time.
    ///
    /// # Errors
    /// [`DataError::Setting`] if a time would lie beyond 1.
    pub(crate) fn times_divisor(&self, count: usize) -> Result<f64, DataError> {
        match self.time {
            TimeRule::FrameOverCount => Ok(count as f64),
            TimeRule::FrameOver300 if count <= ORIGINAL_FRAMES => Ok(ORIGINAL_FRAMES as f64),
            TimeRule::FrameOver300 => Err(DataError::Setting {
                option: "time",
                value: "frame-over-300".into(),
                reason: format!(
                    "{count} frames would reach beyond time 1; set frames = 300 or time = \"frame-over-count\""
                ),
            }),
        }
    }
}

/// Whether the photo at a place among the sorted ones is held out, where nothing else says what photos are for: every so many
/// are, none for 0 (see [`ReadOptions::test_every`]).
///
/// # Errors
/// [`DataError::Setting`] if every photo would be.
pub(crate) fn every_so_many(test_every: usize) -> Result<impl Fn(usize) -> bool, DataError> {
    if test_every == 1 {
        let reason = "it would hold out every photo; 8 is usual, 0 holds none out".into();
        return Err(DataError::Setting { option: "test_every", value: test_every.to_string(), reason });
    }
    Ok(move |place: usize| test_every > 0 && place.is_multiple_of(test_every))
}
