//! The blend of the branches at one pixel, and its adjoint. CPU twin: `objective/pixel/blend.rs`.

use cubecl::prelude::*;

use super::cost::Adjoint;
use super::{
    COLOURS, DYNAMIC_PLANES, EXPOSURE_COLUMNS, Normalisation, ObjectiveKind, ObjectiveWeights, STATIC_PLANES, SUMS,
};
use crate::objective::{
    BRIGHTNESS_KNEE, BRIGHTNESS_OFFSET, BRIGHTNESS_SLOPE, DYNAMIC, GEOMETRY_LEAN, MIN_GEOMETRY_NORMALISER, SHARE_GUARD,
};

/// A value within `[0, 1]`; NaN stays.
#[cube]
pub(super) fn unit(value: f32) -> f32 {
    select(value < 0.0f32, 0.0f32, select(value > 1.0f32, 1.0f32, value))
}

/// `passed` where `value` is not outside `[0, 1]`, 0 elsewhere.
#[cube]
pub(super) fn within_unit(value: f32, passed: f32) -> f32 {
    select(value < 0.0f32, 0.0f32, select(value > 1.0f32, 0.0f32, passed))
}

/// 1 where `value` exceeds the threshold.
#[cube]
pub(super) fn above(value: f32, threshold: f32) -> f32 {
    select(value > threshold, 1.0f32, 0.0f32)
}

/// The sign of a value: -1, 0 or 1.
#[cube]
pub(super) fn sign(value: f32) -> f32 {
    select(value > 0.0f32, 1.0f32, select(value < 0.0f32, -1.0f32, 0.0f32))
}

/// The masks of a pixel, and where each branch learns.
#[derive(CubeType, Clone, Copy)]
pub struct PixelMasks {
    pub valid: f32,
    pub moving: f32,
    pub around: f32,
    pub dynamic_region: f32,
    pub static_region: f32,
}

#[cube]
pub(super) fn masks_at(
    valid: &[f32],
    moving: &[f32],
    around: &[f32],
    at: usize,
    #[comptime] kind: ObjectiveKind,
) -> PixelMasks {
    let mut is_valid = 1.0f32;
    let mut is_moving = 0.0f32;
    let mut is_around = 0.0f32;
    if comptime!(kind.masked[0]) {
        is_valid = valid[at];
    }
    if comptime!(kind.masked[1]) {
        is_moving = moving[at];
    }
    if comptime!(kind.masked[2]) {
        is_around = around[at];
    }
    masks_of(is_valid, is_moving, is_around, kind)
}

#[cube]
fn masks_of(valid: f32, moving: f32, around: f32, #[comptime] kind: ObjectiveKind) -> PixelMasks {
    let mut masks = PixelMasks { valid, moving, around, dynamic_region: 1.0f32, static_region: 1.0f32 };
    if comptime!(kind.dynamic_region) {
        masks.dynamic_region = around;
    }
    if comptime!(kind.static_region) {
        masks.static_region = valid - around;
    }
    masks
}

/// Writes the masks that there are behind the cotangents of the maps.
#[cube]
pub(super) fn keep_masks(
    prepared: &mut [f32],
    masks: &PixelMasks,
    at: usize,
    plane: usize,
    #[comptime] kind: ObjectiveKind,
) {
    if comptime!(kind.masked[0]) {
        prepared[comptime!(kind.mask_plane(0)) * plane + at] = masks.valid;
    }
    if comptime!(kind.masked[1]) {
        prepared[comptime!(kind.mask_plane(1)) * plane + at] = masks.moving;
    }
    if comptime!(kind.masked[2]) {
        prepared[comptime!(kind.mask_plane(2)) * plane + at] = masks.around;
    }
}

/// Reads what [`keep_masks()`] wrote.
#[cube]
pub(super) fn kept_masks(prepared: &[f32], at: usize, plane: usize, #[comptime] kind: ObjectiveKind) -> PixelMasks {
    let mut valid = 1.0f32;
    let mut moving = 0.0f32;
    let mut around = 0.0f32;
    if comptime!(kind.masked[0]) {
        valid = prepared[comptime!(kind.mask_plane(0)) * plane + at];
    }
    if comptime!(kind.masked[1]) {
        moving = prepared[comptime!(kind.mask_plane(1)) * plane + at];
    }
    if comptime!(kind.masked[2]) {
        around = prepared[comptime!(kind.mask_plane(2)) * plane + at];
    }
    masks_of(valid, moving, around, kind)
}

