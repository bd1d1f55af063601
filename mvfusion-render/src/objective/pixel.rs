//! The computations of the objective at one pixel, many pixels at a time: the blend of the branches, the terms with their
//! cotangents, and the way back to the renders. GPU twin: `mvfusion_kernels::cube::objective`.
#![allow(clippy::needless_range_loop, reason = "loops over channels of several arrays are unrolled as they are")]

use mvfusion_kernels::objective::*;
use mvfusion_kernels::splat::COLOUR_CHANNELS;
use pulp::Simd;

use super::{MaskNormalisation, ObjectiveTerms};
use crate::simd::{Lanes, Wide};

/// A colour.
pub(super) type Colour<V> = [V; COLOUR_CHANNELS];

/// Comparisons by SSIM, and by its structure term.
pub(super) const COMPARISONS: usize = 4;

/// What is compared with what, in the order of all arrays of length [`COMPARISONS`].
pub(super) mod comparison {
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
pub(super) struct Layers<V> {
    pub dynamic: Colour<V>,
    /// Static, brightness, dynamic.
    pub mask: [V; 3],
    pub dynamic_depth: V,
    pub static_: Colour<V>,
    pub static_depth: V,
}

/// The masks of a pixel.
#[derive(Clone, Copy)]
pub(super) struct Masks<V> {
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
pub(super) struct Scales<T> {
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

/// The share of each branch, and what its derivatives need.
#[derive(Clone, Copy)]
struct Shares<V> {
    dynamic: V,
    static_: V,
    /// Quotient before it is clamped, in the first stage.
    quotient: V,
    inverse: V,
    /// Sum of the probabilities before its lower bound.
    sum: V,
}

impl<S: Simd, T: Lanes> Shares<Wide<S, T>> {
    #[inline(always)]
    fn of(static_: Wide<S, T>, dynamic: Wide<S, T>, normalisation: MaskNormalisation) -> Self {
        let one = dynamic.value(1.0);
        let (dynamic, static_) = match normalisation {
            MaskNormalisation::Deformation => {
                (dynamic + dynamic.value(SHARE_GUARD), static_ + static_.value(SHARE_GUARD))
            }
            _ => (dynamic - dynamic.value(GEOMETRY_LEAN), static_ + static_.value(GEOMETRY_LEAN)),
        };
        let sum = dynamic + static_;
        if normalisation == MaskNormalisation::Geometry {
            let least = sum.value(MIN_GEOMETRY_NORMALISER);
            let inverse = one / sum.if_less(least, least, sum);
            let quotient = dynamic * inverse;
            let share = clamp(quotient, unit(quotient));
            Self { dynamic: share, static_: one - share, quotient, inverse, sum }
        } else {
            let inverse = one / sum;
            let share = dynamic * inverse;
            Self { dynamic: share, static_: static_ * inverse, quotient: share, inverse, sum }
        }
    }

