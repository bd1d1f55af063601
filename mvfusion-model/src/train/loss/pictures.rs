//! The renders that the losses compare.

use burn::tensor::Tensor;

use crate::model::composition::Composition;

/// One copy of a batch's renders. The op returns two copies, one for each loss.
#[derive(Clone, Debug)]
pub struct Pictures {
    /// The blended renders. With a mask of valid pixels, those of
    /// [`compose_within`](crate::model::composition::BranchRenders::compose_within).
    pub composition: Composition,
    /// Accumulated depth of the dynamic branch, in world units: `[B, 1, H, W]`.
    pub dynamic_depth: Tensor<4>,
    /// Accumulated depth of the static branch: `[B, 1, H, W]`.
    pub static_depth: Tensor<4>,
}
