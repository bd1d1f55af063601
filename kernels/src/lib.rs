//! The GPU kernels of MVFusion-GS, and what they share with their CPU twins: constants, record layouts, basis
//! coefficients.
//!
//! This crate contains no tensors, autodiff or scenes. A constant that both sides use is defined once, here.
//! `mvfusion-render` launches the kernels and contains their CPU twins. Applications use that crate; this one serves
//! its implementation.
//!
//! ```
//! use mvfusion_kernels::splat::{PROJECTED_LEN, channel_count, plane_count};
//!
//! // Colour, three mask features and depth are blended; alpha is one more plane.
//! let channels = channel_count(3);
//! assert_eq!((channels, plane_count(channels)), (7, 8));
//! // A projected Gaussian is one row of named fields.
//! assert_eq!(PROJECTED_LEN, mvfusion_kernels::splat::projected_row::BLUE + 1);
//! ```
//!
//! | module | contents |
//! |---|---|
//! | [`splat`] | constants of the rasteriser, and its records with named fields |
//! | [`sh`] | the basis of spherical harmonics |
//! | [`grid`] | the layout of a HexPlane |
//! | [`objective`] | constants of the losses |
//! | [`adam`] | the bound of Adam's gradients |
//! | `cube` | the kernels, one stage per file; behind the feature `cube` |

pub mod adam;
#[cfg(feature = "cube")]
#[allow(missing_docs, reason = "what the macros of CubeCL make has none")]
#[allow(
    clippy::manual_div_ceil,
    clippy::manual_is_multiple_of,
    clippy::needless_range_loop,
    reason = "kernels have neither these methods nor iterators"
)]
pub mod cube;
pub mod grid;
pub mod objective;
pub mod sh;
pub mod splat;
