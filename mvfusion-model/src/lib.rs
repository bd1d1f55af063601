//! The MVFusion-GS model and its trainer, on every Burn device.
//!
//! A learned mask blends a static and a dynamic branch of 3D Gaussians. A HexPlane network deforms the dynamic
//! Gaussians; MVG and MFTA make it aware of motion. The crate builds on the ops of `mvfusion-render`. `mvfusion-cli`
//! adds presets, run folders and commands.
//!
//! # First training run
//! ```
//! use mvfusion_data::{BuiltinOptions, builtin::builtin};
//! use mvfusion_model::config::{Config, TrainConfig};
//! use mvfusion_model::{ModelError, device, train::Trainer};
//!
//! # fn main() -> Result<(), ModelError> {
//! let tiny = BuiltinOptions { width: 32, height: 24, frames: 3, ..BuiltinOptions::default() };
//! let scene = builtin(&tiny);
//! // The defaults are the paper's for Neu3D; this run has a two-thousandth of their steps.
//! let train = TrainConfig { scale: 0.0005, ..TrainConfig::default() };
//! let config = Config { train, ..Config::default() }.scaled();
//!
//! let mut trainer = Trainer::new(config, &scene, &device::flex())?;
//! while let Some(losses) = trainer.step()? {
//!     assert!(losses.total.into_scalar::<f32>().is_finite());
//! }
//! let model = trainer.state().model.plain();
//! assert!(model.dynamic.count() > 0 && model.static_.is_some());
//! # Ok(())
//! # }
//! ```
//! Larger programs are in the folder `examples`: the plain loop with an evaluation, a loss term of your own, a schedule
//! of your own, a PLY file of another program, a scene from arrays, a finished run.
//!
//! # Which module do I use?
//! | you want to | look at |
//! |---|---|
//! | train | [`train::Trainer`]: [`step`](train::Trainer::step), or its public parts for your own loss or schedule |
//! | configure a run | [`Config`] and its tables in [`config`] |
//! | use single modules | [`model::gaussians`], [`model::network`], [`model::motion`], [`model::composition`] |
//! | initialise Gaussians | [`initial`] |
//! | predict the memory or the time of a run | [`memory::MemoryNeed`], [`duration::RunTime`] |
//! | compute metrics | [`evaluation::evaluate`] for views, [`evaluation::psnr`] and others for images |
//! | open the scene of a configuration | [`Config::open_scene`] |
//! | load a trained model | [`train::TrainedModel::load`] |
//! | start from the weights of another run | [`train::TrainState::load_weights`], [`train::TrainState::with_weights`] |
//!
//! # Which crate do I use?
//! `mvfusion-data` reads and writes scenes, without tensors. `mvfusion-render` splats Gaussians and interpolates
//! HexPlanes, independent of time. This crate trains. `mvfusion-cli` is the program.

pub mod config;
pub mod duration;
mod error;
pub mod evaluation;
pub mod files;
pub mod initial;
pub mod memory;
pub mod model;
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
