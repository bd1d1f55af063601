//! Gradients of blending: each tile back to front, one record for each of its Gaussians.
//!
//! The record of a Gaussian in a tile sums over the tile's pixels by columns first, then over columns by a fixed tree.
//! What depends on the pixel's place only through `1`, `x`, `y`, `x²`, `xy`, `y²` is summed as these six moments about
//! the middle of the tile, and turned into gradients of centre and covariance once a record.

use mvfusion_kernels::splat::{MIN_ALPHA, PROJECTED_GRADIENT_LEN, ProjectedGradient, TILE};
use pulp::{Simd, WithSimd};
use rayon::prelude::*;

use super::blend::{BATCH, Stage, Staged, TileSource};
use super::lanes::{HALVES, LANES, Lane, Lanes, Plane, SEGMENTS, fma, sum_lanes};
use crate::splat::Statistic;

/// What blending saved, and what arrives at the picture.
#[derive(Clone, Copy)]
pub(crate) struct BlendGradientSource<'a, T> {
    pub tiles: TileSource<'a, T>,
    pub transmittance: &'a [Plane<T>],
    pub last: &'a [Plane<i32>],
    /// Cotangent of the packed picture, `[2, channels + 1, height, width]`.
    pub v_picture: &'a [T],
    /// What the statistic counts; `None` if nobody asks for it.
    pub statistic: Option<Statistic>,
}

/// Gradient records, one for each entry of the tile lists, and the gradient of the background.
pub(crate) struct BlendGradients<T> {
    /// Rows of [`ProjectedGradient`] and the channels' gradients.
    pub records: Vec<T>,
    pub background: Vec<T>,
}

/// Gradients of [`super::blend::blend`].
pub(crate) fn blend_backward<T: Lane>(source: &BlendGradientSource<T>) -> BlendGradients<T> {
    let tiles = &source.tiles;
    let record_len = PROJECTED_GRADIENT_LEN + tiles.cloud.channels();
    let mut records = vec![T::zero(); tiles.sorted.len() * record_len];
    let mut jobs = Vec::with_capacity(tiles.view.tile_count());
    let mut rest = records.as_mut_slice();
    for tile in 0..tiles.view.tile_count() {
        let (mine, others) = rest.split_at_mut(tiles.list(tile).len() * record_len);
        rest = others;
        jobs.push(mine);
    }
    let shares: Vec<Vec<T>> = jobs
        .into_par_iter()
        .enumerate()
        .map(|(tile, records)| {
            let cotangent = TileCotangent::read(source, tile);
            cotangent.pull_back(source, tile, records);
            cotangent.background_share(&source.transmittance[tile])
        })
        .collect();
    let mut background = vec![T::zero(); tiles.cloud.background.len()];
    for share in &shares {
        for (sum, &part) in background.iter_mut().zip(share) {
            *sum += part;
        }
    }
    BlendGradients { records, background }
}

/// The cotangents at a tile.
struct TileCotangent<T> {
    /// Both pictures together: a plane a channel, in the order colour, features, depth, and then alpha.
    all: Vec<Plane<T>>,
    /// What the statistic counts, in the same order; `None` if that is the same, or if there is no statistic.
    counted: Option<Vec<Plane<T>>>,
}

impl<T: Lane> TileCotangent<T> {
    fn read(source: &BlendGradientSource<T>, tile: usize) -> Self {
        let channels = source.tiles.cloud.channels();
        let mut all = vec![[[T::zero(); LANES]; SEGMENTS]; channels + 1];
        source.add_tile(0, tile, &mut all);
        let mut counted = all.clone();
        source.add_tile(1, tile, &mut all);
        if source.statistic == Some(Statistic::ColourAndDepth) {
            counted[mvfusion_kernels::splat::COLOUR_CHANNELS..channels - 1].fill([[T::zero(); LANES]; SEGMENTS]);
        }
        let apart = source.statistic.is_some() && counted != all;
        Self { all, counted: apart.then_some(counted) }
    }

    /// The tile's part of the background's gradient.
    fn background_share(&self, transmittance: &Plane<T>) -> Vec<T> {
        let channels = self.all.len() - 1;
        self.all[..channels - 1]
            .iter()
            .map(|plane| {
                let mut sums = [T::zero(); LANES];
                for (cotangent, left) in plane.iter().zip(transmittance) {
                    for (sum, (&v, &t)) in sums.iter_mut().zip(cotangent.iter().zip(left)) {
                        *sum += v * t;
                    }
                }
                sum_lanes(sums)
            })
            .collect()
    }

