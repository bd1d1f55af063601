//! Stages, batches and logging.

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use super::keys::{keys, leaves};
use super::{Interval, Steps};

/// The schedule of training (METHOD §4.1, §10.3 A1, §11.2).
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(default, deny_unknown_fields)]
pub struct TrainConfig {
    /// Multiplies every iteration count of the run: stages, horizons, intervals. Ours, like the keys `scale_*`.
    pub scale: f64,
    /// In a run that `scale` shortens, all learning rates except those of opacities and motion modules are multiplied
    /// by `scale` to the power of minus this. 0 does not change the rates. Ours.
    pub scale_rates: f64,
    /// The same exponent for the rates of the mask logits. With 1, they change by as much in a shortened run as in a
    /// full one. Ours.
    pub scale_mask: f64,
    /// In a run that `scale` shortens, no learning rate ends below this fraction of its start, because there is no time
    /// for a long tail. 0 does not change the ends. Ours.
    pub scale_tail: f64,
    /// Maximum number of octaves of the encoding of motion descriptors in a run that `scale` shortens. While motion is
    /// being learned, the descriptors change by more than the period of finer octaves. Ours.
    pub scale_octaves: usize,
    /// A run that `scale` shortens places only `scale` times as many dynamic Gaussians uniformly. The others start on
    /// known points with their colours, because there is no time to move them to surfaces. Ours.
    pub scale_cloud: bool,
    /// A run that `scale` shortens follows the times of its scene, as with `model.grid.time_rows = "by_times"` and
    /// `motion.by_times`, because cells that few moments read learn little in few steps. A run writes the results into
    /// its configuration, with this switch off. Ours.
    pub scale_times: bool,
    /// Lengths of the three stages.
    pub stages: StageConfig,
    /// Views per step (DeGauss: 2 for video, 4 for photos).
    pub batch_size: usize,
    /// Additional visits of a view per round for each side on which its moment has no neighbour (DeGauss: one visit
    /// each). These are the first and last moment and, in proportion, moments at which objects appear or disappear. For
    /// fixed cameras. Ours: a Gaussian also learns a moment from the adjacent frames.
    pub lonely_visits: f64,
    /// Gradient accumulation of the static branch after the first stage, in steps; the loss is divided by this number
    /// (DeGauss: 1 for video, 4 for photos; METHOD §4.3). The dynamic branch learns at every step.
    pub accumulation: usize,
    /// Steps between increments of the SH degree, dynamic branch (METHOD §4.6).
    pub dynamic_sh_interval: Interval,
    /// The same for the static branch.
    pub static_sh_interval: Interval,
    /// Steps between lines of `metrics.jsonl`; not scaled. Ours.
    pub log_interval: usize,
    /// Whether the run also writes event files for TensorBoard, with the same curves, the metrics and the strips. Ours.
    pub tensorboard: bool,
    /// Steps between checkpoints. 0 leaves them to `checkpoint_minutes`. Ours.
    pub checkpoint_interval: Interval,
    /// Minutes between checkpoints where `checkpoint_interval` is 0, after one for the first step. 0 writes one at the
    /// end only. Ours.
    pub checkpoint_minutes: f64,
    /// Number of checkpoints that are kept beside the final one; older ones are removed. At least 1. Ours.
    pub keep_checkpoints: usize,
    /// What a training does at a step whose loss is not finite. Ours.
    pub on_bad_step: BadStepRule,
}

/// What a training does at a step whose loss is not finite.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum BadStepRule {
    /// It ends with the first number that is not finite.
    Stop,
    /// The step changes no parameter. Gradients are checked as well, which takes a pass over them. Training ends after
    /// ten such steps in a row.
    Skip,
}

/// Lengths of the three stages in optimiser steps (paper, training strategy; METHOD §11.2).
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(default, deny_unknown_fields)]
pub struct StageConfig {
    /// Base geometry: both branches without deformation.
    pub geometry: Steps,
    /// Base deformation: HexPlane and heads.
    pub deformation: Steps,
    /// Motion-aware refinement: with MVG and MFTA.
    pub refinement: Steps,
    /// Whether that stage has its own counter, moments and schedules, instead of continuing those of the previous stage
    /// (A1).
    pub refinement_restarts: bool,
}

impl Default for StageConfig {
    fn default() -> Self {
        Self { geometry: Steps(2000), deformation: Steps(3000), refinement: Steps(20_000), refinement_restarts: false }
    }
}

impl Default for TrainConfig {
    fn default() -> Self {
        Self {
            scale: 1.0,
            scale_rates: 0.5,
            scale_mask: 1.0,
            scale_tail: 0.1,
            scale_octaves: 1,
            scale_cloud: true,
            scale_times: true,
            stages: StageConfig::default(),
            batch_size: 2,
            lonely_visits: 0.0,
            accumulation: 1,
            dynamic_sh_interval: Interval(200),
            static_sh_interval: Interval(200),
            log_interval: 10,
            tensorboard: false,
            checkpoint_interval: Interval(0),
            checkpoint_minutes: 10.0,
            keep_checkpoints: 2,
            on_bad_step: BadStepRule::Stop,
        }
    }
}

keys!(TrainConfig {
    scale: ABOVE_0.from(1e-4).to(1e3).saying("give a number above 0; 1 is the full length"),
    scale_rates: SHARE.saying("give a power: with 0 rates stay, with 1 they grow as the run shrinks"),
    scale_mask: SHARE.saying("give a power: with 0 rates stay, with 1 they grow as the run shrinks"),
    scale_tail: SHARE,
    scale_octaves: FROM_0.to(16.0),
    scale_cloud: ANY,
    scale_times: ANY,
    stages: ANY,
    batch_size: FROM_1.to(4096.0).saying("a step needs at least one view"),
    lonely_visits: FROM_0.to(1e3).saying("give a number that is not below 0; 0 shows every view as often"),
    accumulation: FROM_1.saying("give the steps to learn from at once; 1 or more"),
    dynamic_sh_interval: INTERVAL,
    static_sh_interval: INTERVAL,
    log_interval: INTERVAL.saying("give the steps between log lines, at least 1"),
    tensorboard: ANY,
    checkpoint_interval: STEPS,
    checkpoint_minutes: FROM_0.saying("give the minutes between checkpoints; 0 writes one at the end only"),
    keep_checkpoints: FROM_1.saying("give the number of checkpoints to keep, at least 1"),
    on_bad_step: ANY,
});

keys!(StageConfig { geometry: STEPS, deformation: STEPS, refinement: STEPS, refinement_restarts: ANY });

leaves!(BadStepRule);
