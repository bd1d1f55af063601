//! When Gaussians are cloned, split, pruned and reset.

use serde::{Deserialize, Serialize};

/// Densification of both branches (METHOD §4.7 to §4.12).
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct DensifyConfig {
    /// First step after which Gaussians are added.
    pub from: usize,
    /// Step of a stage after which nothing is added, removed or reset.
    pub until: usize,
    /// Steps between rounds of cloning and splitting.
    pub interval: usize,
    /// First step after which Gaussians are pruned.
    pub prune_from: usize,
    /// Steps between rounds of pruning.
    pub prune_interval: usize,
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
    pub births_interval: usize,
    /// At most so many are born at once.
    pub births: usize,
    /// Steps between opacity resets.
    pub reset_interval: usize,
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
            from: 500,
            until: 16_000,
            interval: 100,
            prune_from: 500,
            prune_interval: 600,
            min_opacity: 0.005,
            max_radius: 0.0,
            max_scale: 0.0,
            relocate: 0.0,
            births_interval: 0,
            births: 1000,
            reset_interval: 2000,
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