/// The layers of a pixel and the shares of the branches.
#[derive(CubeType)]
pub struct Pixel {
    /// Exposed colours within the valid pixels, unclamped.
    pub dynamic: Array<f32>,
    pub static_: Array<f32>,
    pub control: f32,
    pub brightness: f32,
    /// Shares within the valid pixels.
    pub mask: f32,
    pub static_mask: f32,
    /// The same before that.
    pub share: f32,
    pub static_share: f32,
    /// Quotient before it is clamped, in the first stage.
    pub quotient: f32,
    pub inverse: f32,
    /// Sum of the probabilities before its lower bound.
    pub sum: f32,
}

#[cube]
pub(super) fn pixel_at(
    dynamic: &[f32],
    static_: &[f32],
    exposure: &[f32],
    masks: &PixelMasks,
    at: usize,
    plane: usize,
    #[comptime] kind: ObjectiveKind,
) -> Pixel {
    let mut dynamic_colour = Array::<f32>::new(COLOURS);
    let mut static_colour = Array::<f32>::new(COLOURS);
    #[unroll]
    for c in 0..COLOURS {
        let mut own = dynamic[c * plane + at];
        let mut other = static_[c * plane + at];
        if comptime!(kind.exposed) {
            own = exposure[comptime!(c * EXPOSURE_COLUMNS + COLOURS)];
            other = exposure[comptime!(c * EXPOSURE_COLUMNS + COLOURS)];
            #[unroll]
            for k in 0..COLOURS {
                let factor = exposure[comptime!(c * EXPOSURE_COLUMNS + k)];
                own += factor * dynamic[k * plane + at];
                other += factor * static_[k * plane + at];
            }
        }
        dynamic_colour[c] = own * masks.valid;
        static_colour[c] = other * masks.valid;
    }
    let mut probability = dynamic[comptime!(COLOURS + 2) * plane + at];
    let control = dynamic[comptime!(COLOURS + 1) * plane + at];
    let mut static_probability = dynamic[COLOURS * plane + at];
    if comptime!(kind.normalisation == Normalisation::Deformation) {
        probability += SHARE_GUARD as f32;
        static_probability += SHARE_GUARD as f32;
    } else {
        probability -= GEOMETRY_LEAN as f32;
        static_probability += GEOMETRY_LEAN as f32;
    }
    let sum = probability + static_probability;
    let mut inverse = 1.0f32 / sum;
    if comptime!(kind.normalisation == Normalisation::Geometry) {
        inverse = 1.0f32 / select(sum < MIN_GEOMETRY_NORMALISER as f32, MIN_GEOMETRY_NORMALISER as f32, sum);
    }
    let quotient = probability * inverse;
    let mut share = quotient;
    let mut static_share = static_probability * inverse;
    if comptime!(kind.normalisation == Normalisation::Geometry) {
        share = unit(quotient);
        static_share = 1.0f32 - share;
    }
    let steep = select(control > BRIGHTNESS_KNEE as f32, control - BRIGHTNESS_KNEE as f32, 0.0f32);
    Pixel {
        dynamic: dynamic_colour,
        static_: static_colour,
        control,
        brightness: control + steep * ((BRIGHTNESS_SLOPE - 1.0) as f32) + BRIGHTNESS_OFFSET as f32,
        mask: share * masks.valid,
        static_mask: static_share * masks.valid,
        share,
        static_share,
        quotient,
        inverse,
        sum,
    }
}

/// Where each branch answers for the pixel: dynamic, static.
#[cube]
pub(super) fn answers(
    pixel: &Pixel,
    masks: &PixelMasks,
    weights: &ObjectiveWeights,
    #[comptime] kind: ObjectiveKind,
) -> (f32, f32) {
    let mut dynamic = above(pixel.mask, weights.dynamic_above);
    if comptime!(kind.dynamic_region) {
        dynamic = max(above(pixel.mask, DYNAMIC as f32), masks.around);
    }
    (dynamic, above(pixel.static_mask, weights.static_above) * masks.static_region)
}

