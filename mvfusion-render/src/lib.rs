//! Differentiable Gaussian splatting, HexPlane look-up and their small companions, as Burn backend extensions.
//!
//! Each op has the same three layers: a CPU twin that knows only slices and is generic over `f32` and `f64`
//! (`*/cpu.rs`), a backend extension that hands tensors to it (`*/op.rs`, the only places that import Burn's
//! internals), and a function on Burn tensors that checks shapes at the border. GPU launches join as a fourth.

mod host;
mod real;

pub mod grid;
pub mod optim;
pub mod splat;
pub mod window;

pub use real::Real;
