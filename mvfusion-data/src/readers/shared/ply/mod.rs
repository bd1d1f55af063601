//! PLY files: point clouds, and Gaussians.

mod element;
mod gaussians;
mod points;

pub use gaussians::read_gaussians;
pub use points::read_points;
pub(crate) use points::{GREY, read_first, warn_of_none};
