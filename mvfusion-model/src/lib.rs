//! The MVFusion-GS model and its trainer, generic over Burn's devices.
//!
//! Data flows one way: [`model::Model`] moves the dynamic Gaussians ([`network`], [`motion`]), both branches are splatted
//! (crate `mvfusion-render`), [`composition`] blends them, [`loss`] compares with the photos, [`optim`] and [`densify`]
//! change the Gaussians. [`train`] turns that wheel, [`evaluation`] scores the result.

pub mod alive;
pub mod births;
pub mod composition;
pub mod config;
pub mod densify;
mod error;
pub mod evaluation;
pub mod exposure;
pub mod files;
pub mod gaussians;
pub mod initial;
pub mod loss;
pub mod memory;
pub mod model;
pub mod motion;
pub mod network;
pub mod optim;
mod parameter_path;
pub mod random;
mod tensors;
#[cfg(test)]
mod test_support;
pub mod timeline;
pub mod train;

pub use burn::tensor::Device;
pub use config::Config;
pub use error::ModelError;
pub use mvfusion_render::{device, profile};