    /// The cotangents of the static and the dynamic probability.
    #[inline(always)]
    fn backward(
        &self,
        v_dynamic: Wide<S, T>,
        v_static: Wide<S, T>,
        normalisation: MaskNormalisation,
    ) -> [Wide<S, T>; 2] {
        let zero = v_dynamic.value(0.0);
        let difference = v_dynamic - v_static;
        if normalisation == MaskNormalisation::Geometry {
            let v_quotient = within(self.quotient, unit(self.quotient), difference);
            let v_sum = zero - v_quotient * self.quotient * self.inverse;
            let v_sum = self.sum.if_less(self.sum.value(MIN_GEOMETRY_NORMALISER), zero, v_sum);
            [v_sum, v_quotient * self.inverse + v_sum]
        } else {
            let by_probability = difference * self.inverse;
            [zero - by_probability * self.dynamic, by_probability * self.static_]
        }
    }
}

/// The composed render and its components.
#[derive(Clone, Copy)]
pub(super) struct Blend<V> {
    /// The dynamic branch, clamped.
    pub dynamic: Colour<V>,
    /// The static branch with brightness control, clamped.
    pub lit: Colour<V>,
    /// The composed render.
    pub composed: Colour<V>,
    unclamped_dynamic: Colour<V>,
    static_: Colour<V>,
    unclamped_lit: Colour<V>,
    brightness: V,
    /// Within the valid pixels.
    mask: V,
    static_mask: V,
    shares: Shares<V>,
}

/// The cotangents of the parts of a blend.
#[derive(Clone, Copy)]
pub(super) struct BlendAdjoint<V> {
    pub dynamic: Colour<V>,
    pub lit: Colour<V>,
    pub composed: Colour<V>,
    mask: V,
    static_mask: V,
    brightness: V,
}

impl<V: Copy> BlendAdjoint<V> {
    #[inline(always)]
    fn zero(zero: V) -> Self {
        let colour = [zero; COLOUR_CHANNELS];
        Self { dynamic: colour, lit: colour, composed: colour, mask: zero, static_mask: zero, brightness: zero }
    }
}

impl<S: Simd, T: Lanes> Blend<Wide<S, T>> {
    /// Blends the layers (METHOD §1.3).
    #[inline(always)]
    pub fn of(layers: &Layers<Wide<S, T>>, valid: Wide<S, T>, normalisation: MaskNormalisation) -> Self {
        let [static_probability, control, dynamic_probability] = layers.mask;
        let shares = Shares::of(static_probability, dynamic_probability, normalisation);
        let (mask, static_mask) = (shares.dynamic * valid, shares.static_ * valid);
        let knee = control.value(BRIGHTNESS_KNEE);
        let steep = knee.if_less(control, control - knee, control.value(0.0));
        let brightness = control + steep * control.value(BRIGHTNESS_SLOPE - 1.0) + control.value(BRIGHTNESS_OFFSET);
        let none = [valid; COLOUR_CHANNELS];
        let mut blend = Self {
            dynamic: none,
            lit: none,
            composed: none,
            unclamped_dynamic: none,
            static_: none,
            unclamped_lit: none,
            brightness,
            mask,
            static_mask,
            shares,
        };
        for c in 0..COLOUR_CHANNELS {
            blend.unclamped_dynamic[c] = layers.dynamic[c] * valid;
            blend.static_[c] = layers.static_[c] * valid;
            blend.unclamped_lit[c] = blend.static_[c] * brightness;
            blend.dynamic[c] = clamp(blend.unclamped_dynamic[c], unit(valid));
            blend.lit[c] = clamp(blend.unclamped_lit[c], unit(valid));
            blend.composed[c] = mask * blend.dynamic[c] + static_mask * blend.lit[c];
        }
        blend
    }

    /// The cotangents of colours and mask; those of the depths are zero. `learns` is 0 where the colours of the static
    /// branch have no gradient.
    #[inline(always)]
    pub fn backward(
        &self,
        adjoint: &BlendAdjoint<Wide<S, T>>,
        control: Wide<S, T>,
        valid: Wide<S, T>,
        learns: Wide<S, T>,
        normalisation: MaskNormalisation,
    ) -> Layers<Wide<S, T>> {
        let zero = valid.value(0.0);
        let (mut v_mask, mut v_static_mask) = (adjoint.mask, adjoint.static_mask);
        let mut v_brightness = adjoint.brightness;
        let (mut dynamic, mut static_) = ([zero; COLOUR_CHANNELS], [zero; COLOUR_CHANNELS]);
        for c in 0..COLOUR_CHANNELS {
            let v_composed = adjoint.composed[c];
            v_mask = v_mask + v_composed * self.dynamic[c];
            v_static_mask = v_static_mask + v_composed * self.lit[c];
            let v_dynamic = adjoint.dynamic[c] + v_composed * self.mask;
            dynamic[c] = within(self.unclamped_dynamic[c], unit(valid), v_dynamic) * valid;
            let v_lit = within(self.unclamped_lit[c], unit(valid), adjoint.lit[c] + v_composed * self.static_mask);
            v_brightness = v_brightness + v_lit * self.static_[c];
            static_[c] = v_lit * self.brightness * valid * learns;
        }
        let [v_static, v_dynamic] = self.shares.backward(v_mask * valid, v_static_mask * valid, normalisation);
        let slope = v_brightness.value(BRIGHTNESS_KNEE).if_less(
            control,
            v_brightness.value(BRIGHTNESS_SLOPE),
            v_brightness.value(1.0),
        );
        let mask = [v_static, v_brightness * slope, v_dynamic];
        Layers { dynamic, mask, dynamic_depth: zero, static_, static_depth: zero }
    }

    /// Where each branch answers for the pixel: dynamic, static.
    #[inline(always)]
    fn answers(&self, masks: &Masks<Wide<S, T>>, terms: &ObjectiveTerms) -> [Wide<S, T>; 2] {
        let dynamic = if terms.dynamic_region {
            above(self.mask, DYNAMIC).max(masks.around)
        } else {
            above(self.mask, terms.dynamic_above)
        };
        [dynamic, above(self.static_mask, terms.static_above) * masks.static_region(terms)]
    }

