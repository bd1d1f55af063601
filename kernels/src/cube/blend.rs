//! Blending the Gaussians of each tile, front to back: a cube a tile. CPU twin: `splat/cpu/blend.rs`.

use cubecl::prelude::*;

use super::maths::constant;
use super::stage::{Four, TileShare, WORD, met_by_row, stage_batch, staged_at};
use super::tiles::tiles_along;
use super::view::BlendRules;
use crate::splat::{MIN_ALPHA, TILE, TILE_PIXELS};

/// Gaussians that a unit takes up in one turn of its loop: a driver that computes on the CPU copies all that a turn
/// hands to the next, the sums of every pixel.
const AT_ONCE: usize = 2;

/// An alpha that none reaches.
const CLOSED: f64 = 2.0;

impl TileShare {
    /// The largest batch for blending on a device whose cubes share `memory` bytes; `None` if not even the smallest
    /// fits.
    pub fn fitting(span: usize, channels: usize, memory: usize) -> Option<Self> {
        [4 * WORD, 2 * WORD, WORD, WORD / 4]
            .into_iter()
            .map(|batch| Self { span, channels, batch })
            .find(|share| share.bytes() + 4 <= memory)
    }
}

/// Blends a picture of `channels` channels: colour, features, depth.
///
/// `picture` is `[2, channels + 1, height, width]` (alpha before depth, both copies equal); `transmittance` and `last`
/// are `[tiles, TILE_PIXELS]`.
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
    let channels = comptime!(share.channels);
    let span = comptime!(share.span);
    let mut staged = Shared::<[Four]>::new_slice(comptime!(share.batch * share.vectors()));
    let mut rows = Shared::<[u32]>::new_slice(comptime!(share.batch));
    let mut vote = Shared::<[u32]>::new_slice(1usize);
    let columns = tiles_along(width);
    let tile = CUBE_POS as u32;
    if tile < columns * tiles_along(height) {
        let spans = comptime!(share.spans() as u32);
        let (column, row) = (UNIT_POS % spans * comptime!(span as u32), UNIT_POS / spans);
        let (left, top) = (tile % columns * comptime!(TILE as u32), tile / columns * comptime!(TILE as u32));
        let (x, y) = (left + column, top + row);

        let mut sums = Array::<f32>::new(comptime!(span * channels));
        let mut light = Array::<f32>::new(span);
        let mut behind = Array::<i32>::new(span);
        // What alpha has to reach at a pixel: more than it can where the pixel is finished, or none of the picture's.
        let mut least = Array::<f32>::new(span);
        #[unroll]
        for p in 0..span {
            #[unroll]
            for channel in 0..channels {
                sums[comptime!(p * channels + channel)] = 0.0f32;
            }
            let inside = x + comptime!(p as u32) < width && y < height;
            light[p] = 1.0f32;
            behind[p] = 0;
            least[p] = select(inside, constant(MIN_ALPHA), constant(CLOSED));
        }
        let mut open = is_any_open(&least, span);

        let begin = starts[tile as usize] as u32;
        let end = starts[tile as usize + 1] as u32;
        let mut at = begin;
        while at < end {
            // Whoever is still open says so; all read the answer behind the next barrier.
            if UNIT_POS == 0u32 {
                vote[0] = 0u32;
            }
            sync_cube();
            if open {
                vote[0] = 1u32;
            }
            let count = min(end - at, comptime!(share.batch as u32));
            let (tile_x, tile_y) = (f32::cast_from(left), f32::cast_from(top));
            stage_batch(records, features, sorted, at, count, tile_x, tile_y, &mut staged, &mut rows, share);
            sync_cube();
            let anybody = vote[0] == 1u32;
            if anybody {
                let mut word = 0u32;
                while word < count && open {
                    let mut met = met_by_row(&rows, word, count, row);
                    while met != 0u32 {
                        #[unroll]
                        for _ in 0..AT_ONCE {
                            let opacity = select(met == 0u32, 0.0f32, 1.0f32);
                            // Where none is left, some Gaussian that was staged, at an opacity of zero.
                            let k = min(word + met.trailing_zeros(), count - 1u32);
                            met &= met - 1u32;
                            let splat = staged_at(&staged, k, f32::cast_from(column), f32::cast_from(row), share);
                            let opacity = opacity * splat.opacity;
                            #[unroll]
                            for p in 0..span {
                                let u = splat.u + comptime!(p as f32);
                                let sigma = splat.half_x * u * u + splat.row_sigma;
                                let alpha = min(opacity * (-sigma).exp(), rules.alpha_clamp);
                                let after = light[p] - light[p] * alpha;
                                let seen = alpha >= least[p];
                                let enough = after >= rules.stop;
                                let added = seen && enough;
                                let weight = select(added, alpha * light[p], 0.0f32);
                                #[unroll]
                                for channel in 0..channels {
                                    sums[comptime!(p * channels + channel)] += weight * splat.values[channel];
                                }
                                light[p] = select(added, after, light[p]);
                                behind[p] = select(added, i32::cast_from(at - begin + k + 1u32), behind[p]);
                                least[p] = select(seen && !enough, constant(CLOSED), least[p]);
                            }
                        }
                    }
                    word += comptime!(WORD as u32);
                    open = is_any_open(&least, span);
                }
                at += count;
            } else {
                at = end;
            }
            sync_cube();
        }

        let plane = (width * height) as usize;
        #[unroll]
        for p in 0..span {
            let place = tile as usize * TILE_PIXELS + (row * comptime!(TILE as u32) + column) as usize + p;
            let inside = x + comptime!(p as u32) < width && y < height;
            transmittance[place] = select(inside, light[p], 0.0f32);
            last[place] = behind[p];
            if inside {
                let pixel = (y * width + x) as usize + p;
                #[unroll]
                for channel in 0..channels {
                    let mut value = sums[comptime!(p * channels + channel)];
                    // The depth, last of the channels, has no background, and alpha stands before it.
                    if comptime!(channel + 1 < channels) {
                        value += light[p] * background[channel];
                    }
                    let to = comptime!(if channel + 1 < channels { channel } else { channel + 1 });
                    picture[to * plane + pixel] = value;
                    picture[comptime!(to + channels + 1) * plane + pixel] = value;
                }
                let alpha = 1.0f32 - light[p];
                picture[comptime!(channels - 1) * plane + pixel] = alpha;
                picture[comptime!(2 * channels) * plane + pixel] = alpha;
            }
        }
    }
}

/// Whether a pixel of the unit is not finished.
#[cube]
fn is_any_open(least: &Array<f32>, #[comptime] span: usize) -> bool {
    let mut lowest = constant(CLOSED);
    #[unroll]
    for p in 0..span {
        lowest = min(lowest, least[p]);
    }
    lowest < constant(CLOSED)
}
