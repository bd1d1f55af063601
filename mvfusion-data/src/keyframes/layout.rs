//! The description of compressed Gaussians.

use serde::{Deserialize, Serialize};
use thiserror::Error;

use super::Quantity;

/// Highest degree of the spherical harmonics.
const HIGHEST_DEGREE: usize = 3;
/// Most bytes of a number.
const MOST_BYTES: usize = 4;

/// Description of a branch's bytes.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct BranchLayout {
    /// Number of Gaussians.
    pub count: usize,
    /// Degree of the spherical harmonics.
    pub sh_degree: usize,
    /// Times of the keyframes.
    pub times: Vec<f64>,
    /// The tracks, in the order of their bytes.
    pub tracks: Vec<TrackLayout>,
}

/// Description of a track's bytes.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct TrackLayout {
    /// What it is.
    pub name: Quantity,
    /// Numbers of a Gaussian at one time.
    pub columns: usize,
    /// Number of keyframes.
    pub keyframes: usize,
    /// The value of the integer 0.
    pub offset: f64,
    /// The value of a step.
    pub step: f64,
    /// Bytes of a number.
    pub bytes: usize,
    /// Whether the first keyframe has differences to the Gaussian before.
    pub chained: bool,
}

/// Why bytes cannot be decoded.
#[derive(Debug, Error)]
pub enum DecodeError {
    /// They are no zlib stream, or it is damaged.
    #[error("the Gaussians cannot be unpacked: {0}. Export them again.")]
    Stream(#[from] std::io::Error),
    /// A description contradicts itself, or has what this version does not know.
    #[error("the description of the Gaussians is wrong: {0}. Export them again.")]
    Layout(String),
    /// Their number is not that of the descriptions.
    #[error("the Gaussians do not have the {needed} bytes of their description. Export them again.")]
    Length {
        /// Number that the descriptions need.
        needed: usize,
    },
}

impl DecodeError {
    /// The error if a description needs more bytes than can be counted.
    pub(super) fn too_large() -> Self {
        Self::Layout("it needs more bytes than there can be".to_owned())
    }
}

impl BranchLayout {
    /// The bytes that the branch needs.
    ///
    /// # Errors
    /// If the description contradicts itself.
    pub(super) fn size(&self) -> Result<usize, DecodeError> {
        let wrong = |what: String| Err(DecodeError::Layout(what));
        if self.sh_degree > HIGHEST_DEGREE {
            return wrong(format!("it has spherical harmonics of degree {}", self.sh_degree));
        }
        let is_ascending = self.times.iter().is_sorted_by(|a, b| a < b);
        if self.times.is_empty() || !is_ascending || !self.times.iter().all(|time| time.is_finite()) {
            return wrong("its times are not ascending".to_owned());
        }
        let has_masks = self.tracks.iter().any(|track| track.name.is_mask());
        for quantity in Quantity::ALL {
            let wanted = usize::from(has_masks || !quantity.is_mask());
            let found = self.tracks.iter().filter(|track| track.name == quantity).count();
            if found != wanted {
                return wrong(format!("it has {found} tracks {quantity:?}"));
            }
        }
        let mut sizes = self.tracks.iter().map(|track| track.size(self));
        sizes.try_fold(0usize, |sum, size| sum.checked_add(size?).ok_or_else(DecodeError::too_large))
    }
}

impl TrackLayout {
    /// The bytes that the track of a branch needs.
    fn size(&self, branch: &BranchLayout) -> Result<usize, DecodeError> {
        let Self { name, columns, keyframes, offset, step, bytes, .. } = *self;
        let times = if name.moves() { branch.times.len() } else { 1 };
        let has_numbers = columns == name.columns(branch.sh_degree) && keyframes == times;
        let has_values = offset.is_finite() && step.is_finite() && step > 0.0;
        if !has_numbers || !has_values || !(1..=MOST_BYTES).contains(&bytes) {
            return Err(DecodeError::Layout(format!("the track {name:?} does not fit its branch")));
        }
        let size = columns.checked_mul(keyframes).and_then(|numbers| numbers.checked_mul(bytes));
        size.and_then(|size| size.checked_mul(branch.count)).ok_or_else(DecodeError::too_large)
    }
}
