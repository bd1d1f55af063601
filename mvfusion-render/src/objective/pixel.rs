//! The computations of the objective at one pixel, many pixels at a time: the blend of the branches, the terms with their
//! cotangents, and the way back to the renders. GPU twin: `mvfusion_kernels::cube::objective`.

mod blend;
mod cost;

use mvfusion_kernels::splat::COLOUR_CHANNELS;
use pulp::Simd;

pub use self::blend::{Blend, BlendAdjoint};
pub use self::cost::PixelTerms;
use super::ObjectiveTerms;
use crate::simd::{Lanes, Wide};

/// A colour.
pub type Colour<V> = [V; COLOUR_CHANNELS];

/// Comparisons by SSIM, and by its structure term.
pub const COMPARISONS: usize = 4;

/// What is compared with what, in the order of all arrays of length [`COMPARISONS`].
pub mod comparison {
    /// SSIM of the dynamic branch with the photo.
    pub const DYNAMIC: usize = 0;
    /// SSIM of the static branch with the photo.
    pub const LIT: usize = 1;
    /// SSIM of the composed render with the photo.
    pub const COMPOSED: usize = 2;
    /// Structure term of both branches.
    pub const STRUCTURE: usize = 3;
}

/// The layers of a pixel, with the exposure of the camera, or their cotangents.
#[derive(Clone, Copy)]
pub struct Layers<V> {
    pub dynamic: Colour<V>,
    /// Static, brightness, dynamic.
    pub mask: [V; 3],
    pub dynamic_depth: V,
    pub static_: Colour<V>,
    pub static_depth: V,
}

/// The masks of a pixel.
#[derive(Clone, Copy)]
pub struct Masks<V> {
    pub valid: V,
    pub moving: V,
    pub around: V,
}

impl<S: Simd, T: Lanes> Masks<Wide<S, T>> {
    /// 1 away from moving pixels.
    #[inline(always)]
    fn still(&self) -> Wide<S, T> {
        self.valid - self.around
    }

    /// 1 where the dynamic branch learns whatever its mask.
    #[inline(always)]
    fn dynamic_region(&self, terms: &ObjectiveTerms) -> Wide<S, T> {
        if terms.dynamic_region { self.around } else { self.around.value(1.0) }
    }

    /// 1 where the static branch learns.
    #[inline(always)]
    pub fn static_region(&self, terms: &ObjectiveTerms) -> Wide<S, T> {
        if terms.static_region { self.still() } else { self.around.value(1.0) }
    }
}

/// The weights of the terms, divided by the number of values in their means.
pub struct Scales<T> {
    composed_l1: T,
    geometry_l1: T,
    geometry_dssim: T,
    depth_back: T,
    depth_forward: T,
    likeness: T,
    branch_dssim: T,
    branch_l1: T,
    composed_dssim: T,
    brightness: T,
    explicit_brightness: T,
    entropy: T,
    mask_motion: T,
    mask_still: T,
}

impl<T: Lanes> Scales<T> {
    /// The scales for pictures of so many pixels.
    pub fn new(terms: &ObjectiveTerms, pixels: usize) -> Self {
        let scalar = |weight: f64| T::of(weight / pixels as f64);
        let colour = |weight: f64| T::of(weight / (COLOUR_CHANNELS * pixels) as f64);
        let geometry = terms.geometry.as_ref();
        Self {
            composed_l1: colour(terms.composed_l1),
            geometry_l1: colour(geometry.map_or(0.0, |geometry| geometry.l1)),
            geometry_dssim: colour(geometry.map_or(0.0, |geometry| geometry.dssim)),
            depth_back: scalar(terms.depth_back),
            depth_forward: scalar(terms.depth_forward),
            likeness: colour(terms.likeness),
            branch_dssim: colour(terms.branch_dssim),
            branch_l1: colour(terms.branch_l1),
            composed_dssim: colour(terms.composed_dssim),
            brightness: scalar(terms.brightness),
            explicit_brightness: colour(terms.explicit_brightness),
            entropy: scalar(terms.entropy),
            mask_motion: scalar(terms.mask_motion),
            mask_still: scalar(terms.mask_still),
        }
    }
}

/// 1 where `value` exceeds the threshold.
#[inline(always)]
fn above<S: Simd, T: Lanes>(value: Wide<S, T>, threshold: f64) -> Wide<S, T> {
    value.value(threshold).if_less(value, value.value(1.0), value.value(0.0))
}

/// `value` within its bounds; NaN stays.
#[inline(always)]
fn clamp<S: Simd, T: Lanes>(value: Wide<S, T>, [low, high]: [Wide<S, T>; 2]) -> Wide<S, T> {
    let value = value.if_less(low, low, value);
    high.if_less(value, high, value)
}

/// `passed` where `value` is not outside the bounds, 0 elsewhere: the derivative of [`clamp`].
#[inline(always)]
fn within<S: Simd, T: Lanes>(value: Wide<S, T>, [low, high]: [Wide<S, T>; 2], passed: Wide<S, T>) -> Wide<S, T> {
    let zero = value.value(0.0);
    high.if_less(value, zero, value.if_less(low, zero, passed))
}

/// The bounds of a colour or share.
#[inline(always)]
fn unit<S: Simd, T: Lanes>(like: Wide<S, T>) -> [Wide<S, T>; 2] {
    [like.value(0.0), like.value(1.0)]
}

/// The sign of a value: -1, 0 or 1.
#[inline(always)]
fn sign<S: Simd, T: Lanes>(value: Wide<S, T>) -> Wide<S, T> {
    let zero = value.value(0.0);
    zero.if_less(value, value.value(1.0), value.if_less(zero, value.value(-1.0), zero))
}
