//! The blend of the branches, and its adjoint (METHOD §1.3).
#![allow(clippy::needless_range_loop, reason = "loops over channels of several arrays are unrolled as they are")]

use mvfusion_kernels::objective::{
    BRIGHTNESS_KNEE, BRIGHTNESS_OFFSET, BRIGHTNESS_SLOPE, DYNAMIC, GEOMETRY_LEAN, MIN_GEOMETRY_NORMALISER, SHARE_GUARD,
};
use mvfusion_kernels::splat::COLOUR_CHANNELS;
use pulp::Simd;

use super::super::{MaskNormalisation, ObjectiveTerms};
use super::{COMPARISONS, Colour, Layers, Masks, Scales, above, clamp, comparison, unit, within};
use crate::simd::{Lanes, Wide};

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
pub struct Blend<V> {
    /// The dynamic branch, clamped.
    pub dynamic: Colour<V>,
    /// The static branch with brightness control, clamped.
    pub lit: Colour<V>,
    /// The composed render.
    pub composed: Colour<V>,
    unclamped_dynamic: Colour<V>,
    pub(super) static_: Colour<V>,
    pub(super) unclamped_lit: Colour<V>,
    pub(super) brightness: V,
    /// Within the valid pixels.
    pub(super) mask: V,
    pub(super) static_mask: V,
    shares: Shares<V>,
}

/// The cotangents of the parts of a blend.
#[derive(Clone, Copy)]
pub struct BlendAdjoint<V> {
    pub dynamic: Colour<V>,
    pub lit: Colour<V>,
    pub composed: Colour<V>,
    pub(super) mask: V,
    pub(super) static_mask: V,
    pub(super) brightness: V,
}

impl<V: Copy> BlendAdjoint<V> {
    #[inline(always)]
    pub(super) fn zero(zero: V) -> Self {
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
    pub(super) fn answers(&self, masks: &Masks<Wide<S, T>>, terms: &ObjectiveTerms) -> [Wide<S, T>; 2] {
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
        let like = self.mask;
        let (geometry, branch) = (like.scalar(-scales.geometry_dssim), like.scalar(-scales.branch_dssim));
        let mut v_maps = [self.mask; COMPARISONS];
        v_maps[comparison::DYNAMIC] = geometry * masks.dynamic_region(terms) + branch * dynamic * masks.valid;
        v_maps[comparison::LIT] = geometry * masks.static_region(terms) + branch * static_ * masks.valid;
        v_maps[comparison::COMPOSED] = like.scalar(-scales.composed_dssim);
        v_maps[comparison::STRUCTURE] = like.scalar(scales.likeness) * above(self.mask, DYNAMIC) * masks.valid;
        v_maps
    }
}
