//! Blending of the renders of the two branches (METHOD §1.2, §1.3).

use burn::tensor::{Tensor, activation::relu};
use mvfusion_render::objective::constants::{
    BRIGHTNESS_KNEE, BRIGHTNESS_OFFSET, BRIGHTNESS_SLOPE, GEOMETRY_LEAN, MIN_GEOMETRY_NORMALISER, SHARE_GUARD,
};

use crate::model::mask::MaskChannel;

/// The renders of the two branches: `[B, C, H, W]`.
#[derive(Clone, Debug)]
pub struct BranchRenders {
    /// Colour of the dynamic branch, 3 channels.
    pub dynamic: Tensor<4>,
    /// Colour of the static branch, 3 channels.
    pub static_: Tensor<4>,
    /// One channel per [`MaskChannel`].
    pub mask: Tensor<4>,
}

impl BranchRenders {
    /// The same renders without gradients for the colours of the static branch where `learns` (`[B, 1, H, W]`, without
    /// autodiff) is 0.
    pub fn with_static_learning(self, learns: Tensor<4>) -> Self {
        let given = self.static_.clone().detach();
        Self { static_: given.clone() + (self.static_ - given) * Tensor::from_inner(learns), ..self }
    }
}

/// The normalisation of the mask.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Blending {
    /// First stage: biased towards the background.
    Geometry,
    /// First stage as in the original code, unclamped (METHOD §12, item 6).
    GeometryUnclamped,
    /// Later stages.
    Deformation,
    /// Evaluation.
    Evaluation,
}

/// The composed render and its components.
#[derive(Clone, Debug)]
pub struct Composition {
    /// The composed render: `[B, 3, H, W]`.
    pub composed: Tensor<4>,
    /// The dynamic branch, clamped to `[0, 1]`: `[B, 3, H, W]`.
    pub dynamic: Tensor<4>,
    /// The static branch as rendered: `[B, 3, H, W]`.
    pub static_: Tensor<4>,
    /// The static branch with brightness control, clamped: `[B, 3, H, W]`.
    pub lit: Tensor<4>,
    /// Brightness control: `[B, 1, H, W]`.
    pub brightness: Tensor<4>,
    /// Share of the dynamic branch: `[B, 1, H, W]`.
    pub mask: Tensor<4>,
    /// Share of the static branch: `[B, 1, H, W]`.
    pub static_mask: Tensor<4>,
}

impl BranchRenders {
    /// Blends the branches: `mask * dynamic + (1 - mask) * clamp(brightness * static)`.
    pub fn compose(self, blending: Blending) -> Composition {
        self.compose_within(blending, None)
    }

    /// The same with colours and shares of 0 at invalid pixels (`[B or 1, 1, H, W]`, without autodiff: 1 at valid
    /// pixels). The brightness is that of all pixels (METHOD §1.3, steps 2 to 5).
    pub fn compose_within(self, blending: Blending, valid: Option<&Tensor<4>>) -> Composition {
        let held = |mask: Tensor<4>| match blending {
            Blending::Evaluation => mask.clamp(1e-9, 1.0 - 1e-9),
            _ => mask,
        };
        let brightness = brightness(held(MaskChannel::Brightness.of(&self.mask)));
        let [static_mask, mask] =
            [MaskChannel::Static, MaskChannel::Dynamic].map(|channel| held(channel.of(&self.mask)));
        let (mask, static_mask) = shares(static_mask, mask, blending);
        let [mask, static_mask] = [mask, static_mask].map(|share| within(share, valid));
        let dynamic = within(self.dynamic, valid).clamp(0.0, 1.0);
        let static_ = within(self.static_, valid);
        let lit = (static_.clone() * brightness.clone()).clamp(0.0, 1.0);
        Composition {
            composed: mask.clone() * dynamic.clone() + static_mask.clone() * lit.clone(),
            dynamic,
            static_,
            lit,
            brightness,
            mask,
            static_mask,
        }
    }
}

