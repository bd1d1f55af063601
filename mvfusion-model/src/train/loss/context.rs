//! The inputs of the losses besides the renders.

use burn::tensor::Tensor;
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
