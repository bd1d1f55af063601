//! A run's state as one file: tensors as safetensors, everything else as JSON in its header (docs/formats.md).

mod contents;
mod file;
mod fit;
mod header;
mod open;
mod read;
#[cfg(all(test, feature = "flex"))]
mod tests;

use std::path::Path;

use burn::tensor::Device;

pub use self::contents::{parameter_bytes, parameter_hash};
pub use self::open::Checkpoint;

use self::contents::Contents;
use self::header::Header;
use super::{Stage, TrainState};
use crate::ModelError;
use crate::config::Config;
use crate::model::{DeformationLevel, Model};

impl TrainState {
    /// Writes the state with a checksum to a temporary file and renames it, so that a crash does not damage the old
    /// file.
    ///
    /// # Errors
    /// If the device fails to return values, one of them is not finite, or the file cannot be written.
    pub fn save(&self, path: &Path) -> Result<(), ModelError> {
        let Contents { tensors, adam_steps } = Contents::of(self)?;
        let grid = &self.model.network.grid;
        let header = Header {
            completed: self.completed,
            sh_degrees: self.model.branches().map(|(_, gaussians)| gaussians.sh_degree).collect(),
            grid_max: grid.bounds().max,
            grid_min: grid.bounds().min,
            grid_layout: Some(grid.layout().into()),
            knot_times: self.model.motion.as_ref().map(|cache| cache.knot_times.clone()),
            adam_steps,
            normalisers: self.normalisers.clone(),
            streams: self.streams.clone(),
            sampler: self.sampler.clone(),
            counts: self.counts(),
            refreshes: self.refreshes,
            bad_steps: self.bad_steps,
        };
        file::write(path, &tensors, &header)
    }

    /// Reads a state that was written with the same `config`, to `device` (with autodiff).
    ///
    /// # Errors
    /// As [`Checkpoint::open`] and [`Checkpoint::state`].
    pub fn load(path: &Path, config: &Config, device: &Device) -> Result<Self, ModelError> {
        Checkpoint::open(path)?.state(config, device)
    }

    /// Reads only what was learned and measured, to `device` (with autodiff), for [`TrainState::with_weights`].
    ///
    /// # Errors
    /// As [`Checkpoint::open`] and [`Checkpoint::weights`].
    pub fn load_weights(path: &Path, config: &Config, device: &Device) -> Result<Self, ModelError> {
        Checkpoint::open(path)?.weights(config, device)
    }
}

/// A trained model without autodiff, for evaluation.
#[derive(Clone, Debug)]
pub struct TrainedModel {
    /// The model.
    pub model: Model,
    /// Number of training steps.
    pub steps: usize,
}

impl TrainedModel {
    /// Reads only the model of a checkpoint. The rest of the state is checked as well.
    ///
    /// # Errors
    /// Same as [`TrainState::load`].
    pub fn load(path: &Path, config: &Config, device: &Device) -> Result<Self, ModelError> {
        let checkpoint = Checkpoint::open(path)?;
        let model = checkpoint.model(config, device)?;
        checkpoint.check_training(&model, config)?;
        Ok(Self { model: model.plain(), steps: checkpoint.steps() })
    }

    /// The deformation level of the last training step, with the run's scaled configuration. Above it, the network may
    /// be untrained.
    pub fn level(&self, config: &Config) -> DeformationLevel {
        Stage::of_last(self.steps, &config.train.stages).level(config.model.deformation)
    }
}

impl From<&TrainState> for TrainedModel {
    fn from(state: &TrainState) -> Self {
        Self { model: state.model.plain(), steps: state.completed }
    }
}
