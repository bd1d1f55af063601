//! Gradients of blending: each tile back to front, one record per Gaussian of the tile.
//!
//! The record of a Gaussian sums over the tile's pixels, first down each column, then over the columns by a fixed tree.
//! The sums are the six moments `1`, `x`, `y`, `x²`, `xy`, `y²` about the middle of the tile. They become gradients of
//! centre and covariance once per record.

use mvfusion_kernels::splat::{
    COLOUR_CHANNELS, MIN_ALPHA, PROJECTED_GRADIENT_LEN, TILE, alpha_plane, background_channels, depth_channel,
    gradient_record, plane_count, plane_of_channel,
};
use rayon::prelude::*;

use super::blend::{BATCH, Stage, Staged, TileSource};
use super::lanes::{HALVES, LANES, Lane, Lanes, Plane, SEGMENTS, VectorJob, Vectors, sum_lanes, sum_vector};
use super::moments::{Columns, Moments};
use super::view::View;
use crate::splat::Statistic;

/// The state that blending saved, and the cotangent of the image.
#[derive(Clone, Copy)]
pub(crate) struct BlendGradientSource<'a, T> {
    pub tiles: TileSource<'a, T>,
    pub transmittance: &'a [Plane<T>],
    pub last: &'a [Plane<i32>],
    /// Cotangent of the packed image, `[2, channels + 1, height, width]`.
    pub v_picture: &'a [T],
    /// The channels of the statistic; `None` if it is not requested.
    pub statistic: Option<Statistic>,
}

/// Gradient records, one for each entry of the tile lists, and the gradient of the background.
pub(crate) struct BlendGradients<T> {
    /// Rows of [`ProjectedGradient`](mvfusion_kernels::splat::ProjectedGradient) and the channels' gradients.
    pub records: Vec<T>,
    pub background: Vec<T>,
}

/// Gradients of [`super::blend::blend`].
pub(crate) fn blend_backward<T: Lane>(source: &BlendGradientSource<T>) -> BlendGradients<T> {
    let tiles = &source.tiles;
    let record_len = gradient_record::len(tiles.cloud.channels());
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
    let mut background = vec![T::zero(); tiles.cloud.values.background.len()];
    for share in &shares {
        for (sum, &part) in background.iter_mut().zip(share) {
            *sum += part;
        }
    }
    BlendGradients { records, background }
}

/// The cotangents at a tile.
struct TileCotangent<T> {
    /// The sum over both images: one plane per channel, in the order colour, features, depth, alpha.
    all: Vec<Plane<T>>,
    /// The channels of the statistic, in the same order; `None` if they are equal to `all`, or without a statistic.
    counted: Option<Vec<Plane<T>>>,
}

impl<T: Lane> TileCotangent<T> {
    fn read(source: &BlendGradientSource<T>, tile: usize) -> Self {
        let channels = source.tiles.cloud.channels();
        let mut all = vec![[[T::zero(); LANES]; SEGMENTS]; plane_count(channels)];
        source.add_tile(0, tile, &mut all);
        let mut counted = all.clone();
        source.add_tile(1, tile, &mut all);
        if source.statistic == Some(Statistic::ColourAndDepth) {
            counted[COLOUR_CHANNELS..depth_channel(channels)].fill([[T::zero(); LANES]; SEGMENTS]);
        }
        let apart = source.statistic.is_some() && counted != all;
        Self { all, counted: apart.then_some(counted) }
    }

    /// The tile's part of the background's gradient.
    fn background_share(&self, transmittance: &Plane<T>) -> Vec<T> {
        let channels = self.all.len() - 1;
        self.all[..background_channels(channels)]
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

    /// Computes the records of the tile.
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
        T::run(BlendTileBackward::<T, C, COUNTED> { source, cotangent: self, tile, records });
    }
}

