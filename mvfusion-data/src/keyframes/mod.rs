//! Moving Gaussians at keyframes, as integer multiples of steps, for files that must be small.
//!
//! [`KeyframesBuilder`] takes the Gaussians of one branch at ascending times and quantises them ([`Quantity`] has the
//! steps). [`Keyframes::reduced`] leaves out keyframes, colour coefficients, Gaussians and precision. [`encode`] turns
//! branches into compressed bytes and a [`BranchLayout`] each, which describes them; [`decode`] is its inverse.
//!
//! Between two keyframes, everything is interpolated linearly ([`Keyframes::at`]): centres, logarithms of scales,
//! opacities, mask probabilities, constant colours, and quaternions, which a renderer normalises. The higher colour
//! coefficients are one set for all times: their mean, weighted by opacity.

mod builder;
mod bytes;
mod interpolate;
mod layout;
mod order;
mod quantity;
mod reduce;

pub use builder::KeyframesBuilder;
pub use bytes::{decode, encode};
pub use layout::{BranchLayout, DecodeError, TrackLayout};
pub use quantity::{Quantity, UniformQuantizer};
pub use reduce::Reduction;

/// The quantised Gaussians of one branch at its keyframes. A static branch has one keyframe.
#[derive(Clone, Debug, PartialEq)]
pub struct Keyframes {
    count: usize,
    sh_degree: usize,
    times: Vec<f64>,
    tracks: Vec<Track>,
}

/// The integers of a quantity.
#[derive(Clone, Debug, PartialEq)]
struct Track {
    quantity: Quantity,
    quantizer: UniformQuantizer,
    /// A list for each column of the quantity: keyframe by keyframe, then Gaussian by Gaussian. A quantity that does
    /// not move has one keyframe.
    columns: Vec<Vec<i32>>,
}

impl Keyframes {
    /// Number of Gaussians.
    pub fn count(&self) -> usize {
        self.count
    }

    /// Degree of the spherical harmonics.
    pub fn sh_degree(&self) -> usize {
        self.sh_degree
    }

    /// The times of the keyframes, ascending.
    pub fn times(&self) -> &[f64] {
        &self.times
    }

    /// The Gaussians that are not transparent at every keyframe, in ascending order.
    pub fn visible_rows(&self) -> Vec<usize> {
        let opacities = self.column(Quantity::Opacity);
        let least = self.transparent();
        let is_visible = |row: &usize| opacities.iter().skip(*row).step_by(self.count.max(1)).any(|&o| o > least);
        (0..self.count).filter(is_visible).collect()
    }

    /// The integer of the opacity 0.
    fn transparent(&self) -> i32 {
        self.track(Quantity::Opacity).map_or(0, |track| track.quantizer.quantise(0.0))
    }

    /// The track of a quantity, if the branch has it.
    fn track(&self, quantity: Quantity) -> Option<&Track> {
        self.tracks.iter().find(|track| track.quantity == quantity)
    }

    /// The first column of a quantity; empty without it.
    fn column(&self, quantity: Quantity) -> &[i32] {
        self.track(quantity).and_then(|track| track.columns.first()).map_or(&[], Vec::as_slice)
    }
}

#[cfg(test)]
mod tests;
