//! Cloning, splitting, pruning and opacity resets.

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use super::keys::{keys, leaves};
use super::{Interval, Steps};

/// Minimum number of steps between additions or removals in shortened runs, because the statistics need some views.
const MIN_ROUND: usize = 20;

/// Minimum number of steps between opacity resets in shortened runs. At the rate of 3DGS, a Gaussian needs a hundred
/// steps to become opaque again.
const MIN_RESET: usize = 500;

/// Densification of both branches (METHOD §4.7 to §4.12).
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(default, deny_unknown_fields)]
pub struct DensifyConfig {
    /// First step after which Gaussians are added.
    pub from: Steps,
    /// Step of a stage from which nothing is added, removed or reset.
    pub until: Steps,
    /// Steps between rounds of cloning and splitting.
    pub interval: Interval<MIN_ROUND>,
    /// First step after which Gaussians are pruned.
    pub prune_from: Steps,
    /// Steps between rounds of pruning.
    pub prune_interval: Interval<MIN_ROUND>,
    /// Gaussians below this opacity are pruned.
    pub min_opacity: f64,
    /// After the first `reset_interval` steps, Gaussians whose radius on the screen exceeded this many pixels are also
    /// pruned; 0 keeps them (DeGauss; 4DGS: 20). A round of additions in the same step resets
    /// the radii before pruning reads them.
    pub max_radius: f64,
    /// Likewise for Gaussians longer than this fraction of the extent; 0 keeps them (DeGauss; 4DGS: 0.1).
    pub max_scale: f64,
    /// Instead of pruning Gaussians, move at most this fraction of the branch each time, at a fixed count. The target
    /// of each is drawn by opacity times screen gradient, and the two then share its opacity and size (3DGS-MCMC: 0.05
    /// of all). It does not depend on `prune_above`. 0 prunes.
    pub relocate: f64,
    /// Power of the relative motion intensity `2 e / (e + mean e)` by which a dynamic Gaussian's screen gradient is
    /// multiplied when Gaussians are added or relocated, once motion was measured. Ours: motion then decides where
    /// Gaussians are added. `motion.trajectory` says whether travel by lifetimes is motion. 0 leaves it to the gradient.
    pub motion_power: f64,
    /// Steps between births in a video, in the deforming stages and before `until`. Dynamic Gaussians are added where a
    /// view of each moment differs from the model; needs `model.lifetime` (docs/METHOD.md, section 13; CEM-4DGS: 920).
    /// 0 switches births off.
    pub births_interval: Interval<MIN_ROUND>,
    /// Maximum number of Gaussians per round of births. Ours.
    pub births: usize,
    /// Steps between opacity resets.
    pub reset_interval: Interval<MIN_RESET>,
    /// The effect of a reset on Gaussians that it does not select (METHOD §4.11).
    pub reset: OpacityReset,
    /// Whether a reset on the last step of the first stage is performed (A40). Before births in photos, none is.
    pub reset_at_stage_end: bool,
    /// Gaussians larger than this fraction of the extent are split, the others cloned.
    pub clone_below: f64,
    /// Densification of one branch: the dynamic one.
    pub dynamic: BranchDensifyConfig,
    /// Densification of one branch: the static one.
    #[serde(rename = "static")]
    pub static_: BranchDensifyConfig,
    /// Whether the gradient of the mask channels counts for the dynamic branch (METHOD §4.7, `use_motion_grad`).
    pub mask_gradient: bool,
    /// After half as many steps as the last two stages have, prune dynamic Gaussians that were never part of the
    /// foreground (METHOD §4.10). A `relocate` above 0 implies it.
    pub prune_unused: bool,
}

/// Densification of one branch.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct BranchDensifyConfig {
    /// Gradient threshold for cloning and splitting in the first stage.
    pub geometry_threshold: f64,
    /// Gradient threshold in the later stages.
    pub threshold: f64,
    /// Maximum number of Gaussians, from the start on. If a round selects more, those with the largest gradients take
    /// precedence (DeGauss: a branch below the maximum performs the whole round). Of a larger initial cloud, random
    /// points are kept.
    pub max_gaussians: usize,
    /// Pruning requires more Gaussians than this.
    pub prune_above: usize,
    /// Fraction of the Gaussians that a reset selects.
    pub reset_share: f64,
}

/// The effect of a reset on Gaussians that it does not select.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum OpacityReset {
    /// DeGauss: their activated opacity is stored as a logit, so that it ends between 0.5 and 0.73.
    Quirk,
    /// They keep their opacity.
    Clean,
}

impl DensifyConfig {
    /// Whether Gaussians are born in a video after `step` of its deforming stages. A round that would look at opacities
    /// that were just reset is left out, unless that is true of all rounds.
    pub fn births_due(&self, step: usize) -> bool {
        let has_others = !self.births_interval.0.is_multiple_of(self.reset_interval.0);
        self.births_interval.is_due(step) && !(has_others && self.reset_interval.is_due(step)) && step < self.until.0
    }
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
            motion_power: 0.0,
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
    from: STEPS,
    until: STEPS,
    interval: INTERVAL,
    prune_from: STEPS,
    prune_interval: INTERVAL,
    min_opacity: SHARE,
    max_radius: FROM_0,
    max_scale: FROM_0,
    relocate: SHARE.saying("give a share; 0 prunes instead"),
    motion_power: FROM_0.to(8.0).saying("give a power; 0 lets the gradient alone decide"),
    births_interval: STEPS,
    births: GAUSSIANS,
    reset_interval: INTERVAL,
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
    max_gaussians: GAUSSIANS.from(1.0),
    prune_above: GAUSSIANS,
    reset_share: SHARE,
});

leaves!(OpacityReset);
