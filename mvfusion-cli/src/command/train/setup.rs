//! What a training works with, made before anything is written.

use mvfusion_data::Scene;
use mvfusion_model::Config;
use mvfusion_model::evaluation::{Evaluator, Protocol};
use mvfusion_model::train::Trainer;

use super::super::score;
use crate::args::TrainArgs;
use crate::device::OpenDevice;
use crate::lpips::{self, LpipsFolder};
use crate::memory::{self, MemoryRule};
use crate::progress::Verbosity;
use crate::scene;

/// What a training works with.
pub(super) struct Setup {
    /// The configuration as it is written: `train.scale` is not applied.
    pub(super) config: Config,
    pub(super) device: OpenDevice,
    pub(super) scene: Scene,
    pub(super) trainer: Trainer,
    /// The weights with which `evaluator` scores, if there are any.
    pub(super) lpips_folder: Option<LpipsFolder>,
    pub(super) evaluator: Evaluator,
}

impl Setup {
    /// Gives the trainer its image cache, and finds what scores.
    ///
    /// # Errors
    /// If the images cannot be cached, or the weights of LPIPS cannot be used.
    pub(super) fn new(
        args: &TrainArgs,
        config: Config,
        device: OpenDevice,
        scene: Scene,
        trainer: Trainer,
    ) -> anyhow::Result<Self> {
        let trainer = trainer.with_image_cache(args.image_cache.as_u64())?;
        let lpips_folder = lpips::find(config.eval.lpips_weights.as_deref())?;
        let evaluator = score::evaluator(Protocol::Mvfusion, lpips_folder.as_ref(), &device.device)?;
        Ok(Self { config, device, scene, trainer, lpips_folder, evaluator })
    }

    /// Tells which device, scene and weights were chosen.
    pub(super) fn tell(&self, verbosity: Verbosity) {
        verbosity.note(&format!("device: {}", self.device.reason));
        verbosity.note(&format!("scene:  {}", scene::describe(&self.scene)));
        if let Some(folder) = &self.lpips_folder {
            verbosity.note(&format!("lpips:  {folder}"));
            // The option refuses such a folder; a key and the variable may name it.
            if self.evaluator.weights().next().is_none() {
                verbosity.note("note:   the folder of the LPIPS weights has none, so LPIPS stays unknown");
            }
        }
    }
}

/// Refuses what does not fit into the memory, unless `--force-memory` is given.
///
/// # Errors
/// With what would fit.
pub(super) fn check_memory(
    args: &TrainArgs,
    config: &Config,
    scene: &Scene,
    device: &OpenDevice,
) -> anyhow::Result<()> {
    let rule = MemoryRule::of_flag(args.force_memory);
    memory::check_training(&config.scaled(), scene, args.image_cache.as_u64(), device, rule)
}
