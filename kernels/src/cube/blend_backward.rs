//! Gradients of blending: each tile back to front, one record for each of its Gaussians. CPU twin:
//! `splat/cpu/blend_backward.rs`.
//!
//! A cube takes a tile, and the tile's Gaussians a batch at a time. A batch has three phases between barriers. First a
//! unit is a few neighbouring pixels: it takes the batch's Gaussians out of their light, one after another, and sums
//! what each of them got of the cotangents. Then a unit is four of a Gaussian's numbers, which it sums over the rows of
//! the tile. Then it is a Gaussian, and writes its record. Every sum has one order, there are no atomics, and a
//! Gaussian's records are summed up later in the order of its tiles.

use cubecl::prelude::*;

use super::maths::constant;
use super::stage::{FOUR, Four, TileShare, WORD, met_by_row, stage_batch, staged_at};
use super::tiles::tiles_along;
use super::view::BlendRules;
use crate::splat::{COLOUR_CHANNELS, MIN_ALPHA, PROJECTED_GRADIENT_LEN, TILE, TILE_PIXELS};

/// The middle of a tile's pixels along an axis.
const MIDDLE: f64 = (TILE as f64 - 1.0) / 2.0;

/// How the kernel is compiled.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub struct BlendBackwardKind {
    /// How a tile is shared out.
    pub share: TileShare,
    /// Which channels of the main picture the statistic counts; none if nobody asks for it.
    pub statistic: Option<CountedChannels>,
}

/// The channels that the statistic counts.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum CountedChannels {
    /// Colour, alpha and depth.
    ColourAndDepth,
    /// These and the features.
    All,
}

/// Vectors of a gradient record of so many channels.
pub const fn record_vectors(channels: usize) -> usize {
    (PROJECTED_GRADIENT_LEN + channels).div_ceil(FOUR)
}

impl BlendBackwardKind {
    /// The kernel for a device whose cubes share `memory` bytes; `None` if no batch fits.
    pub fn fitting(span: usize, channels: usize, statistic: Option<CountedChannels>, memory: usize) -> Option<Self> {
        [WORD, 16, 8, 4, 2, 1]
            .into_iter()
            .map(|batch| Self { share: TileShare { span, channels, batch }, statistic })
            .find(|kind| kind.bytes() <= memory)
    }

    /// Vectors of what a unit sums over its pixels: the share of sigma times 1, x and x², the channels, and the
    /// statistic's share times 1 and x.
    const fn sums(&self) -> usize {
        (3 + self.share.channels + if self.statistic.is_some() { 2 } else { 0 }).div_ceil(FOUR)
    }

    /// Vectors that the units' sums of a batch take.
    const fn room(&self) -> usize {
        self.share.batch * self.share.units() * self.sums()
    }

    /// Vectors that the sums over all rows take, times 1, y and y².
    const fn totals(&self) -> usize {
        self.share.batch * self.sums() * 3
    }

    /// Bytes that a cube shares.
    const fn bytes(&self) -> usize {
        self.share.bytes() + 16 * (self.room() + self.totals()) + 4 * self.share.units()
    }

    /// Whether the statistic counts a channel.
    fn counts(&self, channel: usize) -> bool {
        let is_feature = channel >= COLOUR_CHANNELS && channel + 1 < self.share.channels;
        match self.statistic {
            None => false,
            Some(CountedChannels::All) => true,
            Some(CountedChannels::ColourAndDepth) => !is_feature,
        }
    }
}

