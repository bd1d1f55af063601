//! Weights and switches of the losses.

use serde::{Deserialize, Serialize};

use super::keys::keys;

/// The losses (METHOD §4.4; numbers of DeGauss' Neu3D config). The main loss drives densification, the light one does not.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct LossConfig {
    /// Weight of the L1 terms of the main loss.
    pub main: f64,
    /// Whether the first stage blends both branches half and half instead of by the mask.
    pub geometry_mean: bool,
    /// Weight of the structural terms of each branch in the first stage.
    pub geometry_dssim: f64,
    /// Weight of the structural term of the composed picture (light loss).
    pub composed_dssim: f64,
    /// Weight of the structural term of each branch inside its own mask.
    pub branch_dssim: f64,
    /// Weight of the L1 term of each branch inside its own mask.
    pub branch_l1: f64,
    /// Share of a pixel above which the static branch answers for it, in the two terms before this one. DeGauss: 0.51,
    /// either branch or none. Below a half both branches learn where the mask is undecided.
    pub static_above: f64,
    /// The same for the dynamic branch; 0 makes it learn all of the picture, whatever the mask.
    pub dynamic_above: f64,
    /// Whether the dynamic branch learns where something was seen to move, and where its share is above a half, instead of
    /// where `dynamic_above` says; where cameras stand still and film the same moments. Ours: a branch that is asked for the
    /// whole picture spends its Gaussians on a blur of the room.
    pub dynamic_where_moving: bool,
    /// Whether the static branch learns only where nothing was seen to move, from any loss and also in the first stage. Ours: what it learns of a player in the first stage stays as a ghost that the mask then hides, because
    /// nothing is compared there.
    pub static_where_still: bool,
    /// Weight that holds the mask open where something was seen to move: the mean of `(1 - mask) moving` (light loss). Ours:
    /// a mask that closes over a blur does not come back.
    pub mask_motion: f64,
    /// Weight that closes the mask where nothing was seen to move: the mean of `mask (1 - moving)` (light loss). Ours: a mask
    /// over what stands still costs nothing otherwise, once the dynamic branch shows it as well as the static one.
    pub mask_still: f64,
    /// Weight of the mean opacity of the static Gaussians, as in 3DGS-MCMC (there 0.01). Ours: those that stand for what
    /// the mask gives to the dynamic branch in all views have no other gradient, so that they fade instead of staying as a
    /// stain.
    pub static_opacity: f64,
    /// The same for the dynamic Gaussians.
    pub dynamic_opacity: f64,
    /// Weight of the mean opacity of those dynamic Gaussians that stand still: each counts by its stillness
    /// ([`MotionCache::stillness`](crate::model::motion::MotionCache::stillness)), from the first measurement of motion on. Ours: the
    /// soft form of `motion.still = "prune"`.
    pub still_opacity: f64,
    /// Weight of the spatial planes' second differences.
    pub plane_smooth: f64,
    /// Weight of the time planes' second differences.
    pub time_smooth: f64,
    /// Weight of the time planes' distance from one.
    pub time_l1: f64,
    /// Weight that keeps the foreground in front of the background; 0 switches it off.
    pub depth_back: f64,
    /// Whether that term leaves the background's depth alone (DeGauss: yes, but for recordings from glasses).
    pub depth_back_detached: bool,
    /// Weight that keeps what is not foreground behind the background; 0 switches it off.
    pub depth_forward: f64,
    /// Weight of the edge-aware smoothness of the background's depth.
    pub depth_smooth: f64,
    /// Weight against a foreground that looks like the background.
    pub penalize_dynamic: f64,
    /// Weight that pulls the brightness to one, in all stages.
    pub brightness: f64,
    /// Weight of the same at the end of densification, growing linearly from 0.001 (`weight_penal_light_end`).
    pub brightness_end: f64,
    /// Weight of the brightened background against the photo, early on.
    pub brightness_explicit: f64,
    /// Weight against Gaussians larger than a tenth of the extent.
    pub large: f64,
    /// Weight against Gaussians five times longer than wide, every tenth step.
    pub spiky: f64,
    /// Weight of the mask's entropy in the second half of training.
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
