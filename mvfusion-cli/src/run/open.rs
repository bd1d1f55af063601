//! A run that was trained, opened again.

use std::path::{Path, PathBuf};

use anyhow::{Context, bail};
use mvfusion_data::Scene;
use mvfusion_model::Config;
use mvfusion_model::model::{Model, RenderContext};
use mvfusion_model::train::{TrainedModel, final_level};

use super::files::{CHECKPOINTS, CONFIG, FINAL};
use crate::device::{self, OpenDevice};
use crate::progress::Verbosity;
use crate::{config, scene};

/// Which run is opened, and what has moved since it was trained.
#[derive(Clone, Copy, Debug)]
pub struct RunRequest<'a> {
    /// Folder of the run.
    pub run: &'a Path,
    /// Folder of the scene, if it is not where it was.
    pub data: Option<&'a Path>,
    /// The masks of `eval.dynamic_masks`.
    pub masks: MasksRequest<'a>,
    /// Name of the device.
    pub device: &'a str,
}

/// What becomes of the masks that say where something moves.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum MasksRequest<'a> {
    /// Those that the run was configured with, if any.
    AsConfigured,
    /// Those of this folder.
    Folder(&'a Path),
    /// None are read: nothing is scored.
    Unused,
}

/// A trained run with all that it was trained under.
#[derive(Debug)]
pub struct OpenRun {
    /// The configuration, scaled.
    pub config: Config,
    /// The device.
    pub device: OpenDevice,
    /// The scene.
    pub scene: Scene,
    /// The model after the last step.
    pub trained: TrainedModel,
}

impl OpenRun {
    /// Opens a run; device and scene are noted.
    ///
    /// # Errors
    /// If the run is not complete, its data are gone, or there is no such device.
    pub fn open(request: &RunRequest<'_>, verbosity: Verbosity) -> anyhow::Result<Self> {
        let checkpoint = find_checkpoint(request.run)?;
        let config = configuration(request)?;
        let device = device::open(request.device)?;
        let scene = scene::open(&config).context(match request.masks {
            MasksRequest::Unused => "cannot open the scene of the run; if it has moved, give its folder with --data",
            _ => {
                "cannot open the scene of the run; if it has moved, give its folder with --data and that of the masks \
                 with --masks"
            }
        })?;
        verbosity.note(&format!("device: {}", device.reason));
        verbosity.note(&format!("scene:  {}", scene::describe(&scene)));
        let config = config.scaled();
        let trained = TrainedModel::load(&checkpoint, &config, &device.device)?;
        Ok(Self { config, device, scene, trained })
    }

    /// The model, without temporal attention if `no_mfta`, with a note where that changes nothing.
    pub fn model(&self, no_mfta: bool, verbosity: Verbosity) -> Model {
        let model = &self.trained.model;
        if !no_mfta {
            return model.clone();
        }
        model.without_mfta(final_level(&self.config)).unwrap_or_else(|| {
            verbosity.note("note:   the model was trained without MFTA, so --no-mfta changes nothing");
            model.clone()
        })
    }

    /// What the model needs to know to be rendered.
    pub fn render_context(&self) -> RenderContext {
        RenderContext::new(&self.config, &self.scene)
    }
}

fn find_checkpoint(run: &Path) -> anyhow::Result<PathBuf> {
    let checkpoint = run.join(CHECKPOINTS).join(FINAL);
    if !run.is_dir() {
        bail!("there is no folder {}. Give the folder of a run, such as runs/quickstart-0.", run.display());
    }
    if !checkpoint.is_file() {
        bail!("{} holds no {CHECKPOINTS}/{FINAL}: it is no run, or its training did not end.", run.display());
    }
    Ok(checkpoint)
}

/// The run's configuration, with what has moved since.
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
