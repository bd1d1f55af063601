//! A set of Gaussians: the raw attributes to optimise (METHOD §1.1), and what is rendered of them.

mod attribute;
mod cloud;
mod learned;
mod raw;
mod splat;
mod unmasked;

pub use attribute::Attribute;
pub(crate) use attribute::attribute_tensor;
pub use learned::Gaussians;
pub(crate) use learned::{LEAST_LOG_DURATION, MOST_LOG_DURATION};
pub use raw::{RawGaussians, SH_C0};
pub use splat::BackgroundLevels;
pub(crate) use splat::splat_frames;
