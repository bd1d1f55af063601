//! Masks of detected motion in a batch.

use burn::tensor::Tensor;
use burn::tensor::module::avg_pool2d;
use burn::tensor::ops::AvgPoolOptions;

use crate::train::births::{LEAST_ERROR, LEAST_SHARE, PATCH};

/// Detected motion in a batch: masks `[B, 1, H, W]` of 0 and 1, without autodiff.
#[derive(Clone, Debug)]
pub struct MotionMasks {
    /// 1 at moving pixels.
    pub moving: Tensor<4>,
    /// The same, dilated if fixed cameras detected the motion, because edges are blends of both branches.
    pub around: Tensor<4>,
    /// 1 where `around` is 0.
    pub still: Tensor<4>,
    /// The source of the detection.
    pub seen_by: MotionWitness,
}

/// The source of detected motion.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum MotionWitness {
    /// A fixed camera, whose pixels differ from their median over time.
    StillCamera,
    /// The static branch, from which a photo differs. The difference may also mean that the branch has not learned yet.
    /// The branch therefore continues to learn there, and the motion does not constrain the mask.
    StaticBranch,
}

impl MotionMasks {
    /// Motion where photos `[B, 3, H, W]` differ from the render of the static branch, by the rule of
    /// [`births`](crate::train::births). Invalid pixels are black in both, so they count as correct.
    pub fn by_difference(photos: &Tensor<4>, static_: Tensor<4>) -> Self {
        let difference = (photos.clone() - static_.clamp(0.0, 1.0)).abs().max_dim(1);
        let dtype = difference.dtype();
        let wrong = difference.greater_equal_elem(LEAST_ERROR).float().cast(dtype);
        let reach = PATCH / 2;
        // Pixels outside the image count as correct, as in births.
        let square =
            AvgPoolOptions::new([PATCH; 2]).with_stride([1; 2]).with_padding([reach; 2]).with_count_include_pad(true);
        let share = avg_pool2d(wrong.clone(), square);
        let moving = wrong * share.greater_equal_elem(LEAST_SHARE).float().cast(dtype);
        Self::new(moving.clone(), moving, MotionWitness::StaticBranch)
    }

    /// Masks from the moving pixels and their dilation.
    pub fn new(moving: Tensor<4>, around: Tensor<4>, seen_by: MotionWitness) -> Self {
        Self { still: -around.clone() + 1.0, moving, around, seen_by }
    }

    /// Removes invalid pixels (`[B, 1, H, W]`: 1 at valid pixels) from all masks.
    pub fn within(self, valid: Option<&Tensor<4>>) -> Self {
        let Some(valid) = valid else { return self };
        let [moving, around, still] = [self.moving, self.around, self.still].map(|mask| mask * valid.clone());
        Self { moving, around, still, ..self }
    }
}
