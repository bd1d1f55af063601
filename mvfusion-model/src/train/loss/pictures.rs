//! The pictures that the losses compare.

use burn::tensor::Tensor;

use crate::model::composition::Composition;

/// One copy of a batch's pictures: the op renders each twice, one for each loss.
#[derive(Clone, Debug)]
pub struct Pictures {
    /// The blended pictures.
    pub composition: Composition,
    /// Accumulated depth of the dynamic branch, world units: `[B, 1, H, W]`.
    pub dynamic_depth: Tensor<4>,
    /// Accumulated depth of the static branch: `[B, 1, H, W]`.
    pub static_depth: Tensor<4>,
}

impl Pictures {
    /// The pictures with their colours black where the photos do not count (`[B, 1, H, W]`: 1 where they do), as the photos
    /// are there: no comparison with a photo sees what is drawn there. Terms that compare with none (order of depths, entropy of
    /// the mask, brightness) hold everywhere.
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

/// A picture, black where the photos do not count.
pub fn within(picture: Tensor<4>, valid: Option<&Tensor<4>>) -> Tensor<4> {
    match valid {
        // The mask is a constant of the graph.
        Some(valid) => picture * Tensor::from_inner(valid.clone()),
        None => picture,
    }
}
