//! The picture terms of the training objective at one pixel: blend, terms, and the way back to the renders. CPU twin:
//! `objective/pixel.rs` and `objective/cpu.rs`.
//!
//! `dynamic` is `[2, 8, H, W]` (colour, mask channels, alpha, depth), `static_` `[2, 5, H, W]` (colour, alpha, depth), the
//! photo `[3, H, W]`, each mask `[H, W]`. Both copies of a render are equal, so only the first one is read. A unit is a
//! pixel.

mod blend;
mod cost;

use cubecl::prelude::*;

use self::blend::{Pixel, above, answers, keep_masks, kept_masks, masks_at, pixel_at, unit, write_gradients};
use self::cost::{Adjoint, add_colours, add_geometry, add_light, no_adjoint, order_of_depths, vary_depth};
use super::UNITS;
use crate::objective::DYNAMIC;

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
/// Numbers of an exposure, `[3, 4]`, whose gradient is summed as well where it is wanted.
const EXPOSURE: usize = COLOURS * EXPOSURE_COLUMNS;

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

impl ObjectiveKind {
    /// Planes of `prepared`: the cotangents of the comparisons' maps, and the masks that there are.
    pub fn prepared(&self) -> usize {
        self.mask_plane(self.masked.len())
    }

    /// Sums of a cube.
    pub fn sums(&self) -> usize {
        SUMS + if self.exposed && self.wanted { EXPOSURE } else { 0 }
    }

    /// Sums that a cube makes at once: half of them with an exposure, so that the scratch stays small.
    fn sums_at_once(&self) -> usize {
        if self.sums() == SUMS { SUMS } else { self.sums() / 2 }
    }

    /// The plane of `prepared` with a mask.
    fn mask_plane(&self, mask: usize) -> usize {
        COMPARISONS * COLOURS + self.masked[..mask].iter().filter(|&&is_there| is_there).count()
    }
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

/// The pictures that are compared, `[PICTURES, 3, H, W]`, the photo beside each of them, and `prepared`
/// `[planes, H, W]` (see [`ObjectiveKind::prepared`]): the cotangents of the maps, and the masks, so that
/// `objective_finish` binds fewer buffers.
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
    prepared: &mut [f32],
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
            prepared[c * plane + at] = -v_dynamic;
            prepared[comptime!(COLOURS + c) * plane + at] = -v_lit;
            prepared[comptime!(2 * COLOURS + c) * plane + at] = -weights.composed_dssim;
            prepared[comptime!(3 * COLOURS + c) * plane + at] = v_structure;
        }
        keep_masks(prepared, &masks, at, plane, kind);
    }
}

/// Each cube's loss, squared error, and part of the exposure's gradient, `sums` `[cubes, kind.sums()]`; with `kind.wanted`
/// the gradients of both renders.
///
/// `prepared` comes from `objective_prepare`. `similarities` `[PICTURES, 3, H, W]` and `structures` `[3, H, W]` are the
/// maps, `v_similar` and `v_structured` the cotangents of the pictures through them.
#[cube(launch_unchecked)]
pub fn objective_finish(
    dynamic: &[f32],
    static_: &[f32],
    exposure: &[f32],
    photo: &[f32],
    prepared: &[f32],
    similarities: &[f32],
    structures: &[f32],
    v_similar: &[f32],
    v_structured: &[f32],
    sums: &mut [f32],
    v_dynamic: &mut [f32],
    v_static: &mut [f32],
    weights: ObjectiveWeights,
    height: u32,
    width: u32,
    cubes: u32,
    #[comptime] kind: ObjectiveKind,
) {
    let at_once = comptime!(kind.sums_at_once());
    let mut scratch = Shared::<[f32]>::new_slice(comptime!(at_once * UNITS));
    if CUBE_POS < cubes as usize {
        let unit_index = UNIT_POS as usize;
        let at = CUBE_POS * UNITS + unit_index;
        let plane = height as usize * width as usize;
        let mut own = Array::<f32>::new(comptime!(kind.sums()));
        #[unroll]
        for term in 0..comptime!(kind.sums()) {
            own[term] = 0.0f32;
        }
        if at < plane {
            let mut cost = 0.0f32;
            let masks = kept_masks(prepared, at, plane, kind);
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
            cost +=
                add_comparisons(&mut v, prepared, similarities, structures, v_similar, v_structured, at, plane, kind);
            own[0] = cost;
            own[1] = squared_error_of(&pixel, photo, at, plane);
            if comptime!(kind.wanted) {
                write_gradients(
                    v_dynamic, v_static, &mut own, dynamic, static_, exposure, &v, &pixel, &masks, at, plane, kind,
                );
                write_depths(v_dynamic, v_static, depths.v_dynamic, v_static_depth, at, plane);
            }
        }
        #[unroll]
        for group in 0..comptime!(kind.sums() / at_once) {
            let first = comptime!(group * at_once);
            #[unroll]
            for term in 0..at_once {
                scratch[term * UNITS + unit_index] = own[comptime!(first + term)];
            }
            sync_cube();
            let mut half = CUBE_DIM as usize / 2;
            while half > 0 {
                if unit_index < half {
                    #[unroll]
                    for term in 0..at_once {
                        scratch[term * UNITS + unit_index] += scratch[term * UNITS + unit_index + half];
                    }
                }
                sync_cube();
                half /= 2;
            }
            if unit_index < at_once {
                sums[CUBE_POS * comptime!(kind.sums()) + first + unit_index] = scratch[unit_index * UNITS];
            }
            if comptime!(first + at_once < kind.sums()) {
                // The next group overwrites what was read.
                sync_cube();
            }
        }
    }
}

