//! What can go wrong while a model is trained, evaluated, saved or loaded.

use std::path::PathBuf;

use mvfusion_data::DataError;
use mvfusion_render::grid::GridError;
use mvfusion_render::splat::SplatError;
use thiserror::Error;

/// Why a run cannot go on. Each message says what, where and what to do.
#[derive(Debug, Error)]
pub enum ModelError {
    /// The scene cannot be read.
    #[error(transparent)]
    Data(#[from] DataError),
    /// A splat was asked for with tensors that do not fit together.
    #[error(transparent)]
    Splat(#[from] SplatError),
    /// A grid was asked for with tensors that do not fit together.
    #[error(transparent)]
    Grid(#[from] GridError),
    /// The device failed to hand numbers back.
    #[error("the device failed: {0}. Try `--device cpu` to see whether the device or its driver is at fault.")]
    Device(String),
    /// A configuration that cannot be trained.
    #[error("`{key}` is {value}: {reason}.")]
    Config {
        /// The key, dotted.
        key: String,
        /// Its value.
        value: String,
        /// What is wrong with it and what would be right.
        reason: String,
    },
    /// A layer that the model cannot be shown in.
    #[error("there is no layer `{layer}` to render: {reason}. Ask for other layers.")]
    Layer {
        /// Its name.
        layer: &'static str,
        /// What the model lacks.
        reason: &'static str,
    },
    /// A number that is not finite.
    #[error(
        "{what} is not finite at step {step} of stage {stage}. Lower the learning rates, or run again with the last \
         checkpoint and look at the pictures."
    )]
    NotFinite {
        /// The first tensor that was bad.
        what: String,
        /// Step within the stage.
        step: usize,
        /// Name of the stage.
        stage: &'static str,
    },
    /// A file of a run that cannot be read or written.
    #[error("cannot {action} {path}: {reason}.")]
    File {
        /// `read` or `write`.
        action: &'static str,
        /// The file.
        path: PathBuf,
        /// What the system or the decoder said.
        reason: String,
    },
    /// A checkpoint that does not hold what it should.
    #[error(
        "the checkpoint {path} does not fit: {reason}. It was written by another version, or for another configuration."
    )]
    Checkpoint {
        /// The file.
        path: PathBuf,
        /// What is missing or of the wrong shape.
        reason: String,
    },
    /// Weights of LPIPS that are not those of the network.
    #[error(
        "the LPIPS weights {path} do not fit: `{tensor}` should have the shape {expected:?} and is {found}. Use the \
         files that docs/evaluation.md describes."
    )]
    Weights {
        /// The file.
        path: PathBuf,
        /// Name of the tensor.
        tensor: String,
        /// Its shape in the network.
        expected: Vec<usize>,
        /// What is wrong with it: that it is missing, its shape, or its numbers.
        found: String,
    },
}