impl Composition {
    /// The composition of only a static branch `[B, 3, H, W]`, at brightness 1.
    pub fn of_static(static_: Tensor<4>) -> Self {
        let lit = static_.clone().clamp(0.0, 1.0);
        let nothing = static_.clone().narrow(1, 0, 1).zeros_like();
        let whole = nothing.ones_like();
        Self {
            composed: lit.clone(),
            dynamic: lit.zeros_like(),
            static_,
            lit,
            brightness: whole.clone(),
            mask: nothing,
            static_mask: whole,
        }
    }
}

/// An image that is 0 at invalid pixels (`[B or 1, 1, H, W]`, without autodiff: 1 at valid pixels).
pub fn within(picture: Tensor<4>, valid: Option<&Tensor<4>>) -> Tensor<4> {
    match valid {
        Some(valid) => picture * valid.clone(),
        None => picture,
    }
}

/// Shares of the dynamic and the static branch from their rendered probabilities.
fn shares(static_: Tensor<4>, dynamic: Tensor<4>, blending: Blending) -> (Tensor<4>, Tensor<4>) {
    match blending {
        Blending::Geometry => {
            let (dynamic, static_) = (dynamic - GEOMETRY_LEAN, static_ + GEOMETRY_LEAN);
            let sum = (dynamic.clone() + static_).clamp_min(MIN_GEOMETRY_NORMALISER);
            let mask = (dynamic / sum).clamp(0.0, 1.0);
            (mask.clone(), -mask + 1.0)
        }
        Blending::GeometryUnclamped => {
            let (dynamic, static_) = (dynamic - GEOMETRY_LEAN, static_ + GEOMETRY_LEAN);
            let sum = dynamic.clone() + static_.clone();
            (dynamic / sum.clone(), static_ / sum)
        }
        Blending::Deformation | Blending::Evaluation => {
            let guard = if blending == Blending::Evaluation { 1e-8 } else { 0.0 };
            let (dynamic, static_) = (dynamic + SHARE_GUARD, static_ + SHARE_GUARD);
            let sum = dynamic.clone() + static_.clone() + guard;
            (dynamic / sum.clone(), static_ / sum)
        }
    }
}

/// Brightness factor of a control in `[0, 1]`: `0.5 + g(x)`, with slope 1 up to 0.75 and 37 above.
pub fn brightness<const D: usize>(control: Tensor<D>) -> Tensor<D> {
    // The slope at the knee itself is the lower one. `clamp_min` would have gradient 1 there.
    let above = relu(control.clone() - BRIGHTNESS_KNEE);
    control + above * (BRIGHTNESS_SLOPE - 1.0) + BRIGHTNESS_OFFSET
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::random::Stream;
    use crate::test_support::{for_each_device, picture, values};

    #[test]
    fn what_does_not_learn_looks_the_same() {
        for_each_device(|device| {
            let mut stream = Stream::new(1, 0);
            let mut layer = || picture(&mut stream, [2, 3], &device);
            let static_ = layer().autodiff().require_grad();
            let layers =
                BranchRenders { dynamic: layer().autodiff(), static_: static_.clone(), mask: layer().autodiff() };
            let learns = [0.0, 1.0, 1.0, 0.0, 0.0, 1.0];
            let mask = Tensor::<1>::from_data(learns, &device).reshape([1, 1, 2, 3]);
            let whole = layers.clone().compose(Blending::Deformation);
            let partly = layers.with_static_learning(mask).compose(Blending::Deformation);
            for (a, b) in values(partly.composed.clone().inner()).iter().zip(values(whole.composed.inner())) {
                assert!((a - b).abs() < 1e-6, "{a} became {b}");
            }
            let gradients = partly.composed.sum().backward();
            let gradient = values(static_.grad(&gradients).expect("it took part"));
            let lit = values(partly.lit.inner());
            for (index, (&gradient, &lit)) in gradient.iter().zip(&lit).enumerate() {
                // A saturated pixel has no gradient either.
                assert!(lit >= 1.0 || (gradient == 0.0) == (learns[index % 6] == 0.0), "{index}: {gradient}");
            }
        });
    }
}
