//! The terms of the objective at one pixel, with their cotangents. CPU twin: `objective/pixel/cost.rs`.

use cubecl::prelude::*;

use super::blend::{Pixel, PixelMasks, above, answers, sign, unit, within_unit};
use super::{COLOURS, DYNAMIC_DEPTH, ObjectiveKind, ObjectiveWeights, STATIC_DEPTH};
use crate::objective::{ENTROPY_GUARD, GEOMETRY_DARKENING, SURELY_DYNAMIC, SURELY_STATIC};

/// The cotangents of a blend from the main loss, and from the light loss.
#[derive(CubeType)]
pub struct Adjoint {
    pub dynamic: Array<f32>,
    pub lit: Array<f32>,
    pub composed: Array<f32>,
    pub mask: f32,
    pub static_mask: f32,
    pub light_composed: Array<f32>,
    pub light_mask: f32,
    pub light_brightness: f32,
}

#[cube]
pub(super) fn no_adjoint() -> Adjoint {
    let mut adjoint = Adjoint {
        dynamic: Array::<f32>::new(COLOURS),
        lit: Array::<f32>::new(COLOURS),
        composed: Array::<f32>::new(COLOURS),
        mask: 0.0f32,
        static_mask: 0.0f32,
        light_composed: Array::<f32>::new(COLOURS),
        light_mask: 0.0f32,
        light_brightness: 0.0f32,
    };
    #[unroll]
    for c in 0..COLOURS {
        adjoint.dynamic[c] = 0.0f32;
        adjoint.lit[c] = 0.0f32;
        adjoint.composed[c] = 0.0f32;
        adjoint.light_composed[c] = 0.0f32;
    }
    adjoint
}

/// First stage: both branches against the photo. Returns the cost.
#[cube]
pub(super) fn add_geometry(
    v: &mut Adjoint,
    pixel: &Pixel,
    photo: &[f32],
    masks: &PixelMasks,
    weights: &ObjectiveWeights,
    at: usize,
    plane: usize,
    #[comptime] kind: ObjectiveKind,
) -> f32 {
    let mut cost = 0.0f32;
    let (learns, still) = (masks.dynamic_region, masks.static_region);
    let mut by_dynamic = 0.5f32;
    let mut by_lit = 0.5f32;
    if comptime!(!kind.geometry_mean) {
        by_dynamic = pixel.mask;
        by_lit = pixel.static_mask;
    }
    #[unroll]
    for c in 0..COLOURS {
        let shown = photo[c * plane + at];
        let (dynamic, lit) = (unit(pixel.dynamic[c]), unit(pixel.static_[c] * pixel.brightness));
        let mixed = by_dynamic * dynamic + by_lit * lit;
        let error = mixed * learns - shown * (GEOMETRY_DARKENING as f32) * learns;
        let v_mixed = weights.geometry_l1 * sign(error) * learns;
        cost += weights.geometry_l1 * error.abs();
        v.dynamic[c] += v_mixed * by_dynamic;
        if comptime!(!kind.geometry_mean) {
            v.mask += v_mixed * dynamic;
            v.static_mask += v_mixed * lit;
        }
        let error = lit * still - shown * still;
        cost += weights.geometry_l1 * error.abs();
        v.lit[c] += weights.geometry_l1 * sign(error) * still;
    }
    cost
}

/// The composed render, and each branch where it answers. Returns the cost.
#[cube]
pub(super) fn add_colours(
    v: &mut Adjoint,
    pixel: &Pixel,
    photo: &[f32],
    masks: &PixelMasks,
    weights: &ObjectiveWeights,
    at: usize,
    plane: usize,
    #[comptime] kind: ObjectiveKind,
) -> f32 {
    let mut cost = 0.0f32;
    let (dynamic_answers, static_answers) = answers(pixel, masks, weights, kind);
    #[unroll]
    for c in 0..COLOURS {
        let shown = photo[c * plane + at];
        let (dynamic, lit) = (unit(pixel.dynamic[c]), unit(pixel.static_[c] * pixel.brightness));
        let error = pixel.mask * dynamic + pixel.static_mask * lit - shown;
        cost += weights.composed_l1 * error.abs();
        v.composed[c] += weights.composed_l1 * sign(error);
        let error = dynamic * dynamic_answers - shown * dynamic_answers;
        cost += weights.branch_l1 * error.abs();
        v.dynamic[c] += weights.branch_l1 * sign(error) * dynamic_answers;
        let error = lit * static_answers - shown * static_answers;
        cost += weights.branch_l1 * error.abs();
        v.lit[c] += weights.branch_l1 * sign(error) * static_answers;
    }
    cost
}

/// A term of the depths.
#[derive(CubeType, Clone, Copy)]
pub struct DepthTerm {
    pub cost: f32,
    pub v_dynamic: f32,
    pub v_static: f32,
}

