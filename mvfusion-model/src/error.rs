//! Errors of training, evaluation and checkpoints.

use std::path::PathBuf;

use mvfusion_data::DataError;
use mvfusion_render::grid::GridError;
use mvfusion_render::objective::ObjectiveError;
use mvfusion_render::splat::SplatError;
use thiserror::Error;

use crate::config::BadStepRule;

/// The reason why a run cannot continue. Each message states what failed, where, and what to do.
#[derive(Debug, Error)]
pub enum ModelError {
    /// The scene cannot be read.
    #[error(transparent)]
    Data(#[from] DataError),
    /// The scene cannot be trained.
    #[error("the scene {name} cannot be trained: {what}. {remedy}")]
    Scene {
        /// Its name.
        name: String,
        /// What is wrong.
        what: String,
        /// What to do.
        remedy: String,
    },
    /// Training views cannot be rendered together.
    #[error("the training views {views:?} cannot be rendered: {reason}.")]
    Views {
        /// Their indices.
        views: Vec<usize>,
        /// What is wrong with them.
        reason: String,
    },
    /// The splat op rejected its arguments.
    #[error(transparent)]
    Splat(#[from] SplatError),
    /// A grid op rejected its arguments.
    #[error(transparent)]
    Grid(#[from] GridError),
    /// The objective rejected its arguments.
    #[error(transparent)]
    Objective(#[from] ObjectiveError),
    /// The device failed to return values.
    #[error(
        "the device failed: {0}. Try the CPU (`--device cpu`) to see whether the device or its driver is at fault."
    )]
    Device(String),
    /// The configuration is invalid.
    #[error("`{key}` is {value}: {reason}.")]
    Config {
        /// The dotted key.
        key: String,
        /// Its value.
        value: String,
        /// The problem and its remedy.
        reason: String,
    },
    /// The model cannot render a layer.
    #[error("the layer `{layer}` cannot be rendered: {reason}. Select other layers.")]
    Layer {
        /// Name of the layer.
        layer: &'static str,
        /// What the model does not have.
        reason: &'static str,
    },
    /// A value is not finite.
    #[error(
        "{what} is not finite at step {run_step} (step {step} of stage {stage}), which showed {views}. {}",
        remedy(*.rule)
    )]
    NotFinite {
        /// The first tensor with such a value.
        what: String,
        /// Step within the run, from 1.
        run_step: usize,
        /// Step within the stage, from 1.
        step: usize,
        /// Name of the stage.
        stage: &'static str,
        /// The views of the step, with their times.
        views: String,
        /// `train.on_bad_step`, which the remedy depends on.
        rule: BadStepRule,
    },
    /// Too many steps in a row were skipped.
    #[error("{in_a_row} steps in a row were skipped. The last one: {last}")]
    BadSteps {
        /// Number of steps.
        in_a_row: usize,
        /// Why the last one was skipped.
        last: Box<Self>,
    },
    /// A file of a run cannot be read or written.
    #[error("cannot {action} {path}: {reason}.")]
    File {
        /// `read` or `write`.
        action: &'static str,
        /// The file.
        path: PathBuf,
        /// Message of the system or the decoder.
        reason: String,
    },
    /// A checkpoint is damaged, of another version, or not one of the configured model.
    #[error("the checkpoint {path} cannot be used: {reason}.")]
    Checkpoint {
        /// The file.
        path: PathBuf,
        /// The field or tensor with the expected and found values, or the checksums.
        reason: String,
    },
    /// A state of training does not belong to the scene.
    #[error(
        "the training cannot continue on this scene: {reason}. Give the scene that it began on, for example with --data."
    )]
    OtherScene {
        /// What the state refers to, and what the scene has.
        reason: String,
    },
    /// LPIPS weights do not match the network.
    #[error(
        "the LPIPS weights {path} are invalid: `{tensor}` should have the shape {expected:?} and is {found}. Use the \
         files described in docs/evaluation.md."
    )]
    Weights {
        /// The file.
        path: PathBuf,
        /// Name of the tensor.
        tensor: String,
        /// Its shape in the network.
        expected: Vec<usize>,
        /// The problem: a missing tensor, its shape, or its values.
        found: String,
    },
}

/// What to do about numbers that are not finite.
fn remedy(rule: BadStepRule) -> &'static str {
    match rule {
        BadStepRule::Stop => {
            "Lower the learning rates, or set `train.on_bad_step = \"skip\"` to go on without such steps."
        }
        BadStepRule::Skip => "Lower the learning rates.",
    }
}