    /// The cotangent of each comparison's map at the pixel: its weight, negative for SSIM, which is to be 1.
    #[inline(always)]
    pub fn map_cotangents(
        &self,
        masks: &Masks<Wide<S, T>>,
        terms: &ObjectiveTerms,
        scales: &Scales<T>,
    ) -> [Wide<S, T>; COMPARISONS] {
        let [dynamic, static_] = self.answers(masks, terms);
        let of = |scale: T| Wide::splat(self.mask.simd(), scale);
        let (geometry, branch) = (of(-scales.geometry_dssim), of(-scales.branch_dssim));
        let mut v_maps = [self.mask; COMPARISONS];
        v_maps[comparison::DYNAMIC] = geometry * masks.dynamic_region(terms) + branch * dynamic * masks.valid;
        v_maps[comparison::LIT] = geometry * masks.static_region(terms) + branch * static_ * masks.valid;
        v_maps[comparison::COMPOSED] = of(-scales.composed_dssim);
        v_maps[comparison::STRUCTURE] = of(scales.likeness) * above(self.mask, DYNAMIC) * masks.valid;
        v_maps
    }
}

/// The terms of a pixel except for the comparisons' maps and the variation of depth: the cost, and the cotangents of the
/// blend from both losses and of the depths.
#[derive(Clone, Copy)]
pub(super) struct PixelTerms<V> {
    pub cost: V,
    pub main: BlendAdjoint<V>,
    pub light: BlendAdjoint<V>,
    pub dynamic_depth: V,
    pub static_depth: V,
}

impl<S: Simd, T: Lanes> PixelTerms<Wide<S, T>> {
    #[inline(always)]
    pub fn of(
        blend: &Blend<Wide<S, T>>,
        layers: &Layers<Wide<S, T>>,
        photo: &Colour<Wide<S, T>>,
        masks: &Masks<Wide<S, T>>,
        terms: &ObjectiveTerms,
        scales: &Scales<T>,
    ) -> Self {
        let zero = masks.valid.value(0.0);
        let mut found = Self {
            cost: zero,
            main: BlendAdjoint::zero(zero),
            light: BlendAdjoint::zero(zero),
            dynamic_depth: zero,
            static_depth: zero,
        };
        if terms.geometry.is_some() {
            found.add_geometry(blend, photo, masks, terms, scales);
        }
        found.add_colours(blend, photo, masks, terms, scales);
        found.add_depths(blend, layers, masks, terms, scales);
        found.add_light(blend, photo, masks, terms, scales);
        found
    }

    /// Adds `scale * |value|`, and returns its derivative.
    #[inline(always)]
    fn absolute(&mut self, value: Wide<S, T>, scale: Wide<S, T>) -> Wide<S, T> {
        let slope = scale * sign(value);
        self.cost = self.cost + value * slope;
        slope
    }

    /// First stage: both branches against the photo (METHOD §4.4).
    #[inline(always)]
    fn add_geometry(
        &mut self,
        blend: &Blend<Wide<S, T>>,
        photo: &Colour<Wide<S, T>>,
        masks: &Masks<Wide<S, T>>,
        terms: &ObjectiveTerms,
        scales: &Scales<T>,
    ) {
        let scale = Wide::splat(masks.valid.simd(), scales.geometry_l1);
        let (half, darkening) = (scale.value(0.5), scale.value(GEOMETRY_DARKENING));
        let (learns, still) = (masks.dynamic_region(terms), masks.static_region(terms));
        let mean = terms.geometry.as_ref().is_some_and(|geometry| geometry.mean);
        for c in 0..COLOUR_CHANNELS {
            let (dynamic, lit) = (blend.dynamic[c], blend.lit[c]);
            let (by_dynamic, by_lit) = if mean { (half, half) } else { (blend.mask, blend.static_mask) };
            let mixed = by_dynamic * dynamic + by_lit * lit;
            let v_mixed = self.absolute(mixed * learns - photo[c] * darkening * learns, scale) * learns;
            self.main.dynamic[c] = self.main.dynamic[c] + v_mixed * by_dynamic;
            if !mean {
                self.main.mask = self.main.mask + v_mixed * dynamic;
                self.main.static_mask = self.main.static_mask + v_mixed * lit;
            }
            let v_lit = self.absolute(lit * still - photo[c] * still, scale) * still;
            self.main.lit[c] = self.main.lit[c] + v_lit;
        }
    }