/// The order of the branches in depth.
#[cube]
pub(super) fn order_of_depths(
    dynamic: &[f32],
    static_: &[f32],
    pixel: &Pixel,
    masks: &PixelMasks,
    weights: &ObjectiveWeights,
    at: usize,
    plane: usize,
    #[comptime] kind: ObjectiveKind,
) -> DepthTerm {
    let front = dynamic[DYNAMIC_DEPTH * plane + at];
    let difference = (front - static_[STATIC_DEPTH * plane + at]) * weights.inverse_extent;
    let indicator = above(pixel.mask, SURELY_DYNAMIC as f32) * masks.valid;
    let back = select(difference * indicator < 0.0f32, 0.0f32, weights.depth_back * indicator);
    // Invalid pixels are in no mask, so they would count as surely static.
    let indicator = (1.0f32 - above(pixel.mask, SURELY_STATIC as f32)) * masks.valid;
    let forward = select(-difference * indicator < 0.0f32, 0.0f32, weights.depth_forward * indicator);
    let mut v_static = 0.0f32;
    if comptime!(!kind.depth_back_detached) {
        v_static = -back * weights.inverse_extent;
    }
    DepthTerm { cost: (back - forward) * difference, v_dynamic: (back - forward) * weights.inverse_extent, v_static }
}

/// The variation of the static depth between a pixel and its neighbours. A difference costs at its left or upper pixel.
#[cube]
pub(super) fn vary_depth(
    static_: &[f32],
    photo: &[f32],
    weights: &ObjectiveWeights,
    at: usize,
    plane: usize,
    height: u32,
    width: u32,
) -> DepthTerm {
    let (row, column) = (at as u32 / width, at as u32 % width);
    let step = width as usize;
    let mut cost = 0.0f32;
    let mut v_static = 0.0f32;
    if column + 1u32 < width {
        let difference = depth_step(static_, at, at + 1, plane);
        let v = weights.smooth_right * edge(photo, at, at + 1, plane) * sign(difference);
        cost += v * difference;
        v_static -= v;
    }
    if row + 1u32 < height {
        let difference = depth_step(static_, at, at + step, plane);
        let v = weights.smooth_down * edge(photo, at, at + step, plane) * sign(difference);
        cost += v * difference;
        v_static -= v;
    }
    if column > 0u32 {
        v_static +=
            weights.smooth_right * edge(photo, at - 1, at, plane) * sign(depth_step(static_, at - 1, at, plane));
    }
    if row > 0u32 {
        v_static +=
            weights.smooth_down * edge(photo, at - step, at, plane) * sign(depth_step(static_, at - step, at, plane));
    }
    DepthTerm { cost, v_dynamic: 0.0f32, v_static }
}

#[cube]
fn depth_step(static_: &[f32], from: usize, to: usize, plane: usize) -> f32 {
    static_[STATIC_DEPTH * plane + to] - static_[STATIC_DEPTH * plane + from]
}

/// The weight of a difference of depths by the photo's difference there.
#[cube]
fn edge(photo: &[f32], from: usize, to: usize, plane: usize) -> f32 {
    let mut difference = 0.0f32;
    #[unroll]
    for c in 0..COLOURS {
        difference += (photo[c * plane + to] - photo[c * plane + from]).abs();
    }
    (-difference / 3.0f32).exp()
}

/// The light terms. Returns the cost.
#[cube]
pub(super) fn add_light(
    v: &mut Adjoint,
    pixel: &Pixel,
    photo: &[f32],
    masks: &PixelMasks,
    weights: &ObjectiveWeights,
    at: usize,
    plane: usize,
    #[comptime] kind: ObjectiveKind,
) -> f32 {
    let away = (pixel.brightness - 1.0f32) * masks.valid;
    let mut cost = weights.brightness * away.abs();
    v.light_brightness += weights.brightness * sign(away) * masks.valid;
    #[unroll]
    for c in 0..COLOURS {
        let unclamped = pixel.static_[c] * pixel.brightness;
        let error = unit(unclamped) - photo[c * plane + at];
        cost += weights.explicit_brightness * error.abs();
        let v_lit = within_unit(unclamped, weights.explicit_brightness * sign(error));
        v.light_brightness += v_lit * pixel.static_[c];
    }
    let still = masks.valid - masks.around;
    let (closed, open) = (weights.mask_motion * masks.moving, weights.mask_still * still);
    cost += closed * (1.0f32 - pixel.mask) + open * pixel.mask;
    v.light_mask += open - closed;
    if comptime!(kind.entropy) {
        let (share, rest) = (pixel.mask, 1.0f32 - pixel.mask);
        let (guarded, guarded_rest) = (share + ENTROPY_GUARD as f32, rest + ENTROPY_GUARD as f32);
        let (log_share, log_rest) = (guarded.ln(), guarded_rest.ln());
        cost -= weights.entropy * (share * log_share + rest * log_rest);
        v.light_mask -= weights.entropy * (log_share + share / guarded - log_rest - rest / guarded_rest);
    }
    cost
}