/// Gradients of `blend`.
///
/// `gradients` has a row of [`record_vectors`] for each entry of the tile lists; `v_background` is `[tiles, channels -
/// 1]`, each tile's share.
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
    let (channels, span) = comptime!((kind.share.channels, kind.share.span));
    let units = comptime!(kind.share.units());
    let vectors = comptime!(kind.sums());
    let counting = comptime!(kind.statistic.is_some());
    let mut staged = Shared::<[Four]>::new_slice(comptime!(kind.share.batch * kind.share.vectors()));
    let mut rows = Shared::<[u32]>::new_slice(comptime!(kind.share.batch));
    let mut room = Shared::<[Four]>::new_slice(comptime!(kind.room()));
    let mut totals = Shared::<[Four]>::new_slice(comptime!(kind.totals()));
    let mut lasts = Shared::<[u32]>::new_slice(units);

    let columns = tiles_along(width);
    let tile = CUBE_POS as u32;
    if tile < columns * tiles_along(height) {
        let unit = UNIT_POS as usize;
        let spans = comptime!(kind.share.spans() as u32);
        let (column, row) = (UNIT_POS % spans * comptime!(span as u32), UNIT_POS / spans);
        let (left, top) = (tile % columns * comptime!(TILE as u32), tile / columns * comptime!(TILE as u32));
        let (x, y) = (left + column, top + row);
        let from_middle = f32::cast_from(column) - constant(MIDDLE);

        // The cotangents at the pixels: both pictures together, and the first alone, of which the statistic counts some
        // channels.
        let mut both = Array::<f32>::new(comptime!(span * channels));
        let mut main = Array::<f32>::new(comptime!(span * channels));
        let mut light = Array::<f32>::new(span);
        let mut taken = Array::<i32>::new(span);
        let mut behind = Array::<f32>::new(span);
        let mut behind_counted = Array::<f32>::new(span);
        let mut largest = 0u32;
        let plane = (width * height) as usize;
        #[unroll]
        for p in 0..span {
            let place = tile as usize * TILE_PIXELS + (row * comptime!(TILE as u32) + column) as usize + p;
            let pixel = (y * width + x) as usize + p;
            let inside = x + comptime!(p as u32) < width && y < height;
            let left_over = transmittance[place];
            light[p] = left_over;
            taken[p] = last[place];
            largest = max(largest, u32::cast_from(last[place]));
            // Alpha is one minus the transmittance, through which the background shows.
            let mut v_alpha = 0.0f32;
            let mut v_alpha_main = 0.0f32;
            if inside {
                v_alpha_main = v_picture[comptime!(channels - 1) * plane + pixel];
                v_alpha = v_alpha_main + v_picture[comptime!(2 * channels) * plane + pixel];
            }
            let mut shade = -v_alpha;
            let mut shade_counted = -v_alpha_main;
            #[unroll]
            for channel in 0..channels {
                let from = comptime!(if channel + 1 < channels { channel } else { channel + 1 });
                let mut first = 0.0f32;
                let mut second = 0.0f32;
                if inside {
                    first = v_picture[from * plane + pixel];
                    second = v_picture[(from + comptime!(channels + 1)) * plane + pixel];
                }
                both[comptime!(p * channels + channel)] = first + second;
                main[comptime!(p * channels + channel)] = first;
                if comptime!(channel + 1 < channels) {
                    shade += (first + second) * background[channel];
                    if comptime!(kind.counts(channel)) {
                        shade_counted += first * background[channel];
                    }
                }
            }
            behind[p] = shade * left_over;
            behind_counted[p] = shade_counted * left_over;
        }

        // The background's share: each unit's pixels, then all units.
        #[unroll]
        for vector in 0..comptime!((channels - 1).div_ceil(FOUR)) {
            let mut sums = Four::new(0.0f32);
            #[unroll]
            for part in 0..comptime!((channels - 1 - FOUR * vector).min(FOUR)) {
                let mut sum = 0.0f32;
                #[unroll]
                for p in 0..span {
                    sum += both[comptime!(p * channels + FOUR * vector + part)] * light[p];
                }
                sums.insert(part, sum);
            }
            room[comptime!(vector * units) + unit] = sums;
        }
        lasts[unit] = largest;
        sync_cube();
        if unit < comptime!((channels - 1).div_ceil(FOUR)) {
            let mut sums = Four::new(0.0f32);
            for other in 0..units {
                sums += room[unit * units + other];
            }
            #[unroll]
            for part in 0..FOUR {
                let channel = FOUR * unit + part;
                if channel < comptime!(channels - 1) {
                    v_background[tile as usize * comptime!(channels - 1) + channel] = sums.extract(part);
                }
            }
        }
        let used = largest_of_units(&mut lasts);

        let begin = starts[tile as usize] as u32;
        let length = comptime!(record_vectors(kind.share.channels));
        let batch = comptime!(kind.share.batch as u32);
        let batches = (used + (batch - 1u32)) / batch;
        for turn in 0..batches {
            let first = (batches - 1u32 - turn) * batch;
            let count = min(used - first, batch);
            let (tile_x, tile_y) = (f32::cast_from(left), f32::cast_from(top));
            stage_batch(records, features, sorted, begin + first, count, tile_x, tile_y, &mut staged, &mut rows, share);
            sync_cube();

            // A unit is its pixels.
            let mut met = met_by_row(&rows, 0u32, count, row);
            while met != 0u32 {
                let k = comptime!(WORD as u32 - 1) - met.leading_zeros();
                met ^= 1u32 << k;
                let splat = staged_at(&staged, k, f32::cast_from(column), f32::cast_from(row), share);
                let mut sums = Array::<f32>::new(comptime!(FOUR * kind.sums()));
                #[unroll]
                for i in 0..comptime!(FOUR * kind.sums()) {
                    sums[i] = 0.0f32;
                }
                #[unroll]
                for p in 0..span {
                    let u = splat.u + comptime!(p as f32);
                    let sigma = splat.half_x * u * u + splat.row_sigma;
                    let falloff = (-sigma).exp();
                    let raw = splat.opacity * falloff;
                    let clamped = min(raw, rules.alpha_clamp);
                    let added = clamped >= constant(MIN_ALPHA) && i32::cast_from(first + k) < taken[p];
                    let alpha = select(added, clamped, 0.0f32);
                    let gate = select(added && raw <= rules.gradient_clamp, falloff, 0.0f32);
                    let inverse = 1.0f32 / (1.0f32 - alpha);
                    light[p] *= inverse;
                    let weight = alpha * light[p];
                    let mut shade = 0.0f32;
                    #[unroll]
                    for channel in 0..channels {
                        let v = both[comptime!(p * channels + channel)];
                        shade += v * splat.values[channel];
                        sums[comptime!(3 + channel)] += weight * v;
                    }
                    let part = gate * (light[p] * shade - behind[p] * inverse);
                    behind[p] += weight * shade;
                    let place = from_middle + comptime!(p as f32);
                    sums[0] += part;
                    sums[1] += part * place;
                    sums[2] += part * place * place;
                    if counting {
                        let mut shade = 0.0f32;
                        #[unroll]
                        for channel in 0..channels {
                            if comptime!(kind.counts(channel)) {
                                shade += main[comptime!(p * channels + channel)] * splat.values[channel];
                            }
                        }
                        let part = gate * (light[p] * shade - behind_counted[p] * inverse);
                        behind_counted[p] += weight * shade;
                        sums[comptime!(3 + channels)] += part;
                        sums[comptime!(4 + channels)] += part * place;
                    }
                }
                #[unroll]
                for vector in 0..vectors {
                    let mut four = Four::new(0.0f32);
                    #[unroll]
                    for part in 0..FOUR {
                        four.insert(part, sums[comptime!(FOUR * vector + part)]);
                    }
                    room[(k as usize * units + unit) * vectors + vector] = four;
                }
            }
            sync_cube();

            // A unit is four of a Gaussian's numbers.
            let mut task = unit;
            while task < count as usize * vectors {
                let (k, vector) = (task / vectors, task % vectors);
                let met = rows[k];
                let mut once = Four::new(0.0f32);
                let mut by_y = Four::new(0.0f32);
                let mut by_yy = Four::new(0.0f32);
                for row in met.trailing_zeros()..comptime!(WORD as u32) - met.leading_zeros() {
                    let y = Four::new(f32::cast_from(row) - constant(MIDDLE));
                    let from = k * units + row as usize * spans as usize;
                    for span in 0..spans as usize {
                        let four = room[(from + span) * vectors + vector];
                        once += four;
                        by_y += four * y;
                        by_yy += four * y * y;
                    }
                }
                totals[3 * task] = once;
                totals[3 * task + 1] = by_y;
                totals[3 * task + 2] = by_yy;
                task += units;
            }
            sync_cube();

            // A unit is a Gaussian.
            let mut k = UNIT_POS;
            while k < count {
                let to = (begin + first + k) as usize * length;
                write_record(&staged, &totals, k as usize, gradients, to, kind);
                k += comptime!(kind.share.units() as u32);
            }
            sync_cube();
        }

        // Those that no pixel took up.
        let end = starts[tile as usize + 1] as usize * length;
        let mut at = (begin + used) as usize * length + unit;
        while at < end {
            gradients[at] = Four::new(0.0f32);
            at += units;
        }
    }
}