    /// The composed render, and each branch where it answers (METHOD §4.4, term 5).
    #[inline(always)]
    fn add_colours(
        &mut self,
        blend: &Blend<Wide<S, T>>,
        photo: &Colour<Wide<S, T>>,
        masks: &Masks<Wide<S, T>>,
        terms: &ObjectiveTerms,
        scales: &Scales<T>,
    ) {
        let of = |scale: T| Wide::splat(masks.valid.simd(), scale);
        if terms.composed_l1 > 0.0 {
            for c in 0..COLOUR_CHANNELS {
                let slope = self.absolute(blend.composed[c] - photo[c], of(scales.composed_l1));
                self.main.composed[c] = self.main.composed[c] + slope;
            }
        }
        if terms.branch_l1 > 0.0 {
            let [dynamic, static_] = blend.answers(masks, terms);
            for c in 0..COLOUR_CHANNELS {
                let slope = self.absolute(blend.dynamic[c] * dynamic - photo[c] * dynamic, of(scales.branch_l1));
                self.main.dynamic[c] = self.main.dynamic[c] + slope * dynamic;
                let slope = self.absolute(blend.lit[c] * static_ - photo[c] * static_, of(scales.branch_l1));
                self.main.lit[c] = self.main.lit[c] + slope * static_;
            }
        }
    }

    /// The order of the branches in depth (METHOD §4.4, terms 1 and 2).
    #[inline(always)]
    fn add_depths(
        &mut self,
        blend: &Blend<Wide<S, T>>,
        layers: &Layers<Wide<S, T>>,
        masks: &Masks<Wide<S, T>>,
        terms: &ObjectiveTerms,
        scales: &Scales<T>,
    ) {
        let zero = masks.valid.value(0.0);
        let difference = (layers.dynamic_depth - layers.static_depth) / zero.value(terms.extent);
        let slope_of = |scale: T, behind: Wide<S, T>, indicator: Wide<S, T>| {
            let slope = Wide::splat(zero.simd(), scale) * indicator;
            // At equal depths, the gradient is that of the right-hand side.
            behind.if_less(zero, zero, slope)
        };
        if terms.depth_back > 0.0 {
            let indicator = above(blend.mask, SURELY_DYNAMIC) * masks.valid;
            let slope = slope_of(scales.depth_back, difference * indicator, indicator);
            self.cost = self.cost + slope * difference;
            let v_depth = slope / zero.value(terms.extent);
            self.dynamic_depth = self.dynamic_depth + v_depth;
            if !terms.depth_back_detached {
                self.static_depth = self.static_depth - v_depth;
            }
        }
        if terms.depth_forward > 0.0 {
            // Invalid pixels are in no mask, so they would count as surely static.
            let indicator = (zero.value(1.0) - above(blend.mask, SURELY_STATIC)) * masks.valid;
            let behind = zero - difference;
            let slope = slope_of(scales.depth_forward, behind * indicator, indicator);
            self.cost = self.cost + slope * behind;
            self.dynamic_depth = self.dynamic_depth - slope / zero.value(terms.extent);
        }
    }

    /// The light terms.
    #[inline(always)]
    fn add_light(
        &mut self,
        blend: &Blend<Wide<S, T>>,
        photo: &Colour<Wide<S, T>>,
        masks: &Masks<Wide<S, T>>,
        terms: &ObjectiveTerms,
        scales: &Scales<T>,
    ) {
        let of = |scale: T| Wide::splat(masks.valid.simd(), scale);
        let one = masks.valid.value(1.0);
        let slope = self.absolute((blend.brightness - one) * masks.valid, of(scales.brightness));
        self.light.brightness = self.light.brightness + slope * masks.valid;
        if terms.explicit_brightness > 0.0 {
            for c in 0..COLOUR_CHANNELS {
                let slope = self.absolute(blend.lit[c] - photo[c], of(scales.explicit_brightness));
                let v_lit = within(blend.unclamped_lit[c], unit(one), slope);
                self.light.brightness = self.light.brightness + v_lit * blend.static_[c];
            }
        }
        if terms.entropy > 0.0 {
            let (guard, scale) = (one.value(ENTROPY_GUARD), of(scales.entropy));
            let (share, rest) = (blend.mask, one - blend.mask);
            let (log_share, log_rest) = ((share + guard).map(T::ln), (rest + guard).map(T::ln));
            self.cost = self.cost - scale * (share * log_share + rest * log_rest);
            let slope = log_share + share / (share + guard) - log_rest - rest / (rest + guard);
            self.light.mask = self.light.mask - scale * slope;
        }
        if terms.mask_motion > 0.0 || terms.mask_still > 0.0 {
            let (closed, open) = (of(scales.mask_motion) * masks.moving, of(scales.mask_still) * masks.still());
            self.cost = self.cost + closed * (one - blend.mask) + open * blend.mask;
            self.light.mask = self.light.mask + (open - closed);
        }
    }
}
