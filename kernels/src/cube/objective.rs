//! The picture terms of the training objective at one pixel: blend, terms, and the way back to the renders. CPU twin:
//! `objective/pixel.rs` and `objective/cpu.rs`.
//!
//! `dynamic` is `[2, 8, H, W]` (colour, mask channels, alpha, depth), `static_` `[2, 5, H, W]` (colour, alpha, depth), the
//! photo `[3, H, W]`, each mask `[H, W]`. Both copies of a render are equal, so only the first one is read. A unit is a
//! pixel.

use cubecl::prelude::*;

use super::UNITS;
use crate::objective::*;

/// Planes of one copy of the dynamic render, and its depth plane.
const DYNAMIC_PLANES: usize = 8;
const DYNAMIC_DEPTH: usize = 7;
/// The same of the static render.
const STATIC_PLANES: usize = 5;
const STATIC_DEPTH: usize = 4;
/// Channels of a colour.
const COLOURS: usize = 3;
/// Columns of an exposure: three factors and an offset.
const EXPOSURE_COLUMNS: usize = 4;

/// Pictures that are compared with the photo by SSIM: dynamic, lit, composed.
pub const PICTURES: usize = 3;
/// Comparisons: those, and the structure term of both branches.
pub const COMPARISONS: usize = 4;
/// Sums of a cube: the loss, and the squared error.
pub const SUMS: usize = 2;

/// The normalisation of the mask.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum Normalisation {
    /// First stage.
    Geometry,
    /// First stage, unclamped.
    GeometryUnclamped,
    /// Later stages.
    Deformation,
}

/// Compile-time parameters of the kernels.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub struct ObjectiveKind {
    /// The normalisation of the mask.
    pub normalisation: Normalisation,
    /// Whether there is an exposure.
    pub exposed: bool,
    /// Whether there is each mask: valid, moving, around.
    pub masked: [bool; 3],
    /// Whether the dynamic branch learns around moving pixels.
    pub dynamic_region: bool,
    /// Whether the static branch learns only where nothing moves.
    pub static_region: bool,
    /// Whether this is the first stage.
    pub geometry: bool,
    /// Whether its mixture is the mean of both branches.
    pub geometry_mean: bool,
    /// Whether the static depth has no gradient in the order of depths.
    pub depth_back_detached: bool,
    /// Whether there is an entropy term.
    pub entropy: bool,
    /// Whether the depth must be smooth.
    pub smooth: bool,
    /// Whether pictures are compared by SSIM.
    pub similarity: bool,
    /// Whether branches are compared by the structure term.
    pub structure: bool,
    /// Whether gradients are wanted.
    pub wanted: bool,
}

/// The weights of the terms, divided by the number of values in their means.
#[derive(CubeType, CubeLaunch, Clone, Copy)]
pub struct ObjectiveWeights {
    /// L1 of the composed render.
    pub composed_l1: f32,
    /// L1 terms of the first stage.
    pub geometry_l1: f32,
    /// SSIM terms of the first stage.
    pub geometry_dssim: f32,
    /// Dynamic depth in front.
    pub depth_back: f32,
    /// Dynamic depth behind.
    pub depth_forward: f32,
    /// Depth variation to the right.
    pub smooth_right: f32,
    /// Depth variation down.
    pub smooth_down: f32,
    /// Likeness of the branches.
    pub likeness: f32,
    /// SSIM of each branch where it answers.
    pub branch_dssim: f32,
    /// L1 of each branch where it answers.
    pub branch_l1: f32,
    /// SSIM of the composed render.
    pub composed_dssim: f32,
    /// Brightness.
    pub brightness: f32,
    /// Brightened background against the photo.
    pub explicit_brightness: f32,
    /// Entropy of the mask.
    pub entropy: f32,
    /// Closed mask at moving pixels.
    pub mask_motion: f32,
    /// Open mask elsewhere.
    pub mask_still: f32,
    /// Share above which the dynamic branch answers.
    pub dynamic_above: f32,
    /// Share above which the static branch answers.
    pub static_above: f32,
    /// One over the extent.
    pub inverse_extent: f32,
}

