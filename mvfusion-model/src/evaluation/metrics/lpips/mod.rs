//! LPIPS v0.1 (Zhang et al. 2018): the perceptual distance of two images, by the features of a classification network.
//!
//! Lower is more similar; equal images have 0. The weights are not part of this program, see [`Lpips::load`].

pub mod conversion;
mod distance;
mod layout;
mod network;
mod source;
mod weights;

pub use distance::Distance;
pub use layout::{Backbone, InputRange, LpipsVariant};
pub use network::Lpips;