    /// Fills in the records of the tile.
    fn pull_back(&self, source: &BlendGradientSource<T>, tile: usize, records: &mut [T]) {
        let quiet = |planes: &[Plane<T>]| planes.as_flattened().as_flattened().iter().all(|v| v.is_zero());
        if quiet(&self.all) && self.counted.is_none() {
            return;
        }
        match (source.tiles.cloud.channels(), self.counted.is_some()) {
            (4, false) if size_of::<T>() == 4 => self.dispatch::<4, false>(source, tile, records),
            (4, true) if size_of::<T>() == 4 => self.dispatch::<4, true>(source, tile, records),
            (7, false) if size_of::<T>() == 4 => self.dispatch::<7, false>(source, tile, records),
            (7, true) if size_of::<T>() == 4 => self.dispatch::<7, true>(source, tile, records),
            (_, false) => self.dispatch::<0, false>(source, tile, records),
            (_, true) => self.dispatch::<0, true>(source, tile, records),
        }
    }

    fn dispatch<const C: usize, const COUNTED: bool>(
        &self,
        source: &BlendGradientSource<T>,
        tile: usize,
        records: &mut [T],
    ) {
        pulp::Arch::new().dispatch(BlendTileBackward::<T, C, COUNTED> { source, cotangent: self, tile, records });
    }
}

impl<T: Lane> BlendGradientSource<'_, T> {
    /// Adds a tile of the cotangents of picture `copy` to planes in the order colour, features, depth, alpha.
    fn add_tile(&self, copy: usize, tile: usize, planes: &mut [Plane<T>]) {
        let view = self.tiles.view;
        let (width, pixels, count) = (view.width, view.width * view.height, planes.len());
        let [left, top] = self.tiles.origin(tile);
        for (index, plane) in planes.iter_mut().enumerate() {
            // The picture has alpha before depth.
            let channel = if index < count - 2 { index } else { 2 * count - 3 - index };
            let picture = &self.v_picture[(copy * count + channel) * pixels..][..pixels];
            for row in 0..TILE.min(view.height - top) {
                for half in 0..HALVES {
                    let begin = left + half * LANES;
                    let values = &picture[(top + row) * width..][begin.min(width)..(begin + LANES).min(width)];
                    for (sum, &value) in plane[half * TILE + row].iter_mut().zip(values) {
                        *sum += value;
                    }
                }
            }
        }
    }
}

/// One tile to pull back through, with `C` channels (any number if 0), and with a statistic of its own if `COUNTED`.
struct BlendTileBackward<'a, T, const C: usize, const COUNTED: bool> {
    source: &'a BlendGradientSource<'a, T>,
    cotangent: &'a TileCotangent<T>,
    tile: usize,
    records: &'a mut [T],
}

impl<T: Lane, const C: usize, const COUNTED: bool> WithSimd for BlendTileBackward<'_, T, C, COUNTED> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(self, _: S) {
        let tiles = &self.source.tiles;
        let count = if C == 0 { tiles.cloud.channels() } else { C };
        let list = tiles.list(self.tile);
        let last = &self.source.last[self.tile];
        let last_of_segment: [i32; SEGMENTS] =
            std::array::from_fn(|segment| last[segment].iter().fold(0, |a, &b| if b > a { b } else { a }));
        let used = last_of_segment.iter().fold(0, |a, &b| if b > a { b } else { a }) as usize;
        let origin = tiles.origin(self.tile);
        let mut pixels = PixelState::new(self.source, self.cotangent, self.tile);
        let mut stage = Stage::new(count);
        let mut room = vec![[T::zero(); LANES]; if C == 0 { count } else { 0 }];
        let record_len = PROJECTED_GRADIENT_LEN + count;
        for number in (0..used.div_ceil(BATCH)).rev() {
            let begin = number * BATCH;
            let ids = &list[begin..(begin + BATCH).min(used)];
            stage.gather(tiles, origin, ids);
            let mut open = 0u32;
            for (segment, &last) in last_of_segment.iter().enumerate() {
                open |= u32::from(last > begin as i32) << segment;
            }
            for (k, splat) in stage.splats[..ids.len()].iter().enumerate().rev() {
                let segments = splat.segments & open;
                if segments == 0 {
                    continue;
                }
                let mut unrolled = [[T::zero(); LANES]; C];
                let v_channels: &mut [Lanes<T>] = if C == 0 { room.as_mut_slice() } else { &mut unrolled };
                v_channels.fill([T::zero(); LANES]);
                let job = SplatBackward {
                    splat,
                    values: &stage.values[k * count..(k + 1) * count],
                    place: (begin + k) as i32,
                    segments,
                    last,
                };
                let moments = job.pull_back::<S, C, COUNTED>(self.source, self.cotangent, &mut pixels, v_channels);
                let record = &mut self.records[(begin + k) * record_len..(begin + k + 1) * record_len];
                let (head, channels) = record.split_at_mut(PROJECTED_GRADIENT_LEN);
                head.copy_from_slice(&moments.gradient(splat, COUNTED).to_row());
                for (value, &sums) in channels.iter_mut().zip(v_channels.iter()) {
                    *value = sum_lanes(sums);
                }
            }
        }
    }
}

