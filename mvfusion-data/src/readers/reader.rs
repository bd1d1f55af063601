//! A reader: an entry in the table of readers.

use std::path::Path;

use super::format::Format;
use super::options::ReadOptions;
use super::shared::ignored_masks::ignored_masks;
use crate::error::DataError;
use crate::scene::Scene;

/// A reader: functions that recognise and read a format, and hints about its scenes.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Reader {
    pub(crate) format: Format,
    /// The reason why a folder is not in this format; `None` if it seems to be.
    pub(crate) recognise: fn(&Path) -> Option<String>,
    /// Reads the scene in a folder of this format.
    pub(crate) read: fn(&Path, &ReadOptions) -> Result<Scene, DataError>,
    pub(crate) hints: Hints,
}

/// Hints about the scenes of a format, for inspections.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Hints {
    /// The convention of the poses: one or more sentences.
    pub(crate) poses: &'static str,
    /// The usual size of a scene whose images have this width on disk; `None` if the format has none.
    pub(crate) usual_size: fn(&Scene, f64) -> Option<UsualSize>,
    /// Whether the scene in a folder has no point cloud, so that the reader generates random points.
    pub(crate) has_random_points: fn(&Path) -> bool,
    /// How the shape of the scene's images differs from that in the folder's camera file; `None` if it does not.
    pub(crate) odd_shape: fn(&Path, &Scene) -> Option<String>,
    /// The masks in the scene's folder that no view uses, and what is expected of them; `None` if there are none.
    pub(crate) ignored_masks: fn(&Path, &Scene) -> Option<String>,
}

/// The size at which a scene is usually trained.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct UsualSize {
    /// Factor by which its images are downscaled.
    pub(crate) factor: f64,
    /// The source of this size, as a clause.
    pub(crate) source: &'static str,
}

impl Hints {
    /// The hints of a format with only a convention of its poses.
    pub(crate) const fn of_poses(poses: &'static str) -> Self {
        Self {
            poses,
            usual_size: |_, _| None,
            has_random_points: |_| false,
            odd_shape: |_, _| None,
            ignored_masks: |folder, scene| ignored_masks(folder, scene, "this format reads no masks"),
        }
    }
}
