//! Gradients of blending: each tile back to front, one record per Gaussian of the tile. CPU twin:
//! `splat/cpu/blend_backward.rs`.
//!
//! A cube processes a tile, one batch of Gaussians at a time. A batch has three phases between barriers. First, a unit
//! is a few neighbouring pixels: it removes the batch's Gaussians from their transmittance, one after another, and sums
//! each Gaussian's part of the cotangents. Then a unit is four of a Gaussian's values, which it sums down a column of
//! units. Finally, a unit is a Gaussian and writes its record. There are no atomics, so every sum has a fixed order.
//! `project_backward` later sums a Gaussian's records in the order of its tiles.

use cubecl::prelude::*;

use super::backward_kind::{BlendBackwardKind, MIDDLE, POWERS, SUM_CHANNELS, SUM_ONE, SUM_X, SUM_XX, record_vectors};
use super::maths::constant;
use super::moments::write_records;
use super::stage::{
    FOUR, Four, GPU_SPAN, Staged, TileShare, UnitPixels, WORD, four_of, in_picture, in_tiles, is_inside, met_by_row,
    stage_batch, staged_at, unit_pixels,
};
use super::tiles::tiles_along;
use super::view::BlendRules;
use crate::splat::{MIN_ALPHA, alpha_plane, background_channels, plane_count, plane_of_channel};

/// Gradients of `blend`, whose arguments come first; `v_picture` has the shape of its `picture`.
///
/// `gradients` has a row of [`record_vectors`] for each entry of the tile lists. `v_background` `[tiles, channels - 1]`
/// has each tile's part.
#[cube(launch_unchecked)]
pub fn blend_backward(
    records: &[f32],
    features: &[f32],
    background: &[f32],
    sorted: &[i32],
    starts: &[i32],
    transmittance: &[f32],
    last: &[i32],
    v_picture: &[f32],
    gradients: &mut [Four],
    v_background: &mut [f32],
    width: u32,
    height: u32,
    rules: BlendRules,
    #[comptime] kind: BlendBackwardKind,
) {
    let share = comptime!(kind.share);
    let mut staged = Shared::<[Four]>::new_slice(comptime!(kind.share.batch * kind.share.vectors()));
    let mut rows = Shared::<[u32]>::new_slice(comptime!(kind.share.batch));
    let mut parts = Shared::<[Four]>::new_slice(comptime!(kind.parts()));
    let mut totals = Shared::<[Four]>::new_slice(comptime!(kind.totals()));
    let mut lasts = Shared::<[u32]>::new_slice(comptime!(kind.share.units()));
    let pixels = unit_pixels(width, share);
    if pixels.tile < tiles_along(width) * tiles_along(height) {
        let mut taken = nothing_taken(&pixels, transmittance, last, v_picture, background, width, height, kind);
        sum_background(&taken, pixels.tile, &mut parts, v_background, kind);
        let used = largest_of_units(largest_last(&taken, share), &mut lasts);

        let begin = starts[pixels.tile as usize] as u32;
        // First, so that no register keeps the end of the list meanwhile.
        write_zeros(gradients, begin + used, starts[pixels.tile as usize + 1] as u32, kind);
        let batch = comptime!(kind.share.batch as u32);
        let batches = (used + (batch - 1u32)) / batch;
        for turn in 0..batches {
            let first = (batches - 1u32 - turn) * batch;
            let count = min(used - first, batch);
            stage_batch(records, features, sorted, begin + first, count, &pixels, &mut staged, &mut rows, share);
            sync_cube();
            let mut met = met_by_row(&rows, 0u32, count, pixels.row);
            while met != 0u32 {
                let k = comptime!(WORD as u32 - 1) - met.leading_zeros();
                met ^= 1u32 << k;
                let splat = staged_at(&staged, k, &pixels, share);
                let sums =
                    composite_backward(&mut taken, &splat, i32::cast_from(first + k), pixels.column, &rules, kind);
                write_parts(&sums, k as usize, &mut parts, kind);
            }
            sync_cube();
            sum_over_rows(&parts, &rows, count as usize, &mut totals, kind);
            sync_cube();
            write_records(&staged, &totals, count, begin + first, gradients, kind);
            sync_cube();
        }
    }
}

/// The state of a unit's pixels while Gaussians are removed from them, the last one first.
#[derive(CubeType)]
struct Taken {
    /// The cotangents of each pixel's channels, summed over both images.
    both: Array<f32>,
    /// The cotangents of the first image; some of its channels enter the statistic.
    main: Array<f32>,
    /// The transmittance in front of the removed Gaussians.
    transmittance: Array<f32>,
    /// One plus the position of the pixel's last Gaussian in the tile's list.
    last: Array<i32>,
    /// The removed Gaussians and the background, times the cotangents.
    behind: Array<f32>,
    /// The same for the channels that enter the statistic.
    behind_counted: Array<f32>,
}

