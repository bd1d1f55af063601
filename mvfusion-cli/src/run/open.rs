//! Opening a trained run.

use std::path::Path;

use anyhow::Context;
use mvfusion_data::Scene;
use mvfusion_model::model::{DeformationLevel, Model, RenderContext};
use mvfusion_model::train::TrainedModel;
use mvfusion_model::{Config, ModelError};
use tracing::warn;

use super::checkpoints::{Checkpoint, checkpoints, newest_checkpoint};
use super::evidence::changed_configuration;
use super::files::{CONFIG, RECORD, read_json};
use super::folder::waiting_note;
use super::record::RunRecord;
use crate::device::{self, OpenDevice};
use crate::progress::Verbosity;
use crate::{config, scene};

/// The run to open, and what has moved since its training.
#[derive(Clone, Copy, Debug)]
pub struct RunRequest<'a> {
    /// Run folder.
    pub run: &'a Path,
    /// Scene folder, if it has moved.
    pub data: Option<&'a Path>,
    /// The masks of `eval.dynamic_masks`.
    pub masks: MasksRequest<'a>,
    /// Name of the device.
    pub device: &'a str,
}

/// Which masks of moving objects are read.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum MasksRequest<'a> {
    /// Those of the run's configuration, if any.
    AsConfigured,
    /// Those of this folder.
    Folder(&'a Path),
    /// None, because nothing is scored.
    Unused,
}

/// A trained run with its configuration, scene and device.
#[derive(Debug)]
pub struct OpenRun {
    /// The configuration, scaled.
    pub config: Config,
    /// The device.
    pub device: OpenDevice,
    /// The scene.
    pub scene: Scene,
    /// The model of the newest checkpoint: after the last step of a finished run.
    pub trained: TrainedModel,
}

impl OpenRun {
    /// Opens a run. Prints notes about device and scene.
    ///
    /// # Errors
    /// If the run has no checkpoint, its data are missing, or the device does not exist.
    pub fn open(request: &RunRequest<'_>, verbosity: Verbosity) -> anyhow::Result<Self> {
        let checkpoint = newest_checkpoint(request.run)?;
        let config = configuration(request)?;
        if let Some(change) = changed_configuration(request.run) {
            warn!("{change}");
        }
        let device = device::open(request.device)?;
        let scene = config.open_scene().context(match request.masks {
            MasksRequest::Unused => "cannot open the scene of the run; if it has moved, give its folder with --data",
            _ => {
                "cannot open the scene of the run; if it has moved, give its folder with --data and the \
                 folder of the masks with --masks"
            }
        })?;
        verbosity.note(&format!("device: {}", device.reason));
        verbosity.note(&format!("scene:  {}", scene::describe(&scene)));
        if let Some(what) = changed_geometry(request.run, &scene) {
            warn!("{what} of the scene have changed since the training, so the model may not fit them");
        }
        let config = config.scaled();
        let trained = TrainedModel::load(&checkpoint.path, &config, &device.device)
            .map_err(|error| with_older(error, request.run, &checkpoint))?;
        if let Some(note) = waiting_note(request.run) {
            verbosity.note(&format!("note:   {note}"));
        }
        let (done, total) = (trained.steps, config.train.stages.total());
        if done < total {
            verbosity
                .note(&format!("note:   the run is unfinished; its newest checkpoint is of step {done} of {total}"));
        }
        Ok(Self { config, device, scene, trained })
    }

    /// The model, without temporal attention if `no_mfta`. Prints a note if that has no effect.
    pub fn model(&self, no_mfta: bool, verbosity: Verbosity) -> Model {
        let model = &self.trained.model;
        if !no_mfta {
            return model.clone();
        }
        model.without_mfta(self.level()).unwrap_or_else(|| {
            verbosity.note("note:   MFTA takes no part in this model, so --no-mfta has no effect");
            model.clone()
        })
    }

    /// The deformation level of the model.
    pub fn level(&self) -> DeformationLevel {
        self.trained.level(&self.config)
    }

    /// The context for rendering the model.
    pub fn render_context(&self) -> RenderContext {
        RenderContext::new(&self.config, &self.scene)
    }
}

/// In what the cameras, times and points of a scene differ from those of a run's training; `None` if they do not, or if
/// none were recorded.
pub fn changed_geometry(run: &Path, scene: &Scene) -> Option<&'static str> {
    let record: RunRecord = read_json(&run.join(RECORD)).ok()?;
    record.scene.difference(scene)
}

/// The error for a checkpoint that cannot be used, with the next older one, if there is one.
fn with_older(error: ModelError, run: &Path, newest: &Checkpoint) -> anyhow::Error {
    let is_damaged = matches!(error, ModelError::Checkpoint { .. });
    let error = anyhow::Error::new(error);
    let found = checkpoints(run).unwrap_or_default();
    match found.iter().find(|older| older.path != newest.path).filter(|_| is_damaged) {
        // A configuration that was changed fits no checkpoint.
        Some(older) if changed_configuration(run).is_none() => error.context(format!(
            "rename {} to use the next older checkpoint, {}",
            newest.path.display(),
            older.path.display()
        )),
        _ => error,
    }
}

/// The run's configuration, with the paths that have changed since.
fn configuration(request: &RunRequest<'_>) -> anyhow::Result<Config> {
    let mut config = config::read(&request.run.join(CONFIG))?;
    if let Some(data) = request.data {
        config.scene.data = Some(data.to_owned());
    }
    match request.masks {
        MasksRequest::AsConfigured => {}
        MasksRequest::Folder(folder) => config.eval.dynamic_masks = Some(folder.to_owned()),
        MasksRequest::Unused => config.eval.dynamic_masks = None,
    }
    Ok(config)
}