/// What the pixels of a tile carry from back to front.
struct PixelState<T> {
    /// Transmittance behind the Gaussian in turn.
    transmittance: Plane<T>,
    /// Cotangent-weighted light that comes from behind it.
    behind: Plane<T>,
    /// The same for the statistic.
    behind_counted: Plane<T>,
}

impl<T: Lane> PixelState<T> {
    #[inline(always)]
    fn new(source: &BlendGradientSource<T>, cotangent: &TileCotangent<T>, tile: usize) -> Self {
        let transmittance = source.transmittance[tile];
        let background = source.tiles.cloud.background;
        let behind = |planes: &[Plane<T>]| {
            // The last plane is alpha's, which is one minus the transmittance.
            let mut sum = planes[planes.len() - 1].map(|lanes| lanes.map(|v| -v));
            for (plane, &colour) in planes.iter().zip(background) {
                for (sum, &v) in sum.as_flattened_mut().iter_mut().zip(plane.as_flattened()) {
                    *sum += v * colour;
                }
            }
            for (sum, &left) in sum.as_flattened_mut().iter_mut().zip(transmittance.as_flattened()) {
                *sum *= left;
            }
            sum
        };
        let all = behind(&cotangent.all);
        let counted = cotangent.counted.as_ref().map_or(all, |planes| behind(planes));
        Self { transmittance, behind: all, behind_counted: counted }
    }
}

/// One Gaussian in one tile.
struct SplatBackward<'a, T> {
    splat: &'a Staged<T>,
    values: &'a [T],
    /// Its place in the tile's list.
    place: i32,
    segments: u32,
    last: &'a Plane<i32>,
}

impl<T: Lane> SplatBackward<'_, T> {
    /// Sums over the Gaussian's segments, and takes it out of the pixels' state.
    #[inline(always)]
    fn pull_back<S: Simd, const C: usize, const COUNTED: bool>(
        &self,
        source: &BlendGradientSource<T>,
        cotangent: &TileCotangent<T>,
        pixels: &mut PixelState<T>,
        v_channels: &mut [Lanes<T>],
    ) -> Moments<T> {
        let count = if C == 0 { source.tiles.cloud.channels() } else { C };
        let (all, values) = (&cotangent.all[..count], &self.values[..count]);
        let counted = cotangent.counted.as_ref().map_or(all, |planes| &planes[..count]);
        let clamps = Clamps { alpha: source.tiles.view.alpha_clamp, gradient: source.tiles.view.gradient_clamp };
        let dx = self.splat.offsets_x();
        let mut moments = Moments::default();
        for half in 0..HALVES {
            let mut rows = (self.segments >> (half * TILE)) & ((1 << TILE) - 1);
            let mut columns = Columns::default();
            while rows != 0 {
                let row = rows.trailing_zeros() as usize % TILE;
                rows &= rows - 1;
                let segment = half * TILE + row;
                let falloff = self.splat.falloff::<S>(&dx[half], self.splat.offset_y(row));
                let cover = Cover::new(self.splat.opacity, &falloff, &self.last[segment], self.place, clamps);
                let inverse: Lanes<T> = std::array::from_fn(|lane| T::one() / (T::one() - cover.alpha[lane]));
                let before: Lanes<T> = std::array::from_fn(|lane| pixels.transmittance[segment][lane] * inverse[lane]);
                let weights: Lanes<T> = std::array::from_fn(|lane| cover.alpha[lane] * before[lane]);
                pixels.transmittance[segment] = before;
                for (plane, v_channel) in all.iter().zip(v_channels.iter_mut()) {
                    for (sum, (&w, &v)) in v_channel.iter_mut().zip(weights.iter().zip(&plane[segment])) {
                        *sum = fma::<S, T>(w, v, *sum);
                    }
                }
                let light = Light { before: &before, inverse: &inverse, weights: &weights, gate: &cover.gate };
                let v = light.alpha_gradient::<S>(values, all, segment, &mut pixels.behind[segment]);
                columns.add::<S>(&v, row);
                if COUNTED {
                    let v = light.alpha_gradient::<S>(values, counted, segment, &mut pixels.behind_counted[segment]);
                    columns.add_counted::<S>(&v, row);
                }
            }
            moments.add_half::<S>(&columns, half);
        }
        moments
    }
}

