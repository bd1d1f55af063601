//! Differentiable Gaussian splatting, HexPlane interpolation, MLPs and attention as Burn backend extensions.
//!
//! The crate is independent of time and files. `mvfusion-model` implements the method on top of it, and
//! `mvfusion-kernels` contains the GPU kernels.
//!
//! # First image
//! ```
//! use burn::tensor::Tensor;
//! use glam::{DMat3, DVec3};
//! use mvfusion_data::Camera;
//! use mvfusion_render::splat::{SplatError, SplatInputs, SplatSettings, splat};
//!
//! # fn main() -> Result<(), SplatError> {
//! # let device = mvfusion_render::device::flex();
//! // One white Gaussian, two units in front of a camera that looks along +z.
//! let camera = Camera::centred(32, 24, 30.0, DMat3::IDENTITY, DVec3::ZERO);
//! let inputs = SplatInputs {
//!     means: Tensor::from_floats([[0.0, 0.0, 2.0]], &device),
//!     quaternions: Tensor::from_floats([[1.0, 0.0, 0.0, 0.0]], &device),
//!     log_scales: Tensor::from_floats([[-1.5, -1.5, -1.5]], &device),
//!     opacity_logits: Tensor::from_floats([4.0], &device),
//!     sh: Tensor::from_floats([[[1.7, 1.7, 1.7]]], &device),
//!     features: None,
//!     background: Tensor::zeros([3], &device),
//! };
//! let picture = splat(inputs, None, &camera, &SplatSettings::default())?;
//! // Colour [3, H, W]; alpha and depth come with it, and the gradients of all inputs by Burn's autodiff.
//! let colour = picture.main().colour;
//! assert_eq!(colour.dims(), [3, 24, 32]);
//! assert!(colour.max().into_scalar::<f32>() > 0.8);
//! # Ok(())
//! # }
//! ```
//!
//! # Which op do I use?
//! | op | purpose |
//! |---|---|
//! | [`splat`] | rasterises 3D Gaussians to colour, features, alpha and depth, by the rules of 3DGS or gsplat |
//! | [`grid`] | interpolates the planes of a HexPlane, and computes the penalties on them |
//! | [`mlp`] | evaluates several MLPs on the same rows |
//! | [`attention`] | multi-head attention of a few queries to a few keys, for every row |
//! | [`window`] | Gaussian blur and SSIM |
//! | [`objective`] | blends both branches and computes the losses over pixels with their gradients |
//! | [`activation`] | the sigmoid, and the foreground's share of a mask |
//! | [`scales`] | the cost of large and of elongated Gaussians |
//! | [`picture`] | unpacks images of bytes |
//! | [`offsets`] | adds the offsets that a network gives to the attributes of Gaussians |
//! | [`optim`] | a step of Adam, for many parameters at once |
//! | [`device`] | the devices of this build |
//!
//! # Structure of an op
//! Each op has three layers. The CPU twin works on slices and is generic over `f32` and `f64` (`*/cpu.rs`). A backend
//! extension passes tensors to it (`*/op.rs`). A function on Burn tensors checks the shapes. With the feature `cube`,
//! `cube/` implements the same extensions by launching GPU kernels. Burn's internals are imported by `op.rs`,
//! `autodiff.rs`, `host`, `list`, `device` and `cube/`, and where `splat` hands tensors over to its op.
#![cfg_attr(
    feature = "ndarray",
    allow(deprecated, reason = "Burn recommends Flex; the charter names ndarray, and each op's macro mentions it")
)]

#[cfg(feature = "cube")]
mod cube;
mod host;
mod list;
mod real;
mod simd;
#[cfg(test)]
mod test_support;

pub mod activation;
pub mod attention;
pub mod device;
pub mod grid;
pub mod mlp;
pub mod objective;
pub mod offsets;
pub mod optim;
pub mod picture;
pub mod profile;
pub mod scales;
pub mod splat;
pub mod window;

pub(crate) use real::Real;
