//! Blending of the Gaussians of each tile, front to back. A cube is one tile. CPU twin: `splat/cpu/blend.rs`.

use cubecl::prelude::*;

use super::maths::constant;
use super::stage::{
    Four, GPU_SPAN, Staged, TileShare, UnitPixels, WORD, in_picture, in_tiles, is_inside, met_by_row, stage_batch,
    staged_at, unit_pixels,
};
use super::tiles::tiles_along;
use super::view::BlendRules;
use crate::splat::{MIN_ALPHA, alpha_plane, background_channels, plane_count, plane_of_channel};

impl TileShare {
    /// The largest batch for blending on a device with `memory` bytes of shared memory per cube; `None` if even the
    /// smallest does not fit.
    pub fn fitting(span: usize, channels: usize, memory: usize) -> Option<Self> {
        [4 * WORD, 2 * WORD, WORD, WORD / 4]
            .into_iter()
            .map(|batch| Self { span, channels, batch })
            .find(|share| share.bytes() + 3 * size_of::<u32>() <= memory)
    }

    /// Gaussians that a unit blends per iteration. A software driver, whose units have many pixels, copies the sums of
    /// all of them from one iteration to the next. On a GPU, a second Gaussian costs registers.
    const fn at_once(&self) -> usize {
        if self.span > GPU_SPAN { 2 } else { 1 }
    }
}

/// Blends an image of `channels` channels: colour, features, depth.
///
/// `records` come from `project`; `features` is `[N, F]` and `background` `[channels - 1]`. `sorted` lists the
/// Gaussians of all tiles, and `starts` `[tiles + 1]` has the start of each tile's list. `picture` is
/// `[2, channels + 1, height, width]` (alpha before depth, both copies equal). `transmittance` and `last` are
/// `[tiles, TILE_PIXELS]`.
#[cube(launch_unchecked)]
pub fn blend(
    records: &[f32],
    features: &[f32],
    background: &[f32],
    sorted: &[i32],
    starts: &[i32],
    picture: &mut [f32],
    transmittance: &mut [f32],
    last: &mut [i32],
    width: u32,
    height: u32,
    rules: BlendRules,
    #[comptime] share: TileShare,
) {
    let mut staged = Shared::<[Four]>::new_slice(comptime!(share.batch * share.vectors()));
    let mut rows = Shared::<[u32]>::new_slice(comptime!(share.batch));
    let mut vote = Shared::<[u32]>::new_slice(1usize);
    let mut range = Shared::<[u32]>::new_slice(2usize);
    let pixels = unit_pixels(width, share);
    if pixels.tile < tiles_along(width) * tiles_along(height) {
        let mut blended = nothing_blended(&pixels, width, height, share);
        let mut open = is_any_open(&blended.last, share.span);
        // Barriers depend on the range of the list, so the loads declare to the shader compiler that it is uniform.
        if UNIT_POS == 0u32 {
            range[0] = starts[pixels.tile as usize] as u32;
            range[1] = starts[pixels.tile as usize + 1] as u32;
        }
        let begin = workgroup_uniform_load(&range[0]);
        let end = workgroup_uniform_load(&range[1]);
        let mut at = begin;
        while at < end {
            // Every unit with an open pixel sets the vote; all units read it after the next barrier, uniformly as well.
            if UNIT_POS == 0u32 {
                vote[0] = 0u32;
            }
            sync_cube();
            if open {
                vote[0] = 1u32;
            }
            let count = min(end - at, comptime!(share.batch as u32));
            stage_batch(records, features, sorted, at, count, &pixels, &mut staged, &mut rows, share);
            let votes = workgroup_uniform_load(&vote[0]);
            if votes == 1u32 {
                let mut word = 0u32;
                while word < count && open {
                    let mut met = met_by_row(&rows, word, count, pixels.row);
                    while met != 0u32 {
                        #[unroll]
                        for _ in 0..comptime!(share.at_once()) {
                            let there = select(met == 0u32, 0.0f32, 1.0f32);
                            // If none is left, any staged Gaussian, with an opacity of zero.
                            let k = min(word + met.trailing_zeros(), count - 1u32);
                            met &= met - 1u32;
                            let splat = staged_at(&staged, k, &pixels, share);
                            let number = i32::cast_from(at - begin + k + 1u32);
                            composite_forward(&mut blended, &splat, there * splat.opacity, number, &rules, share);
                        }
                    }
                    word += comptime!(WORD as u32);
                    open = is_any_open(&blended.last, share.span);
                }
                at += count;
            } else {
                at = end;
            }
            sync_cube();
        }
        #[unroll]
        for p in 0..share.span {
            let left = blended.transmittance[p];
            let inside = is_inside(&pixels, p, width, height);
            transmittance[in_tiles(&pixels, p)] = select(inside, left, 0.0f32);
            last[in_tiles(&pixels, p)] = number_of(blended.last[p]);
        }
        write_picture(&blended, &pixels, background, picture, width, height, share);
    }
}