/// Bounds on alpha.
#[derive(Clone, Copy)]
struct Clamps<T> {
    alpha: T,
    gradient: T,
}

/// How a Gaussian covers the pixels of a segment.
struct Cover<T> {
    /// Alpha, zero where the forward pass did not add the Gaussian.
    alpha: Lanes<T>,
    /// `d alpha / d opacity`: the falloff, or zero where no gradient passes.
    gate: Lanes<T>,
}

impl<T: Lane> Cover<T> {
    #[inline(always)]
    fn new(opacity: T, falloff: &Lanes<T>, last: &Lanes<i32>, place: i32, clamps: Clamps<T>) -> Self {
        let (zero, min_alpha) = (T::zero(), T::of(MIN_ALPHA));
        let mut cover = Self { alpha: [zero; LANES], gate: [zero; LANES] };
        for lane in 0..LANES {
            let raw = opacity * falloff[lane];
            let alpha = if raw < clamps.alpha { raw } else { clamps.alpha };
            let added = (alpha >= min_alpha) & (place < last[lane]);
            cover.alpha[lane] = if added { alpha } else { zero };
            cover.gate[lane] = if added & (raw <= clamps.gradient) { falloff[lane] } else { zero };
        }
        cover
    }
}

/// What light does at the pixels of a segment.
struct Light<'a, T> {
    /// Transmittance before the Gaussian.
    before: &'a Lanes<T>,
    /// `1 / (1 - alpha)`.
    inverse: &'a Lanes<T>,
    weights: &'a Lanes<T>,
    gate: &'a Lanes<T>,
}

impl<T: Lane> Light<'_, T> {
    /// Gradient of alpha times `d alpha / d opacity`; adds the Gaussian to what comes from behind.
    #[inline(always)]
    fn alpha_gradient<S: Simd>(
        &self,
        values: &[T],
        cotangents: &[Plane<T>],
        segment: usize,
        behind: &mut Lanes<T>,
    ) -> Lanes<T> {
        let mut shade = [T::zero(); LANES];
        for (&value, plane) in values.iter().zip(cotangents) {
            for (sum, &v) in shade.iter_mut().zip(&plane[segment]) {
                *sum = fma::<S, T>(v, value, *sum);
            }
        }
        let mut result = [T::zero(); LANES];
        for lane in 0..LANES {
            let v_alpha = self.before[lane] * shade[lane] - behind[lane] * self.inverse[lane];
            result[lane] = v_alpha * self.gate[lane];
            behind[lane] = fma::<S, T>(self.weights[lane], shade[lane], behind[lane]);
        }
        result
    }
}

/// Distance of a row or column of a tile from the tile's middle.
#[inline(always)]
fn from_middle<T: Lane>(index: usize) -> T {
    T::of(index as f64 - (TILE as f64 - 1.0) / 2.0)
}

/// Sums over the rows of one half of a tile, a lane a column: of 1, y, y².
#[derive(Default)]
struct Columns<T> {
    sums: [Lanes<T>; 3],
    counted: [Lanes<T>; 2],
}

impl<T: Lane> Columns<T> {
    #[inline(always)]
    fn add<S: Simd>(&mut self, v: &Lanes<T>, row: usize) {
        let y = from_middle::<T>(row);
        for lane in 0..LANES {
            self.sums[0][lane] += v[lane];
            self.sums[1][lane] = fma::<S, T>(v[lane], y, self.sums[1][lane]);
            self.sums[2][lane] = fma::<S, T>(v[lane], y * y, self.sums[2][lane]);
        }
    }