/// Turns the totals of Gaussian `k` of a batch into its record, the covariance's moments about the tile's middle into
/// those about the centre; see `Moments::gradient` of the twin.
#[cube]
fn write_record(
    staged: &Shared<[Four]>,
    totals: &Shared<[Four]>,
    k: usize,
    gradients: &mut [Four],
    to: usize,
    #[comptime] kind: BlendBackwardKind,
) {
    let at = k * comptime!(kind.share.vectors());
    let (shape, rest) = (staged[at], staged[at + 1]);
    let middle = constant(MIDDLE);
    let slope = shape.extract(3usize);
    let (curve_x, curve_y) = (2.0f32 * shape.extract(2usize), 2.0f32 * rest.extract(0usize));
    let opacity = rest.extract(1usize);
    let middle_y = shape.extract(1usize) + middle;
    let middle_u = shape.extract(0usize) + middle + slope * middle_y;
    let one = total(totals, k, 0usize, 0usize, kind);
    let (x, y) = (total(totals, k, 1usize, 0usize, kind), total(totals, k, 0usize, 1usize, kind));
    let xx = total(totals, k, 2usize, 0usize, kind);
    let xy = total(totals, k, 1usize, 1usize, kind);
    let yy = total(totals, k, 0usize, 2usize, kind);
    // Sums of u, dy, u², u dy and dy².
    let u = x + slope * y + middle_u * one;
    let dy = y + middle_y * one;
    let uu = xx + slope * (2.0f32 * xy + slope * yy) + middle_u * (2.0f32 * (x + slope * y) + middle_u * one);
    let u_dy = xy + slope * yy + middle_u * y + middle_y * u;
    let dy_dy = yy + middle_y * (2.0f32 * y + middle_y * one);
    let (g_xx, g_xu) = (curve_x * curve_x * uu, curve_x * curve_y * u_dy);

    let mut numbers = Array::<f32>::new(comptime!(FOUR * record_vectors(kind.share.channels)));
    numbers[0] = opacity * curve_x * u;
    numbers[1] = opacity * (slope * curve_x * u + curve_y * dy);
    numbers[2] = 0.5f32 * opacity * g_xx;
    numbers[3] = opacity * (slope * g_xx + g_xu);
    numbers[4] = 0.5f32 * opacity * (slope * slope * g_xx + 2.0f32 * slope * g_xu + curve_y * curve_y * dy_dy);
    numbers[5] = one;
    numbers[6] = 0.0f32;
    numbers[7] = 0.0f32;
    if comptime!(kind.statistic.is_some()) {
        let counted = comptime!(3 + kind.share.channels);
        let one = total(totals, k, counted, 0usize, kind);
        let (x, y) = (total(totals, k, comptime!(counted + 1), 0usize, kind), total(totals, k, counted, 1usize, kind));
        let u = x + slope * y + middle_u * one;
        let dy = y + middle_y * one;
        numbers[6] = opacity * curve_x * u;
        numbers[7] = opacity * (slope * curve_x * u + curve_y * dy);
    }
    #[unroll]
    for i in 0..comptime!(FOUR * record_vectors(kind.share.channels) - PROJECTED_GRADIENT_LEN) {
        if comptime!(i < kind.share.channels) {
            numbers[comptime!(PROJECTED_GRADIENT_LEN + i)] = total(totals, k, comptime!(3 + i), 0usize, kind);
        } else {
            numbers[comptime!(PROJECTED_GRADIENT_LEN + i)] = 0.0f32;
        }
    }
    #[unroll]
    for vector in 0..comptime!(record_vectors(kind.share.channels)) {
        let mut four = Four::new(0.0f32);
        #[unroll]
        for part in 0..FOUR {
            four.insert(part, numbers[comptime!(FOUR * vector + part)]);
        }
        gradients[to + vector] = four;
    }
}

/// Number `number` of Gaussian `k`, summed over the rows times y to the given power.
#[cube]
fn total(
    totals: &Shared<[Four]>,
    k: usize,
    #[comptime] number: usize,
    #[comptime] power: usize,
    #[comptime] kind: BlendBackwardKind,
) -> f32 {
    let vector = k * comptime!(kind.sums()) + comptime!(number / FOUR);
    totals[3 * vector + power].extract(comptime!(number % FOUR))
}

/// The largest number of all `units`; `values` holds one a unit. Every unit of the cube has to come here.
#[cube]
fn largest_of_units(values: &mut Shared<[u32]>) -> u32 {
    let unit = UNIT_POS as usize;
    let mut half = CUBE_DIM as usize / 2;
    while half > 0 {
        sync_cube();
        if unit < half {
            values[unit] = max(values[unit], values[unit + half]);
        }
        half /= 2;
    }
    sync_cube();
    values[0]
}