impl<T: Lane> BlendGradientSource<'_, T> {
    /// Adds a tile of the cotangents of image `copy` to planes in the order colour, features, depth, alpha.
    fn add_tile(&self, copy: usize, tile: usize, planes: &mut [Plane<T>]) {
        let view = self.tiles.view;
        let (width, pixels, channels) = (view.width, view.width * view.height, planes.len() - 1);
        let [left, top] = self.tiles.origin(tile);
        for (index, plane) in planes.iter_mut().enumerate() {
            let from = if index < channels { plane_of_channel(index, channels) } else { alpha_plane(channels) };
            let picture = &self.v_picture[(copy * plane_count(channels) + from) * pixels..][..pixels];
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

/// The backward pass of one tile, with `C` channels (any number if 0), and with a separate statistic if `COUNTED`.
struct BlendTileBackward<'a, T, const C: usize, const COUNTED: bool> {
    source: &'a BlendGradientSource<'a, T>,
    cotangent: &'a TileCotangent<T>,
    tile: usize,
    records: &'a mut [T],
}

impl<T: Lane, const C: usize, const COUNTED: bool> VectorJob<T> for BlendTileBackward<'_, T, C, COUNTED> {
    type Output = ();

    #[inline(always)]
    fn run<X: Vectors<T>>(self, x: X) {
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
        let zero = x.splat(T::zero());
        let mut room = vec![zero; if C == 0 { count } else { 0 }];
        let record_len = gradient_record::len(count);
        for number in (0..used.div_ceil(BATCH)).rev() {
            let begin = number * BATCH;
            let ids = &list[begin..(begin + BATCH).min(used)];
            stage.gather(x, tiles, origin, ids);
            let mut open = 0u32;
            for (segment, &last) in last_of_segment.iter().enumerate() {
                open |= u32::from(last > begin as i32) << segment;
            }
            for (k, splat) in stage.splats[..ids.len()].iter().enumerate().rev() {
                let segments = splat.segments & open;
                if segments == 0 {
                    continue;
                }
                let mut unrolled = [zero; C];
                let v_channels: &mut [X::V] = if C == 0 { room.as_mut_slice() } else { &mut unrolled };
                v_channels.fill(zero);
                let job = SplatBackward {
                    splat,
                    values: &stage.values[k * count..][..count],
                    place: (begin + k) as i32,
                    segments,
                    last,
                };
                let moments = job.pull_back::<X, C, COUNTED>(x, self.source, self.cotangent, &mut pixels, v_channels);
                let record = &mut self.records[(begin + k) * record_len..(begin + k + 1) * record_len];
                let (head, channels) = record.split_at_mut(PROJECTED_GRADIENT_LEN);
                head.copy_from_slice(&moments.gradient(x, splat, COUNTED).to_row());
                for (value, &sums) in channels.iter_mut().zip(v_channels.iter()) {
                    *value = sum_vector(x, sums);
                }
            }
        }
    }
}

/// The state of a tile's pixels, updated from back to front.
struct PixelState<T> {
    /// Transmittance behind the current Gaussian.
    transmittance: Plane<T>,
    /// Cotangent-weighted light from behind the current Gaussian.
    behind: Plane<T>,
    /// The same for the statistic.
    behind_counted: Plane<T>,
}

