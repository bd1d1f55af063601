//! LPIPS v0.1 (Zhang et al. 2018): how unlike two pictures look, by the features of a network that recognises things.
//!
//! Lower is more alike; 0 for equal pictures. Weights are files that this program does not bring along, see
//! [`Lpips::load`].

mod distance;
mod layout;
mod network;
mod source;
mod weights;

pub use distance::Distance;
pub use layout::{Backbone, InputRange, LpipsVariant};
pub use network::Lpips;