/// The blending state of a unit's pixels.
#[derive(CubeType)]
struct Blended {
    /// The channels of each pixel.
    sums: Array<f32>,
    /// The transmittance behind the Gaussians blended so far.
    transmittance: Array<f32>,
    /// One plus the position of the last blended Gaussian in the tile's list; the complement of that if the pixel is
    /// finished or outside the image.
    last: Array<i32>,
}

#[cube]
fn nothing_blended(pixels: &UnitPixels, width: u32, height: u32, #[comptime] share: TileShare) -> Blended {
    let mut sums = Array::<f32>::new(comptime!(share.span * share.channels));
    let mut transmittance = Array::<f32>::new(share.span);
    let mut last = Array::<i32>::new(share.span);
    #[unroll]
    for i in 0..comptime!(share.span * share.channels) {
        sums[i] = 0.0f32;
    }
    #[unroll]
    for p in 0..share.span {
        transmittance[p] = 1.0f32;
        last[p] = select(is_inside(pixels, p, width, height), 0i32, -1i32);
    }
    Blended { sums, transmittance, last }
}

/// Blends the tile's `number`-th Gaussian into the unit's pixels, without branches, so that all pixels are computed
/// together.
#[cube]
fn composite_forward(
    blended: &mut Blended,
    splat: &Staged,
    opacity: f32,
    number: i32,
    rules: &BlendRules,
    #[comptime] share: TileShare,
) {
    let channels = comptime!(share.channels);
    #[unroll]
    for p in 0..share.span {
        let u = splat.u + comptime!(p as f32);
        let sigma = splat.half_x * u * u + splat.row_sigma;
        let alpha = min(opacity * (-sigma).exp(), rules.alpha_clamp);
        let before = blended.transmittance[p];
        let after = before - before * alpha;
        let last = blended.last[p];
        let seen = alpha >= constant(MIN_ALPHA) && is_open(last);
        let enough = after >= rules.stop;
        let added = seen && enough;
        let weight = select(added, alpha * before, 0.0f32);
        #[unroll]
        for channel in 0..channels {
            blended.sums[comptime!(p * channels + channel)] += weight * splat.values[channel];
        }
        blended.transmittance[p] = select(added, after, before);
        blended.last[p] = select(added, number, select(seen && !enough, !last, last));
    }
}

/// Writes both copies of the unit's pixels over the background.
#[cube]
fn write_picture(
    blended: &Blended,
    pixels: &UnitPixels,
    background: &[f32],
    picture: &mut [f32],
    width: u32,
    height: u32,
    #[comptime] share: TileShare,
) {
    let channels = comptime!(share.channels);
    let plane = (width * height) as usize;
    #[unroll]
    for p in 0..share.span {
        if is_inside(pixels, p, width, height) {
            let left = blended.transmittance[p];
            let pixel = in_picture(pixels, p, width);
            #[unroll]
            for channel in 0..channels {
                let mut value = blended.sums[comptime!(p * channels + channel)];
                if comptime!(channel < background_channels(channels)) {
                    value += left * background[channel];
                }
                let to = comptime!(plane_of_channel(channel, channels));
                picture[to * plane + pixel] = value;
                picture[comptime!(to + plane_count(channels)) * plane + pixel] = value;
            }
            let to = comptime!(alpha_plane(channels));
            picture[to * plane + pixel] = 1.0f32 - left;
            picture[comptime!(to + plane_count(channels)) * plane + pixel] = 1.0f32 - left;
        }
    }
}

/// Whether a pixel with this `last` takes more Gaussians.
#[cube]
fn is_open(last: i32) -> bool {
    last >= 0
}

/// The number in `last`, whether the pixel is finished or not.
#[cube]
fn number_of(last: i32) -> i32 {
    max(last, !last)
}

/// Whether any pixel of the unit is unfinished.
#[cube]
fn is_any_open(last: &Array<i32>, #[comptime] span: usize) -> bool {
    let mut highest = last[0];
    #[unroll]
    for p in 0..span {
        highest = max(highest, last[p]);
    }
    is_open(highest)
}