/// Adds the comparisons: their cost, which is returned, and the cotangents of their pictures.
#[cube]
fn add_comparisons(
    v: &mut Adjoint,
    prepared: &[f32],
    similarities: &[f32],
    structures: &[f32],
    v_similar: &[f32],
    v_structured: &[f32],
    at: usize,
    plane: usize,
    #[comptime] kind: ObjectiveKind,
) -> f32 {
    let mut cost = 0.0f32;
    #[unroll]
    for c in 0..COLOURS {
        if comptime!(kind.similarity) {
            #[unroll]
            for picture in 0..PICTURES {
                // A difference is 1 - S, with a negative cotangent of S.
                let from = comptime!(picture * COLOURS + c) * plane + at;
                cost += prepared[from] * (similarities[from] - 1.0f32);
            }
        }
        if comptime!(kind.structure) {
            cost += prepared[comptime!(PICTURES * COLOURS + c) * plane + at] * structures[c * plane + at];
        }
        if comptime!(kind.wanted && kind.similarity) {
            v.dynamic[c] += v_similar[c * plane + at];
            v.lit[c] += v_similar[comptime!(COLOURS + c) * plane + at];
            v.light_composed[c] += v_similar[comptime!(2 * COLOURS + c) * plane + at];
        }
        if comptime!(kind.wanted && kind.structure) {
            v.dynamic[c] += v_structured[c * plane + at];
        }
    }
    cost
}

/// The squared error of the composed render, summed over the channels.
#[cube]
fn squared_error_of(pixel: &Pixel, photo: &[f32], at: usize, plane: usize) -> f32 {
    let mut sum = 0.0f32;
    #[unroll]
    for c in 0..COLOURS {
        let lit = unit(pixel.static_[c] * pixel.brightness);
        let error = pixel.mask * unit(pixel.dynamic[c]) + pixel.static_mask * lit - photo[c * plane + at];
        sum += error * error;
    }
    sum
}

/// Writes the gradients of the depths, which only the first copy has, and zeros for alpha.
#[cube]
fn write_depths(
    v_dynamic: &mut [f32],
    v_static: &mut [f32],
    v_dynamic_depth: f32,
    v_static_depth: f32,
    at: usize,
    plane: usize,
) {
    #[unroll]
    for copy in 0..2usize {
        let is_main = comptime!(copy == 0);
        let (first, first_static) = (comptime!(copy * DYNAMIC_PLANES), comptime!(copy * STATIC_PLANES));
        v_dynamic[comptime!(first + DYNAMIC_DEPTH) * plane + at] = select(is_main, v_dynamic_depth, 0.0f32);
        v_dynamic[comptime!(first + DYNAMIC_DEPTH - 1) * plane + at] = 0.0f32;
        v_static[comptime!(first_static + STATIC_DEPTH) * plane + at] = select(is_main, v_static_depth, 0.0f32);
        v_static[comptime!(first_static + STATIC_DEPTH - 1) * plane + at] = 0.0f32;
    }
}