/// Writes the gradients of colours and mask in both copies of both renders, and adds that of the exposure to the unit's
/// `sums`.
#[cube]
pub(super) fn write_gradients(
    v_dynamic: &mut [f32],
    v_static: &mut [f32],
    sums: &mut Array<f32>,
    rendered: &[f32],
    rendered_static: &[f32],
    exposure: &[f32],
    v: &Adjoint,
    pixel: &Pixel,
    masks: &PixelMasks,
    at: usize,
    plane: usize,
    #[comptime] kind: ObjectiveKind,
) {
    #[unroll]
    for copy in 0..2usize {
        let is_main = comptime!(copy == 0);
        let first = comptime!(copy * DYNAMIC_PLANES);
        let first_static = comptime!(copy * STATIC_PLANES);
        let mut v_mask = select(is_main, v.mask, v.light_mask);
        let mut v_static_mask = select(is_main, v.static_mask, 0.0f32);
        let mut v_brightness = select(is_main, 0.0f32, v.light_brightness);
        let mut dynamic = Array::<f32>::new(COLOURS);
        let mut static_ = Array::<f32>::new(COLOURS);
        #[unroll]
        for c in 0..COLOURS {
            let lit = pixel.static_[c] * pixel.brightness;
            let v_composed = select(is_main, v.composed[c], v.light_composed[c]);
            v_mask += v_composed * unit(pixel.dynamic[c]);
            v_static_mask += v_composed * unit(lit);
            let own = select(is_main, v.dynamic[c], 0.0f32) + v_composed * pixel.mask;
            dynamic[c] = within_unit(pixel.dynamic[c], own) * masks.valid;
            let v_lit = within_unit(lit, select(is_main, v.lit[c], 0.0f32) + v_composed * pixel.static_mask);
            v_brightness += v_lit * pixel.static_[c];
            static_[c] = v_lit * pixel.brightness * masks.valid * masks.static_region;
        }
        #[unroll]
        for k in 0..COLOURS {
            let mut own = dynamic[k];
            let mut other = static_[k];
            if comptime!(kind.exposed) {
                own = 0.0f32;
                other = 0.0f32;
                #[unroll]
                for c in 0..COLOURS {
                    let factor = exposure[comptime!(c * EXPOSURE_COLUMNS + k)];
                    own += factor * dynamic[c];
                    other += factor * static_[c];
                }
            }
            v_dynamic[comptime!(first + k) * plane + at] = own;
            v_static[comptime!(first_static + k) * plane + at] = other;
        }
        if comptime!(kind.exposed) {
            add_exposure(sums, &dynamic, rendered, at, plane);
            add_exposure(sums, &static_, rendered_static, at, plane);
        }
        let difference = (v_mask - v_static_mask) * masks.valid;
        let mut v_probability = difference * pixel.inverse * pixel.static_share;
        let mut v_static_probability = -difference * pixel.inverse * pixel.share;
        if comptime!(kind.normalisation == Normalisation::Geometry) {
            let v_quotient = within_unit(pixel.quotient, difference);
            let v_sum = -v_quotient * pixel.quotient * pixel.inverse;
            v_static_probability = select(pixel.sum < MIN_GEOMETRY_NORMALISER as f32, 0.0f32, v_sum);
            v_probability = v_quotient * pixel.inverse + v_static_probability;
        }
        let slope = select(pixel.control > BRIGHTNESS_KNEE as f32, BRIGHTNESS_SLOPE as f32, 1.0f32);
        v_dynamic[comptime!(first + COLOURS) * plane + at] = v_static_probability;
        v_dynamic[comptime!(first + COLOURS + 1) * plane + at] = v_brightness * slope;
        v_dynamic[comptime!(first + COLOURS + 2) * plane + at] = v_probability;
    }
}

/// Adds a pixel's part of the exposure's gradient, from the cotangents of its exposed colours.
#[cube]
fn add_exposure(sums: &mut Array<f32>, v_colours: &Array<f32>, rendered: &[f32], at: usize, plane: usize) {
    #[unroll]
    for c in 0..COLOURS {
        let first = comptime!(SUMS + c * EXPOSURE_COLUMNS);
        #[unroll]
        for k in 0..COLOURS {
            sums[comptime!(first + k)] += v_colours[c] * rendered[k * plane + at];
        }
        sums[comptime!(first + COLOURS)] += v_colours[c];
    }
}
