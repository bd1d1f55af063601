//! The terms of the objective at one pixel, with their cotangents (METHOD §4.4).
#![allow(clippy::needless_range_loop, reason = "loops over channels of several arrays are unrolled as they are")]

use mvfusion_kernels::objective::{ENTROPY_GUARD, GEOMETRY_DARKENING, SURELY_DYNAMIC, SURELY_STATIC};
use mvfusion_kernels::splat::COLOUR_CHANNELS;
use pulp::Simd;

use super::super::ObjectiveTerms;
use super::{Blend, BlendAdjoint, Colour, Layers, Masks, Scales, above, sign, unit, within};
use crate::simd::{Lanes, Wide};

/// The slope of a cost of being behind: nothing in front. At equal depths, it is that behind.
#[inline(always)]
fn slope_behind<S: Simd, T: Lanes>(behind: Wide<S, T>, slope: Wide<S, T>) -> Wide<S, T> {
    let zero = behind.value(0.0);
    behind.if_less(zero, zero, slope)
}

/// The terms of a pixel except for the comparisons' maps and the variation of depth: the cost, and the cotangents of the
/// blend from both losses and of the depths.
#[derive(Clone, Copy)]
pub struct PixelTerms<V> {
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
        let scale = masks.valid.scalar(scales.geometry_l1);
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
        let like = masks.valid;
        if terms.composed_l1 > 0.0 {
            for c in 0..COLOUR_CHANNELS {
                let slope = self.absolute(blend.composed[c] - photo[c], like.scalar(scales.composed_l1));
                self.main.composed[c] = self.main.composed[c] + slope;
            }
        }
        if terms.branch_l1 > 0.0 {
            let [dynamic, static_] = blend.answers(masks, terms);
            for c in 0..COLOUR_CHANNELS {
                let slope =
                    self.absolute(blend.dynamic[c] * dynamic - photo[c] * dynamic, like.scalar(scales.branch_l1));
                self.main.dynamic[c] = self.main.dynamic[c] + slope * dynamic;
                let slope = self.absolute(blend.lit[c] * static_ - photo[c] * static_, like.scalar(scales.branch_l1));
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
        if terms.depth_back > 0.0 {
            let indicator = above(blend.mask, SURELY_DYNAMIC) * masks.valid;
            let slope = slope_behind(difference * indicator, zero.scalar(scales.depth_back) * indicator);
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
            let slope = slope_behind(behind * indicator, zero.scalar(scales.depth_forward) * indicator);
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
        let (like, one) = (masks.valid, masks.valid.value(1.0));
        let slope = self.absolute((blend.brightness - one) * masks.valid, like.scalar(scales.brightness));
        self.light.brightness = self.light.brightness + slope * masks.valid;
        if terms.explicit_brightness > 0.0 {
            for c in 0..COLOUR_CHANNELS {
                let slope = self.absolute(blend.lit[c] - photo[c], like.scalar(scales.explicit_brightness));
                let v_lit = within(blend.unclamped_lit[c], unit(one), slope);
                self.light.brightness = self.light.brightness + v_lit * blend.static_[c];
            }
        }
        if terms.entropy > 0.0 {
            let (guard, scale) = (one.value(ENTROPY_GUARD), like.scalar(scales.entropy));
            let (share, rest) = (blend.mask, one - blend.mask);
            let (log_share, log_rest) = ((share + guard).ln(), (rest + guard).ln());
            self.cost = self.cost - scale * (share * log_share + rest * log_rest);
            let slope = log_share + share / (share + guard) - log_rest - rest / (rest + guard);
            self.light.mask = self.light.mask - scale * slope;
        }
        if terms.mask_motion > 0.0 || terms.mask_still > 0.0 {
            let (closed, open) =
                (like.scalar(scales.mask_motion) * masks.moving, like.scalar(scales.mask_still) * masks.still());
            self.cost = self.cost + closed * (one - blend.mask) + open * blend.mask;
            self.light.mask = self.light.mask + (open - closed);
        }
    }
}
