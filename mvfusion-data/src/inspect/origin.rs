//! The origin of a scene, which an inspection needs besides the scene itself.

use crate::readers::Format;

/// The origin of a scene, for its inspection.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Origin {
    /// Its format; absent if it was not read from a folder.
    pub format: Option<Format>,
    /// The factor by which its images were downscaled. Default 1.
    pub downscale: f64,
    /// The origin of its points.
    pub points: PointsOrigin,
}

/// The origin of a scene's points.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum PointsOrigin {
    /// Measured. Their colours are those of the photos. The default.
    #[default]
    Measured,
    /// Random points from the reader. Their colours are meaningless.
    Random,
}

impl Default for Origin {
    fn default() -> Self {
        Self { format: None, downscale: 1.0, points: PointsOrigin::default() }
    }
}
