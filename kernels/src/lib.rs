//! What the CPU twin and the GPU kernels of MVFusion-GS share: constants, record layouts and basis coefficients.
//!
//! Nothing here knows tensors, autodiff or scenes; a number that both sides must agree on is written once, here.

pub mod sh;
pub mod splat;