/// The unit's pixels before any Gaussian is removed.
#[cube]
fn nothing_taken(
    pixels: &UnitPixels,
    transmittance: &[f32],
    last: &[i32],
    v_picture: &[f32],
    background: &[f32],
    width: u32,
    height: u32,
    #[comptime] kind: BlendBackwardKind,
) -> Taken {
    let (channels, span) = comptime!((kind.share.channels, kind.share.span));
    let mut both = Array::<f32>::new(comptime!(span * channels));
    let mut main = Array::<f32>::new(comptime!(span * channels));
    let mut left = Array::<f32>::new(span);
    let mut lasts = Array::<i32>::new(span);
    let mut behind = Array::<f32>::new(span);
    let mut behind_counted = Array::<f32>::new(span);
    let plane = (width * height) as usize;
    #[unroll]
    for p in 0..span {
        let pixel = in_picture(pixels, p, width);
        let inside = is_inside(pixels, p, width, height);
        left[p] = transmittance[in_tiles(pixels, p)];
        lasts[p] = last[in_tiles(pixels, p)];
        // Alpha is one minus the transmittance, which is also the weight of the background.
        let mut v_alpha = 0.0f32;
        let mut v_alpha_main = 0.0f32;
        if inside {
            v_alpha_main = v_picture[comptime!(alpha_plane(channels)) * plane + pixel];
            v_alpha =
                v_alpha_main + v_picture[comptime!(alpha_plane(channels) + plane_count(channels)) * plane + pixel];
        }
        let mut shade = -v_alpha;
        let mut shade_counted = -v_alpha_main;
        #[unroll]
        for channel in 0..channels {
            let from = comptime!(plane_of_channel(channel, channels));
            let mut first = 0.0f32;
            let mut second = 0.0f32;
            if inside {
                first = v_picture[from * plane + pixel];
                second = v_picture[comptime!(from + plane_count(channels)) * plane + pixel];
            }
            both[comptime!(p * channels + channel)] = first + second;
            main[comptime!(p * channels + channel)] = first;
            if comptime!(channel < background_channels(channels)) {
                shade += (first + second) * background[channel];
                if comptime!(kind.counts(channel)) {
                    shade_counted += first * background[channel];
                }
            }
        }
        behind[p] = shade * left[p];
        behind_counted[p] = shade_counted * left[p];
    }
    Taken { both, main, transmittance: left, last: lasts, behind, behind_counted }
}

/// The tile's part of the background's gradient, summed over each unit's pixels and then over the units. Every unit of
/// the cube must call this.
#[cube]
fn sum_background(
    taken: &Taken,
    tile: u32,
    parts: &mut Shared<[Four]>,
    v_background: &mut [f32],
    #[comptime] kind: BlendBackwardKind,
) {
    let channels = comptime!(kind.share.channels);
    let count = comptime!(background_channels(kind.share.channels));
    let units = comptime!(kind.share.units());
    let unit = UNIT_POS as usize;
    #[unroll]
    for vector in 0..comptime!(count.div_ceil(FOUR)) {
        let mut sums = Four::new(0.0f32);
        #[unroll]
        for part in 0..comptime!((count - FOUR * vector).min(FOUR)) {
            let mut sum = 0.0f32;
            #[unroll]
            for p in 0..kind.share.span {
                sum += taken.both[comptime!(p * channels + FOUR * vector + part)] * taken.transmittance[p];
            }
            sums.insert(part, sum);
        }
        parts[comptime!(vector * units) + unit] = sums;
    }
    sync_cube();
    let mut vector = unit;
    while vector < comptime!(count.div_ceil(FOUR)) {
        let mut sums = Four::new(0.0f32);
        for other in 0..units {
            sums += parts[vector * units + other];
        }
        #[unroll]
        for part in 0..FOUR {
            let channel = FOUR * vector + part;
            if channel < count {
                v_background[tile as usize * count + channel] = sums.extract(part);
            }
        }
        vector += units;
    }
    sync_cube();
}

/// The largest `last` of the unit's pixels.
#[cube]
fn largest_last(taken: &Taken, #[comptime] share: TileShare) -> u32 {
    let mut largest = 0i32;
    #[unroll]
    for p in 0..share.span {
        largest = max(largest, taken.last[p]);
    }
    u32::cast_from(largest)
}

