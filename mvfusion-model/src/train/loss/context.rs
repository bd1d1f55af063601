//! The inputs of the losses besides the renders.

use burn::tensor::Tensor;
use mvfusion_render::objective::{GeometryTerms, MaskNormalisation, ObjectiveTerms};
use mvfusion_render::window::Window;

use super::{LossSchedule, MotionMasks, MotionWitness};

/// The ground truth, the configuration and the position in training.
#[derive(Clone, Debug)]
pub struct LossContext<'a> {
    /// The photos, black at invalid pixels: `[B, 3, H, W]` in `[0, 1]`.
    pub photos: &'a Tensor<4>,
    /// 1 at valid pixels, otherwise 0: `[B or 1, 1, H, W]`; absent if all are valid. The renders are composed within it.
    pub valid: Option<&'a Tensor<4>>,
    /// Detected motion; absent if unknown.
    pub motion: Option<&'a MotionMasks>,
    /// Weights.
    pub config: &'a crate::config::LossConfig,
    /// The position in training.
    pub schedule: LossSchedule,
    /// The scene's extent.
    pub extent: f64,
    /// The windows of the structural terms.
    pub windows: &'a Windows,
}

impl LossContext<'_> {
    /// The weights of the terms over pixels, for [`objective`](mvfusion_render::objective).
    pub(crate) fn objective_terms(&self) -> ObjectiveTerms {
        let (config, schedule) = (self.config, &self.schedule);
        let if_sure = |weight: f64| if self.sure_motion().is_some() { weight } else { 0.0 };
        ObjectiveTerms {
            normalisation: match schedule.geometry {
                true => MaskNormalisation::Geometry,
                false => MaskNormalisation::Deformation,
            },
            extent: self.extent,
            dynamic_region: config.dynamic_where_moving && self.motion.is_some(),
            static_region: config.static_where_still && self.sure_motion().is_some(),
            ssim: self.windows.ssim.clone(),
            structure: self.windows.structure.clone(),
            geometry: schedule.geometry.then_some(GeometryTerms {
                l1: config.main,
                dssim: config.geometry_dssim,
                mean: config.geometry_mean,
            }),
            composed_l1: if schedule.geometry { 0.0 } else { config.main },
            depth_back: config.depth_back,
            depth_back_detached: config.depth_back_detached,
            depth_forward: config.depth_forward,
            depth_smooth: config.depth_smooth,
            likeness: config.penalize_dynamic,
            branch_dssim: config.branch_dssim,
            branch_l1: config.branch_l1,
            dynamic_above: config.dynamic_above,
            static_above: config.static_above,
            composed_dssim: config.composed_dssim,
            brightness: config.brightness + schedule.brightness_weight(),
            explicit_brightness: schedule.explicit_weight(config.brightness_explicit),
            entropy: if schedule.entropy() { config.entropy } else { 0.0 },
            mask_motion: if_sure(config.mask_motion),
            mask_still: if_sure(config.mask_still),
        }
    }

    /// 1 where the dynamic branch learns whatever its mask, if the configuration uses motion for this and it is known.
    pub(super) fn dynamic_region(&self) -> Option<Tensor<4>> {
        self.motion.filter(|_| self.config.dynamic_where_moving).map(|motion| motion.around.clone())
    }

    /// 1 where the static branch may learn, if the configuration uses motion for this and cameras detected it.
    pub(crate) fn static_region(&self) -> Option<Tensor<4>> {
        let motion = self.sure_motion().filter(|_| self.config.static_where_still)?;
        Some(motion.still.clone())
    }

    /// Motion that fixed cameras detected, independent of the branches.
    pub(super) fn sure_motion(&self) -> Option<&MotionMasks> {
        self.motion.filter(|motion| motion.seen_by == MotionWitness::StillCamera)
    }
}

/// The two Gaussian windows of the structural terms.
#[derive(Clone, Debug)]
pub struct Windows {
    /// 11 pixels, sigma 1.5: SSIM.
    pub ssim: Window,
    /// 5 pixels, sigma 1.5: the structure comparison of the two branches.
    pub structure: Window,
}

impl Default for Windows {
    fn default() -> Self {
        Self { ssim: Window::gaussian(11, 1.5), structure: Window::gaussian(5, 1.5) }
    }
}
