//! The renders that the losses compare.

use burn::tensor::Tensor;

use crate::model::composition::Composition;

/// One copy of a batch's renders. The op returns two copies, one for each loss.
#[derive(Clone, Debug)]
pub struct Pictures {
    /// The blended renders.
    pub composition: Composition,
    /// Accumulated depth of the dynamic branch, in world units: `[B, 1, H, W]`.
    pub dynamic_depth: Tensor<4>,
    /// Accumulated depth of the static branch: `[B, 1, H, W]`.
    pub static_depth: Tensor<4>,
}

impl Pictures {
    /// The renders with black colours at invalid pixels (`[B, 1, H, W]`: 1 at valid pixels), like the photos.
    /// Comparisons with a photo therefore ignore these pixels. Other terms (depth order, mask entropy, brightness)
    /// apply everywhere.
    pub fn within(self, valid: Option<&Tensor<4>>) -> Self {
        let blend = self.composition;
        let composition = Composition {
            composed: within(blend.composed, valid),
            dynamic: within(blend.dynamic, valid),
            static_: within(blend.static_, valid),
            lit: within(blend.lit, valid),
            ..blend
        };
        Self { composition, ..self }
    }
}

/// An image, black at invalid pixels.
pub fn within(picture: Tensor<4>, valid: Option<&Tensor<4>>) -> Tensor<4> {
    match valid {
        // The mask is a constant in the graph.
        Some(valid) => picture * Tensor::from_inner(valid.clone()),
        None => picture,
    }
}