    #[inline(always)]
    fn add_counted<S: Simd>(&mut self, v: &Lanes<T>, row: usize) {
        let y = from_middle::<T>(row);
        for lane in 0..LANES {
            self.counted[0][lane] += v[lane];
            self.counted[1][lane] = fma::<S, T>(v[lane], y, self.counted[1][lane]);
        }
    }
}

/// Moments of the gradient of `sigma` (up to the factor `-opacity`) about the middle of the tile, still by lanes.
#[derive(Default)]
struct Moments<T> {
    one: Lanes<T>,
    x: Lanes<T>,
    y: Lanes<T>,
    xx: Lanes<T>,
    xy: Lanes<T>,
    yy: Lanes<T>,
    /// One, x, y of the statistic.
    counted: [Lanes<T>; 3],
}

impl<T: Lane> Moments<T> {
    #[inline(always)]
    fn add_half<S: Simd>(&mut self, columns: &Columns<T>, half: usize) {
        let [one, y, yy] = &columns.sums;
        for lane in 0..LANES {
            let x = from_middle::<T>(half * LANES + lane);
            self.one[lane] += one[lane];
            self.x[lane] = fma::<S, T>(one[lane], x, self.x[lane]);
            self.xx[lane] = fma::<S, T>(one[lane], x * x, self.xx[lane]);
            self.y[lane] += y[lane];
            self.xy[lane] = fma::<S, T>(y[lane], x, self.xy[lane]);
            self.yy[lane] += yy[lane];
            let [one, y] = &columns.counted;
            self.counted[0][lane] += one[lane];
            self.counted[1][lane] = fma::<S, T>(one[lane], x, self.counted[1][lane]);
            self.counted[2][lane] += y[lane];
        }
    }

    /// Gradients of centre, covariance and opacity. With `d = pixel - centre`, `u = dx + slope dy` and
    /// `g = d sigma / d d = (curve_x u, slope curve_x u + curve_y dy)`, sigma has the gradient `-g` with respect to the
    /// centre and `-g gᵀ / 2` with respect to the covariance.
    #[inline(always)]
    fn gradient(&self, splat: &Staged<T>, counted: bool) -> ProjectedGradient<T> {
        let [one, x, y] = [&self.one, &self.x, &self.y].map(|lanes| sum_lanes(*lanes));
        let [xx, xy, yy] = [&self.xx, &self.xy, &self.yy].map(|lanes| sum_lanes(*lanes));
        let middle = T::of((TILE as f64 - 1.0) / 2.0);
        let (two, half, slope) = (T::of(2.0), T::of(0.5), splat.slope);
        let (curve_x, curve_y) = (two * splat.half_curve_x, two * splat.half_curve_y);
        let middle_y = splat.first[1] + middle;
        let middle_u = splat.first[0] + middle + slope * middle_y;
        let centre = |one: T, x: T, y: T| {
            let (u, dy) = (x + slope * y + middle_u * one, y + middle_y * one);
            let along = curve_x * u;
            [splat.opacity * along, splat.opacity * (slope * along + curve_y * dy)]
        };
        // Sums of u, dy, u², u dy and dy².
        let u = x + slope * y + middle_u * one;
        let uu = xx + slope * (two * xy + slope * yy) + middle_u * (two * (x + slope * y) + middle_u * one);
        let u_dy = xy + slope * yy + middle_u * y + middle_y * u;
        let dy_dy = yy + middle_y * (two * y + middle_y * one);
        let (g_xx, g_xu) = (curve_x * curve_x * uu, curve_x * curve_y * u_dy);
        let statistic = if counted {
            let [one, x, y] = [0, 1, 2].map(|i| sum_lanes(self.counted[i]));
            centre(one, x, y)
        } else {
            centre(one, x, y)
        };
        ProjectedGradient {
            centre: centre(one, x, y),
            covariance: [
                half * splat.opacity * g_xx,
                splat.opacity * (slope * g_xx + g_xu),
                half * splat.opacity * (slope * slope * g_xx + two * slope * g_xu + curve_y * curve_y * dy_dy),
            ],
            opacity: one,
            statistic,
        }
    }
}