/// The pictures that are compared, `[PICTURES, 3, H, W]`, the photo beside each of them, and the cotangents of the maps,
/// `[COMPARISONS, 3, H, W]`.
#[cube(launch_unchecked)]
pub fn objective_prepare(
    dynamic: &[f32],
    static_: &[f32],
    exposure: &[f32],
    photo: &[f32],
    valid: &[f32],
    moving: &[f32],
    around: &[f32],
    pictures: &mut [f32],
    photos: &mut [f32],
    v_maps: &mut [f32],
    weights: ObjectiveWeights,
    pixels: u32,
    #[comptime] kind: ObjectiveKind,
) {
    let at = ABSOLUTE_POS;
    let plane = pixels as usize;
    if at < plane {
        let masks = masks_at(valid, moving, around, at, kind);
        let pixel = pixel_at(dynamic, static_, exposure, &masks, at, plane, kind);
        let (dynamic_answers, static_answers) = answers(&pixel, &masks, &weights, kind);
        let v_dynamic =
            weights.geometry_dssim * masks.dynamic_region + weights.branch_dssim * dynamic_answers * masks.valid;
        let v_lit = weights.geometry_dssim * masks.static_region + weights.branch_dssim * static_answers * masks.valid;
        let v_structure = weights.likeness * above(pixel.mask, DYNAMIC as f32) * masks.valid;
        #[unroll]
        for c in 0..COLOURS {
            let (dynamic, lit) = (unit(pixel.dynamic[c]), unit(pixel.static_[c] * pixel.brightness));
            pictures[c * plane + at] = dynamic;
            pictures[comptime!(COLOURS + c) * plane + at] = lit;
            pictures[comptime!(2 * COLOURS + c) * plane + at] = pixel.mask * dynamic + pixel.static_mask * lit;
            #[unroll]
            for picture in 0..PICTURES {
                photos[comptime!(picture * COLOURS + c) * plane + at] = photo[c * plane + at];
            }
            v_maps[c * plane + at] = -v_dynamic;
            v_maps[comptime!(COLOURS + c) * plane + at] = -v_lit;
            v_maps[comptime!(2 * COLOURS + c) * plane + at] = -weights.composed_dssim;
            v_maps[comptime!(3 * COLOURS + c) * plane + at] = v_structure;
        }
    }
}

