//! Differentiable Gaussian splatting, HexPlane look-up, perceptrons, attention and their small companions, as Burn
//! backend extensions.
//!
//! Each op has the same three layers: a CPU twin that knows only slices and is generic over `f32` and `f64`
//! (`*/cpu.rs`), a backend extension that hands tensors to it (`*/op.rs`), and a function on Burn
//! tensors that checks shapes at the border. With the feature `cube`, `cube/` implements the same extensions by
//! launches of GPU kernels. Only `op.rs`, `autodiff.rs`, `host` and `cube/` import Burn's internals.
#![cfg_attr(
    feature = "ndarray",
    allow(deprecated, reason = "Burn recommends Flex; the charter names ndarray, and each op's macro mentions it")
)]

#[cfg(feature = "cube")]
mod cube;
mod host;
mod real;
mod simd;
#[cfg(test)]
mod test_support;

pub mod attention;
pub mod device;
pub mod grid;
pub mod mlp;
pub mod optim;
pub mod profile;
pub mod splat;
pub mod window;

pub use real::Real;
