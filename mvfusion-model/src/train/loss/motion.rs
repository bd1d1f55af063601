//! Where something was seen to move, as masks of a batch.

use burn::tensor::Tensor;
use burn::tensor::module::avg_pool2d;
use burn::tensor::ops::AvgPoolOptions;

use crate::train::births::{LEAST_ERROR, LEAST_SHARE, PATCH};

/// Where something was seen to move in a batch: `[B, 1, H, W]` each, 1 there and 0 elsewhere, without autodiff.
#[derive(Clone, Debug)]
pub struct MotionMasks {
    /// The pixels that move.
    pub moving: Tensor<4>,
    /// The same, grown by some pixels: an edge is a blend of both branches.
    pub around: Tensor<4>,
    /// 1 where nothing moves, neither there nor around.
    pub still: Tensor<4>,
    /// What says so.
    pub seen_by: MotionWitness,
}

/// What says that something moves.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum MotionWitness {
    /// A camera that stands still, whose pixels differ from their median over time.
    StillCamera,
    /// The static branch, from which a photo differs. It may differ as well because that branch has yet to learn, so it
    /// learns there all the same, and the mask is left to the picture.
    StaticBranch,
}

impl MotionMasks {
    /// Where photos `[B, 3, H, W]` differ from what the static branch shows there, by the rule of [`births`](crate::train::births).
    pub fn by_difference(photos: &Tensor<4>, static_: Tensor<4>) -> Self {
        let difference = (photos.clone() - static_.clamp(0.0, 1.0)).abs().max_dim(1);
        let dtype = difference.dtype();
        let wrong = difference.greater_equal_elem(LEAST_ERROR).float().cast(dtype);
        let reach = PATCH / 2;
        // Pixels outside of the picture count as right, as they do for births.
        let square =
            AvgPoolOptions::new([PATCH; 2]).with_stride([1; 2]).with_padding([reach; 2]).with_count_include_pad(true);
        let share = avg_pool2d(wrong.clone(), square);
        let moving = wrong * share.greater_equal_elem(LEAST_SHARE).float().cast(dtype);
        Self::new(moving.clone(), moving, MotionWitness::StaticBranch)
    }

    /// From the pixels that move and those around them.
    pub fn new(moving: Tensor<4>, around: Tensor<4>, seen_by: MotionWitness) -> Self {
        Self { still: -around.clone() + 1.0, moving, around, seen_by }
    }

    /// Without the pixels that do not count (`[B, 1, H, W]`: 1 where they do): they neither move nor stand still.
    pub fn within(self, valid: Option<&Tensor<4>>) -> Self {
        let Some(valid) = valid else { return self };
        let [moving, around, still] = [self.moving, self.around, self.still].map(|mask| mask * valid.clone());
        Self { moving, around, still, ..self }
    }
}
