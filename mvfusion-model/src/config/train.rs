//! Stages, batches and logging.

use serde::{Deserialize, Serialize};

use super::keys::keys;
use super::{Interval, Steps};

/// The course of training (METHOD §4.1, §10.3 A1, §11.2).
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct TrainConfig {
    /// Multiplies every iteration count of the run: stages, horizons, intervals; see [`Config::scaled`](super::Config::scaled).
    pub scale: f64,
    /// A run that `scale` shortens learns faster: every learning rate but those of opacities and motion modules is
    /// multiplied by `scale` to the power of minus this. 0 leaves the rates alone.
    pub scale_rates: f64,
    /// The same exponent for the rates of the mask logits: 1 lets them go as far in a shortened run as in a full one.
    pub scale_mask: f64,
    /// In a run that `scale` shortens no learning rate ends below this share of its start: there is no time for a long tail.
    /// 0 leaves the ends alone.
    pub scale_tail: f64,
    /// In a run that `scale` shortens the encoding of motion descriptors has at most so many octaves: measured on a motion that
    /// is still being learned, the descriptors change by more than the period of the finer ones.
    pub scale_octaves: usize,
    /// A run that `scale` shortens strews only `scale` times as many dynamic Gaussians at random and puts the others on known
    /// points, with their colours: there is no time to carry them to where something is.
    pub scale_cloud: bool,
    /// A run that `scale` shortens goes by the times of its scene as if `model.grid.time_rows` were `"by_times"` and
    /// `motion.by_times` on: cells of which each is seen at few moments learn little in few steps. A run writes the
    /// numbers that it found into its configuration, with this switched off.
    pub scale_times: bool,
    /// Lengths of the three stages.
    pub stages: StageConfig,
    /// Views a step (DeGauss: 2 for video, 4 for photos).
    pub batch_size: usize,
    /// So many visits more has a view in each round (DeGauss: one visit each) for either side on which its moment has no
    /// neighbour to learn from: the first and the last moment, and in proportion those at which something comes or goes. Where
    /// cameras stand still. Ours: a Gaussian learns of a moment from the frames beside it as well.
    pub lonely_visits: f64,
    /// Steps after the first stage from whose gradients the static branch learns at once; the loss is divided by as many
    /// (DeGauss: 1 for video, 4 for photos; METHOD §4.3). The dynamic branch learns at every step.
    pub accumulation: usize,
    /// Steps between one more degree of spherical harmonics, dynamic branch (METHOD §4.6).
    pub dynamic_sh_interval: Interval,
    /// The same for the static branch.
    pub static_sh_interval: Interval,
    /// Steps between lines of `metrics.jsonl`; not scaled.
    pub log_interval: usize,
    /// Steps between checkpoints. 0 leaves them to `checkpoint_minutes`.
    pub checkpoint_interval: Interval,
    /// Minutes between checkpoints where `checkpoint_interval` is 0. 0 writes one at the end only.
    pub checkpoint_minutes: f64,
    /// Number of checkpoints that are kept beside the final one; older ones are removed. At least 1.
    pub keep_checkpoints: usize,
}

/// Lengths of the three stages in optimiser steps (paper, training strategy; METHOD §11.2).
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct StageConfig {
    /// Base geometry: both branches, no deformation.
    pub geometry: Steps,
    /// Base deformation: HexPlane and heads.
    pub deformation: Steps,
    /// Motion-aware refinement: MVG and MFTA join.
    pub refinement: Steps,
    /// Whether that stage has counter, moments and schedules of its own, instead of going on with those of the stage before
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
            checkpoint_interval: Interval(0),
            checkpoint_minutes: 10.0,
            keep_checkpoints: 2,
        }
    }
}

keys!(TrainConfig {
    scale: ABOVE_0.saying("give a number above 0; 1 is the full length"),
    scale_rates: SHARE.saying("give a power from 0 (rates stay) to 1 (rates grow as the run shrinks)"),
    scale_mask: SHARE.saying("give a power from 0 (rates stay) to 1 (rates grow as the run shrinks)"),
    scale_tail: SHARE,
    scale_octaves: ANY,
    scale_cloud: ANY,
    scale_times: ANY,
    stages: ANY,
    batch_size: FROM_1.saying("a step needs at least one view"),
    lonely_visits: FROM_0.saying("give a number that is not below 0; 0 shows every view as often"),
    accumulation: FROM_1.saying("give the steps to learn from at once; 1 or more"),
    dynamic_sh_interval: FROM_1,
    static_sh_interval: FROM_1,
    log_interval: FROM_1.saying("give the steps between log lines, at least 1"),
    checkpoint_interval: ANY,
    checkpoint_minutes: FROM_0.saying("give the minutes between checkpoints; 0 writes one at the end only"),
    keep_checkpoints: FROM_1.saying("give the number of checkpoints to keep, at least 1"),
});

keys!(StageConfig { geometry: ANY, deformation: ANY, refinement: ANY, refinement_restarts: ANY });
