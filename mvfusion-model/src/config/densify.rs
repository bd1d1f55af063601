//! When Gaussians are cloned, split, pruned and reset.

use serde::{Deserialize, Serialize};

use super::keys::{keys, leaves};
use super::{Interval, Steps};

/// Gaussians are never added or removed more often than this, however short the run: the statistics need some views.
const MIN_ROUND: usize = 20;

/// Opacities are never reset more often than this, however short the run: at 3DGS' rate it takes a hundred steps before a
/// Gaussian that is needed is opaque again.
const MIN_RESET: usize = 500;

/// Densification of both branches (METHOD §4.7 to §4.12).
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct DensifyConfig {
    /// First step after which Gaussians are added.
    pub from: Steps,
    /// Step of a stage after which nothing is added, removed or reset.
    pub until: Steps,
    /// Steps between rounds of cloning and splitting.
    pub interval: Interval<MIN_ROUND>,
    /// First step after which Gaussians are pruned.
    pub prune_from: Steps,
    /// Steps between rounds of pruning.
    pub prune_interval: Interval<MIN_ROUND>,
    /// Gaussians below this opacity are pruned.
    pub min_opacity: f64,
    /// Gaussians whose radius on the screen was above this many pixels are pruned as well, after the first
    /// `reset_interval` steps; 0 keeps them (DeGauss; 4DGS: 20).
    pub max_radius: f64,
    /// The same for Gaussians longer than this share of the extent; 0 keeps them (DeGauss; 4DGS: 0.1).
    pub max_scale: f64,
    /// Gaussians that pruning would remove are moved instead, at a fixed count, at most this share of the branch each time:
    /// each to one that is drawn by opacity times screen gradient, whose opacity and size the two then share (3DGS-MCMC:
    /// 0.05 of all). 0 prunes.
    pub relocate: f64,
    /// Steps, in the deforming stages and before `until`, between births in a film: dynamic Gaussians where a view of each
    /// moment differs from the model, with `model.lifetime` (docs/METHOD.md, section 13; CEM-4DGS: 920). 0 lets none be born.
    pub births_interval: Interval<MIN_ROUND>,
    /// At most so many are born at once.
    pub births: usize,
    /// Steps between opacity resets.
    pub reset_interval: Interval<MIN_RESET>,
    /// What a reset does to the Gaussians that it does not select (METHOD §4.11).
    pub reset: OpacityReset,
    /// Whether a reset on the very last step of the first stage is carried out (A40).
    pub reset_at_stage_end: bool,
    /// Gaussians larger than this share of the extent are split, the others cloned.
    pub clone_below: f64,
    /// The dynamic branch.
    pub dynamic: BranchDensifyConfig,
    /// The static branch.
    #[serde(rename = "static")]
    pub static_: BranchDensifyConfig,
    /// Whether the gradient of the mask channels counts for the dynamic branch (METHOD §4.7, `use_motion_grad`).
    pub mask_gradient: bool,
    /// From half of the training on, prune dynamic Gaussians that were never part of the foreground (METHOD §4.10).
    pub prune_unused: bool,
}

/// Densification of one branch.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct BranchDensifyConfig {
    /// Mean gradient that calls for more Gaussians in the first stage.
    pub geometry_threshold: f64,
    /// The same in the later stages.
    pub threshold: f64,
    /// Cloning and splitting never take the branch above this number: where a round wants more, the largest gradients
    /// have the room (DeGauss: a branch below it carries out the whole round). The first cloud may be larger.
    pub max_gaussians: usize,
    /// No Gaussians are pruned below this number.
    pub prune_above: usize,
    /// Share of the Gaussians that a reset selects.
    pub reset_share: f64,
}

/// What a reset does to the Gaussians that it does not select.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum OpacityReset {
    /// DeGauss: their activated opacity is stored as if it were a logit, so that they end between 0.5 and 0.73.
    Quirk,
    /// They keep their opacity.
    Clean,
}

impl Default for DensifyConfig {
    fn default() -> Self {
        Self {
            from: Steps(500),
            until: Steps(16_000),
            interval: Interval(100),
            prune_from: Steps(500),
            prune_interval: Interval(600),
            min_opacity: 0.005,
            max_radius: 0.0,
            max_scale: 0.0,
            relocate: 0.0,
            births_interval: Interval(0),
            births: 1000,
            reset_interval: Interval(2000),
            reset: OpacityReset::Quirk,
            reset_at_stage_end: true,
            clone_below: 0.01,
            dynamic: BranchDensifyConfig {
                geometry_threshold: 4e-4,
                threshold: 4e-4,
                max_gaussians: 90_000,
                prune_above: 10_000,
                reset_share: 0.5,
            },
            static_: BranchDensifyConfig {
                geometry_threshold: 4e-4,
                threshold: 8e-4,
                max_gaussians: 960_000,
                prune_above: 100_000,
                reset_share: 0.7,
            },
            mask_gradient: false,
            prune_unused: true,
        }
    }
}

keys!(DensifyConfig {
    from: ANY,
    until: ANY,
    interval: FROM_1,
    prune_from: ANY,
    prune_interval: FROM_1,
    min_opacity: SHARE,
    max_radius: FROM_0,
    max_scale: FROM_0,
    relocate: SHARE.saying("give a share from 0 to 1; 0 prunes instead"),
    births_interval: ANY,
    births: ANY,
    reset_interval: FROM_1,
    reset: ANY,
    reset_at_stage_end: ANY,
    clone_below: FROM_0,
    dynamic: ANY,
    static_: ANY,
    mask_gradient: ANY,
    prune_unused: ANY,
});

keys!(BranchDensifyConfig {
    geometry_threshold: FROM_0,
    threshold: FROM_0,
    max_gaussians: ANY,
    prune_above: ANY,
    reset_share: SHARE,
});

leaves!(OpacityReset);