/// Each cube's loss and squared error, `sums` `[cubes, SUMS]`, and with `kind.wanted` the gradients of both renders.
///
/// `similarities` `[PICTURES, 3, H, W]` and `structures` `[3, H, W]` are the maps, `v_similar` and `v_structured` the
/// cotangents of the pictures through them. With an exposure, `v_exposed` `[6, H, W]` gets the cotangents of the exposed
/// colours of both branches, summed over the copies.
#[cube(launch_unchecked)]
pub fn objective_finish(
    dynamic: &[f32],
    static_: &[f32],
    exposure: &[f32],
    photo: &[f32],
    valid: &[f32],
    moving: &[f32],
    around: &[f32],
    v_maps: &[f32],
    similarities: &[f32],
    structures: &[f32],
    v_similar: &[f32],
    v_structured: &[f32],
    sums: &mut [f32],
    v_dynamic: &mut [f32],
    v_static: &mut [f32],
    v_exposed: &mut [f32],
    weights: ObjectiveWeights,
    height: u32,
    width: u32,
    cubes: u32,
    #[comptime] kind: ObjectiveKind,
) {
    let mut scratch = Shared::<[f32]>::new_slice(comptime!(SUMS * UNITS));
    if CUBE_POS < cubes as usize {
        let unit_index = UNIT_POS as usize;
        let at = CUBE_POS * UNITS + unit_index;
        let plane = height as usize * width as usize;
        let mut cost = 0.0f32;
        let mut squared_error = 0.0f32;
        if at < plane {
            let masks = masks_at(valid, moving, around, at, kind);
            let pixel = pixel_at(dynamic, static_, exposure, &masks, at, plane, kind);
            let mut v = no_adjoint();
            if comptime!(kind.geometry) {
                cost += add_geometry(&mut v, &pixel, photo, &masks, &weights, at, plane, kind);
            }
            cost += add_colours(&mut v, &pixel, photo, &masks, &weights, at, plane, kind);
            let depths = order_of_depths(dynamic, static_, &pixel, &masks, &weights, at, plane, kind);
            cost += depths.cost;
            let mut v_static_depth = depths.v_static;
            if comptime!(kind.smooth) {
                let varied = vary_depth(static_, photo, &weights, at, plane, height, width);
                cost += varied.cost;
                v_static_depth += varied.v_static;
            }
            cost += add_light(&mut v, &pixel, photo, &masks, &weights, at, plane, kind);
            #[unroll]
            for c in 0..COLOURS {
                if comptime!(kind.similarity) {
                    #[unroll]
                    for picture in 0..PICTURES {
                        let from = comptime!(picture * COLOURS + c) * plane + at;
                        cost += v_maps[from] * (similarities[from] - 1.0f32);
                    }
                }
                if comptime!(kind.structure) {
                    cost += v_maps[comptime!(PICTURES * COLOURS + c) * plane + at] * structures[c * plane + at];
                }
                let composed =
                    pixel.mask * unit(pixel.dynamic[c]) + pixel.static_mask * unit(pixel.static_[c] * pixel.brightness);
                let error = composed - photo[c * plane + at];
                squared_error += error * error;
                if comptime!(kind.wanted && kind.similarity) {
                    v.dynamic[c] += v_similar[c * plane + at];
                    v.lit[c] += v_similar[comptime!(COLOURS + c) * plane + at];
                    v.light_composed[c] += v_similar[comptime!(2 * COLOURS + c) * plane + at];
                }
                if comptime!(kind.wanted && kind.structure) {
                    v.dynamic[c] += v_structured[c * plane + at];
                }
            }
            if comptime!(kind.wanted) {
                write_gradients(v_dynamic, v_static, v_exposed, exposure, &v, &pixel, &masks, at, plane, kind);
                #[unroll]
                for copy in 0..2usize {
                    let keeps = comptime!(copy == 0);
                    let depth = comptime!(copy * DYNAMIC_PLANES + DYNAMIC_DEPTH) * plane + at;
                    v_dynamic[depth] = select(keeps, depths.v_dynamic, 0.0f32);
                    v_dynamic[comptime!(copy * DYNAMIC_PLANES + DYNAMIC_DEPTH - 1) * plane + at] = 0.0f32;
                    let depth = comptime!(copy * STATIC_PLANES + STATIC_DEPTH) * plane + at;
                    v_static[depth] = select(keeps, v_static_depth, 0.0f32);
                    v_static[comptime!(copy * STATIC_PLANES + STATIC_DEPTH - 1) * plane + at] = 0.0f32;
                }
            }
        }
        scratch[unit_index] = cost;
        scratch[UNITS + unit_index] = squared_error;
        sync_cube();
        let mut half = CUBE_DIM as usize / 2;
        while half > 0 {
            if unit_index < half {
                #[unroll]
                for term in 0..SUMS {
                    scratch[term * UNITS + unit_index] += scratch[term * UNITS + unit_index + half];
                }
            }
            sync_cube();
            half /= 2;
        }
        if unit_index < SUMS {
            sums[CUBE_POS * SUMS + unit_index] = scratch[unit_index * UNITS];
        }
    }
}

/// A value within `[0, 1]`; NaN stays.
#[cube]
fn unit(value: f32) -> f32 {
    select(value < 0.0f32, 0.0f32, select(value > 1.0f32, 1.0f32, value))
}

