//! Weights and switches of the losses.

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use super::keys::keys;

/// The losses (METHOD §4.4; values of DeGauss' Neu3D config). The main loss drives densification, the light loss does
/// not. In a model with one branch, only `main`, `composed_dssim`, `plane_smooth`, `time_smooth` and `time_l1` have an
/// effect (METHOD §9).
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(default, deny_unknown_fields)]
pub struct LossConfig {
    /// Weight of the L1 terms of the main loss.
    pub main: f64,
    /// Whether the first stage blends both branches equally instead of by the mask.
    pub geometry_mean: bool,
    /// Weight of the structural terms of each branch in the first stage.
    pub geometry_dssim: f64,
    /// Weight of the structural term of the composed render (light loss).
    pub composed_dssim: f64,
    /// Weight of the structural term of each branch inside its own mask.
    pub branch_dssim: f64,
    /// Weight of the L1 term of each branch inside its own mask.
    pub branch_l1: f64,
    /// Static share of a pixel above which the static branch learns it, in the two previous terms. DeGauss: 0.51, so
    /// one branch or none. Below 0.5, both branches learn where the mask is undecided.
    pub static_above: f64,
    /// Likewise for the dynamic branch; with 0 it learns the whole image, whatever the mask.
    pub dynamic_above: f64,
    /// Whether the dynamic branch learns where motion was detected and where its share is above 0.51, instead of by
    /// `dynamic_above`. In the first stage's own terms, its share does not count. Needs fixed, synchronised cameras, or
    /// photos with births (`init.photo_points`). Ours: a branch that learns the whole image spends its Gaussians on a
    /// blur of the room.
    pub dynamic_where_moving: bool,
    /// Whether the static branch learns only where no motion was detected, from any loss and also in the first stage.
    /// Ours: otherwise, the first stage leaves a ghost of a moving person, which the mask then hides from the losses.
    pub static_where_still: bool,
    /// Weight of the mean of `(1 - mask) moving`, which keeps the mask open where motion was detected (light loss).
    /// Ours: a mask that closes over a blur does not reopen.
    pub mask_motion: f64,
    /// Weight of the mean of `mask still`, which closes the mask where no motion was detected nearby (light loss).
    /// Ours: otherwise, an open mask costs nothing once the dynamic branch shows a static region as well as the static
    /// branch.
    pub mask_still: f64,
    /// Weight of the mean opacity of the static Gaussians, as in 3DGS-MCMC (there 0.01). Ours: static Gaussians in
    /// regions that the mask assigns to the dynamic branch in all views have no other gradient. They fade instead of
    /// leaving an artefact.
    pub static_opacity: f64,
    /// Weight of the mean opacity of the dynamic Gaussians. Ours.
    pub dynamic_opacity: f64,
    /// Weight of the mean opacity of still dynamic Gaussians, weighted by their stillness, from the first measurement of
    /// motion on. Ours: the soft form of `motion.still = "prune"`.
    pub still_opacity: f64,
    /// Weight of the second differences of the spatial planes.
    pub plane_smooth: f64,
    /// Weight of the second differences of the time planes.
    pub time_smooth: f64,
    /// Weight of the distance of the time planes from 1.
    pub time_l1: f64,
    /// Weight that keeps the foreground in front of the background; 0 switches it off.
    pub depth_back: f64,
    /// Whether that term has no gradient for the background's depth (DeGauss: yes, except for recordings from glasses).
    pub depth_back_detached: bool,
    /// Weight that keeps the dynamic branch behind the background where the mask is low; 0 switches it off.
    pub depth_forward: f64,
    /// Weight of the edge-aware smoothness of the background's depth.
    pub depth_smooth: f64,
    /// Weight against a foreground that looks like the background.
    pub penalize_dynamic: f64,
    /// Weight that pulls the brightness to 1, in all stages.
    pub brightness: f64,
    /// Weight of the same term at the end of densification, or of the run without densification, growing linearly from
    /// 0.001 (`weight_penal_light_end`). It does not fall below 0.
    pub brightness_end: f64,
    /// Weight of the difference between the brightened background and the photo, early in training; 0 switches the
    /// term off.
    pub brightness_explicit: f64,
    /// Weight against Gaussians larger than a tenth of the extent.
    pub large: f64,
    /// Weight against Gaussians more than five times longer than wide, every tenth step.
    pub spiky: f64,
    /// Weight of the mask's entropy after half as many steps as the last two stages have.
    pub entropy: f64,
}

impl Default for LossConfig {
    fn default() -> Self {
        Self {
            main: 1.0,
            geometry_mean: true,
            geometry_dssim: 0.2,
            composed_dssim: 0.4,
            branch_dssim: 0.4,
            branch_l1: 2.0,
            static_above: 0.51,
            dynamic_above: 0.51,
            dynamic_where_moving: false,
            static_where_still: false,
            mask_motion: 0.0,
            mask_still: 0.0,
            static_opacity: 0.0,
            dynamic_opacity: 0.0,
            still_opacity: 0.0,
            plane_smooth: 2e-4,
            time_smooth: 1e-3,
            time_l1: 1e-4,
            depth_back: 0.1,
            depth_back_detached: true,
            depth_forward: 0.1,
            depth_smooth: 0.01,
            penalize_dynamic: 0.01,
            brightness: 1e-4,
            brightness_end: 0.5,
            brightness_explicit: 0.01,
            large: 0.01,
            spiky: 0.1,
            entropy: 0.01,
        }
    }
}

keys!(LossConfig {
    main: WEIGHT,
    geometry_mean: ANY,
    geometry_dssim: WEIGHT,
    composed_dssim: WEIGHT,
    branch_dssim: WEIGHT,
    branch_l1: WEIGHT,
    static_above: SHARE,
    dynamic_above: SHARE,
    dynamic_where_moving: ANY,
    static_where_still: ANY,
    mask_motion: WEIGHT,
    mask_still: WEIGHT,
    static_opacity: WEIGHT,
    dynamic_opacity: WEIGHT,
    still_opacity: WEIGHT,
    plane_smooth: WEIGHT,
    time_smooth: WEIGHT,
    time_l1: WEIGHT,
    depth_back: WEIGHT,
    depth_back_detached: ANY,
    depth_forward: WEIGHT,
    depth_smooth: WEIGHT,
    penalize_dynamic: WEIGHT,
    brightness: WEIGHT,
    brightness_end: WEIGHT,
    brightness_explicit: WEIGHT,
    large: WEIGHT,
    spiky: WEIGHT,
    entropy: WEIGHT,
});
