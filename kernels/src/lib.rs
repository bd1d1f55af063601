//! The GPU kernels of MVFusion-GS, and what they share with their CPU twins: constants, record layouts, basis
//! coefficients.
//!
//! Nothing here knows tensors, autodiff or scenes; a number that both sides must agree on is written once, here.

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
pub mod sh;
pub mod splat;