/// Removes a Gaussian, whose position in the tile's list is `place`, from the unit's pixels. Returns its part of the
/// cotangents, summed over the pixels: sigma's part times 1, x and x² (x from the tile's middle), the channels, and the
/// statistic's part times 1 and x.
#[cube]
fn composite_backward(
    taken: &mut Taken,
    splat: &Staged,
    place: i32,
    column: u32,
    rules: &BlendRules,
    #[comptime] kind: BlendBackwardKind,
) -> Array<f32> {
    let channels = comptime!(kind.share.channels);
    let from_middle = f32::cast_from(column) - constant(MIDDLE);
    let mut sums = Array::<f32>::new(comptime!(FOUR * kind.sums()));
    #[unroll]
    for i in 0..comptime!(FOUR * kind.sums()) {
        sums[i] = 0.0f32;
    }
    #[unroll]
    for p in 0..kind.share.span {
        let u = splat.u + comptime!(p as f32);
        let sigma = splat.half_x * u * u + splat.row_sigma;
        let falloff = (-sigma).exp();
        let raw = splat.opacity * falloff;
        let clamped = min(raw, rules.alpha_clamp);
        let added = clamped >= constant(MIN_ALPHA) && place < taken.last[p];
        let alpha = select(added, clamped, 0.0f32);
        let gate = select(added && raw <= rules.gradient_clamp, falloff, 0.0f32);
        let inverse = inverse_of(1.0f32 - alpha, kind.share);
        let before = taken.transmittance[p] * inverse;
        let weight = alpha * before;
        let mut shade = 0.0f32;
        #[unroll]
        for channel in 0..channels {
            let v = taken.both[comptime!(p * channels + channel)];
            shade += v * splat.values[channel];
            sums[comptime!(SUM_CHANNELS + channel)] += weight * v;
        }
        let part = gate * (before * shade - taken.behind[p] * inverse);
        let x = from_middle + comptime!(p as f32);
        sums[SUM_ONE] += part;
        sums[SUM_X] += part * x;
        sums[SUM_XX] += part * x * x;
        taken.behind[p] += weight * shade;
        if comptime!(kind.statistic.is_some()) {
            let mut shade = 0.0f32;
            #[unroll]
            for channel in 0..channels {
                if comptime!(kind.counts(channel)) {
                    shade += taken.main[comptime!(p * channels + channel)] * splat.values[channel];
                }
            }
            let part = gate * (before * shade - taken.behind_counted[p] * inverse);
            sums[comptime!(kind.counted_one())] += part;
            sums[comptime!(kind.counted_x())] += part * x;
            taken.behind_counted[p] += weight * shade;
        }
        taken.transmittance[p] = before;
    }
    sums
}

/// One over a positive number up to one. CUDA divides with a branch, which would keep the pixels of a unit from being
/// computed together on a GPU. A root has none, and a step of Newton's method makes up for its error.
#[cube]
fn inverse_of(x: f32, #[comptime] share: TileShare) -> f32 {
    if comptime!(share.span > GPU_SPAN) {
        1.0f32 / x
    } else {
        let root = x.inverse_sqrt();
        let about = root * root;
        about * (2.0f32 - x * about)
    }
}

/// Writes a unit's sums of Gaussian `k` of a batch to shared memory.
#[cube]
fn write_parts(sums: &Array<f32>, k: usize, parts: &mut Shared<[Four]>, #[comptime] kind: BlendBackwardKind) {
    let at = (k * comptime!(kind.share.units()) + UNIT_POS as usize) * comptime!(kind.sums());
    #[unroll]
    for vector in 0..comptime!(kind.sums()) {
        parts[at + vector] = four_of(sums, vector);
    }
}

/// Sums the units' parts of a batch over the rows of the tile, times 1, y and y². A unit is four of a Gaussian's values in
/// the columns of one span, so that most units have one.
#[cube]
fn sum_over_rows(
    parts: &Shared<[Four]>,
    rows: &Shared<[u32]>,
    count: usize,
    totals: &mut Shared<[Four]>,
    #[comptime] kind: BlendBackwardKind,
) {
    let (units, spans) = comptime!((kind.share.units(), kind.share.spans()));
    let vectors = comptime!(kind.sums());
    let mut task = UNIT_POS as usize;
    while task < count * comptime!(spans * vectors) {
        let (k, in_row) = (task / comptime!(spans * vectors), task % comptime!(spans * vectors));
        let met = rows[k];
        let mut once = Four::new(0.0f32);
        let mut by_y = Four::new(0.0f32);
        let mut by_yy = Four::new(0.0f32);
        for row in met.trailing_zeros()..comptime!(WORD as u32) - met.leading_zeros() {
            let y = Four::new(f32::cast_from(row) - constant(MIDDLE));
            let four = parts[(k * units + row as usize * spans) * vectors + in_row];
            once += four;
            by_y += four * y;
            by_yy += four * y * y;
        }
        totals[POWERS * task] = once;
        totals[POWERS * task + 1] = by_y;
        totals[POWERS * task + 2] = by_yy;
        task += units;
    }
}

/// Writes zero records from `first` up to `end`, for Gaussians that no pixel blended.
#[cube]
fn write_zeros(gradients: &mut [Four], first: u32, end: u32, #[comptime] kind: BlendBackwardKind) {
    let length = comptime!(record_vectors(kind.share.channels));
    let mut at = first as usize * length + UNIT_POS as usize;
    while at < end as usize * length {
        gradients[at] = Four::new(0.0f32);
        at += comptime!(kind.share.units());
    }
}

/// The largest of the units' values, by a uniform load, because barriers depend on it. Every unit of the cube must call
/// this.
#[cube]
fn largest_of_units(number: u32, numbers: &mut Shared<[u32]>) -> u32 {
    let unit = UNIT_POS as usize;
    numbers[unit] = number;
    let mut half = CUBE_DIM as usize / 2;
    while half > 0 {
        sync_cube();
        if unit < half {
            numbers[unit] = max(numbers[unit], numbers[unit + half]);
        }
        half /= 2;
    }
    workgroup_uniform_load(&numbers[0])
}