impl<T: Lane> PixelState<T> {
    #[inline(always)]
    fn new(source: &BlendGradientSource<T>, cotangent: &TileCotangent<T>, tile: usize) -> Self {
        let transmittance = source.transmittance[tile];
        let background = source.tiles.cloud.values.background;
        let behind = |planes: &[Plane<T>]| {
            // The last plane is alpha, which is one minus the transmittance.
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
    /// Its position in the tile's list.
    place: i32,
    segments: u32,
    last: &'a Plane<i32>,
}

impl<T: Lane> SplatBackward<'_, T> {
    /// Sums over the Gaussian's segments, and removes the Gaussian from the pixels' state.
    #[inline(always)]
    fn pull_back<X: Vectors<T>, const C: usize, const COUNTED: bool>(
        &self,
        x: X,
        source: &BlendGradientSource<T>,
        cotangent: &TileCotangent<T>,
        pixels: &mut PixelState<T>,
        v_channels: &mut [X::V],
    ) -> Moments<X::V> {
        let count = if C == 0 { source.tiles.cloud.channels() } else { C };
        let (all, values) = (&cotangent.all[..count], &self.values[..count]);
        let counted = cotangent.counted.as_ref().map_or(all, |planes| &planes[..count]);
        let dx = self.splat.offsets_x(x);
        let mut moments = Moments::new(x);
        for (half, dx) in dx.into_iter().enumerate() {
            let mut rows = (self.segments >> (half * TILE)) & ((1 << TILE) - 1);
            let mut columns = Columns::new(x);
            while rows != 0 {
                let row = rows.trailing_zeros() as usize % TILE;
                rows &= rows - 1;
                let segment = half * TILE + row;
                let falloff = self.splat.falloff(x, dx, self.splat.offset_y(row));
                let light = self.light(x, falloff, segment, source.tiles.view, &mut pixels.transmittance[segment]);
                for (plane, v_channel) in all.iter().zip(v_channels.iter_mut()) {
                    *v_channel = x.fma(light.weights, x.load(&plane[segment]), *v_channel);
                }
                let v = light.alpha_gradient(x, values, all, segment, &mut pixels.behind[segment]);
                columns.add(x, v, row);
                if COUNTED {
                    let v = light.alpha_gradient(x, values, counted, segment, &mut pixels.behind_counted[segment]);
                    columns.add_counted(x, v, row);
                }
            }
            moments.add_half(x, &columns, half);
        }
        moments
    }

    /// The compositing quantities at a segment. Resets the transmittance to its value before the Gaussian.
    #[inline(always)]
    fn light<X: Vectors<T>>(
        &self,
        x: X,
        falloff: X::V,
        segment: usize,
        view: &View<T>,
        transmittance: &mut Lanes<T>,
    ) -> Light<X::V> {
        let (zero, one) = (x.splat(T::zero()), x.splat(T::one()));
        let raw = x.mul(x.splat(self.splat.opacity), falloff);
        let alpha = x.min(raw, x.splat(view.alpha_clamp));
        let before_last = x.index_less(x.splat_index(self.place), x.load_index(&self.last[segment]));
        let added = x.both(x.at_most(x.splat(T::of(MIN_ALPHA)), alpha), before_last);
        let free = x.both(added, x.at_most(raw, x.splat(view.gradient_clamp)));
        let alpha = x.select(added, alpha, zero);
        let inverse = x.div(one, x.sub(one, alpha));
        let before = x.mul(x.load(transmittance), inverse);
        *transmittance = x.store(before);
        Light { before, inverse, weights: x.mul(alpha, before), gate: x.select(free, falloff, zero) }
    }
}

/// The compositing quantities at the pixels of a segment.
struct Light<V> {
    /// Transmittance before the Gaussian.
    before: V,
    /// `1 / (1 - alpha)`; alpha is zero where the forward pass did not add the Gaussian.
    inverse: V,
    /// `alpha * before`.
    weights: V,
    /// `d alpha / d opacity`: the falloff, or zero where no gradient passes.
    gate: V,
}

impl<V: Copy> Light<V> {
    /// Gradient of alpha times `d alpha / d opacity`. Adds the Gaussian to the light from behind.
    #[inline(always)]
    fn alpha_gradient<T: Lane, X: Vectors<T, V = V>>(
        &self,
        x: X,
        values: &[T],
        cotangents: &[Plane<T>],
        segment: usize,
        behind: &mut Lanes<T>,
    ) -> V {
        let mut shade = x.splat(T::zero());
        for (&value, plane) in values.iter().zip(cotangents) {
            shade = x.fma(x.load(&plane[segment]), x.splat(value), shade);
        }
        let from_behind = x.load(behind);
        let v_alpha = x.sub_product(x.mul(self.before, shade), from_behind, self.inverse);
        *behind = x.store(x.fma(self.weights, shade, from_behind));
        x.mul(v_alpha, self.gate)
    }
}