/// `passed` where `value` is not outside `[0, 1]`, 0 elsewhere.
#[cube]
fn within_unit(value: f32, passed: f32) -> f32 {
    select(value < 0.0f32, 0.0f32, select(value > 1.0f32, 0.0f32, passed))
}

/// 1 where `value` exceeds the threshold.
#[cube]
fn above(value: f32, threshold: f32) -> f32 {
    select(value > threshold, 1.0f32, 0.0f32)
}

/// The sign of a value: -1, 0 or 1.
#[cube]
fn sign(value: f32) -> f32 {
    select(value > 0.0f32, 1.0f32, select(value < 0.0f32, -1.0f32, 0.0f32))
}

/// The masks of a pixel, and where each branch learns.
#[derive(CubeType, Clone, Copy)]
struct PixelMasks {
    valid: f32,
    moving: f32,
    around: f32,
    dynamic_region: f32,
    static_region: f32,
}

#[cube]
fn masks_at(valid: &[f32], moving: &[f32], around: &[f32], at: usize, #[comptime] kind: ObjectiveKind) -> PixelMasks {
    let mut masks =
        PixelMasks { valid: 1.0f32, moving: 0.0f32, around: 0.0f32, dynamic_region: 1.0f32, static_region: 1.0f32 };
    if comptime!(kind.masked[0]) {
        masks.valid = valid[at];
    }
    if comptime!(kind.masked[1]) {
        masks.moving = moving[at];
    }
    if comptime!(kind.masked[2]) {
        masks.around = around[at];
    }
    if comptime!(kind.dynamic_region) {
        masks.dynamic_region = masks.around;
    }
    if comptime!(kind.static_region) {
        masks.static_region = masks.valid - masks.around;
    }
    masks
}

/// The layers of a pixel and the shares of the branches.
#[derive(CubeType)]
struct Pixel {
    /// Exposed colours within the valid pixels, unclamped.
    dynamic: Array<f32>,
    static_: Array<f32>,
    control: f32,
    brightness: f32,
    /// Shares within the valid pixels.
    mask: f32,
    static_mask: f32,
    /// The same before that.
    share: f32,
    static_share: f32,
    /// Quotient before it is clamped, in the first stage.
    quotient: f32,
    inverse: f32,
    /// Sum of the probabilities before its lower bound.
    sum: f32,
}

#[cube]
fn pixel_at(
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
fn answers(
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

/// The cotangents of a blend from the main loss, and from the light loss.
#[derive(CubeType)]
struct Adjoint {
    dynamic: Array<f32>,
    lit: Array<f32>,
    composed: Array<f32>,
    mask: f32,
    static_mask: f32,
    light_composed: Array<f32>,
    light_mask: f32,
    light_brightness: f32,
}

#[cube]
fn no_adjoint() -> Adjoint {
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
fn add_geometry(
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
fn add_colours(
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
struct DepthTerm {
    cost: f32,
    v_dynamic: f32,
    v_static: f32,
}

/// The order of the branches in depth.
#[cube]
fn order_of_depths(
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
fn vary_depth(
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
fn add_light(
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

/// Writes the gradients of colours and mask in both copies of both renders.
#[cube]
fn write_gradients(
    v_dynamic: &mut [f32],
    v_static: &mut [f32],
    v_exposed: &mut [f32],
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
                let (to, to_static) = (k * plane + at, comptime!(COLOURS + k) * plane + at);
                if comptime!(copy == 0) {
                    v_exposed[to] = dynamic[k];
                    v_exposed[to_static] = static_[k];
                } else {
                    v_exposed[to] += dynamic[k];
                    v_exposed[to_static] += static_[k];
                }
            }
            v_dynamic[comptime!(first + k) * plane + at] = own;
            v_static[comptime!(first_static + k) * plane + at] = other;
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
