//! Blending of the Gaussians of each tile, front to back.

use mvfusion_kernels::splat::{COLOUR_CHANNELS, MIN_ALPHA, PROJECTED_LEN, Projected, TILE, depth_channel};
use rayon::prelude::*;

use super::cloud::Cloud;
use super::lanes::{HALVES, LANES, Lane, Lanes, Plane, SEGMENTS, VectorJob, Vectors, columns};
use super::tiles::touched_segments;
use super::view::View;

/// Gaussians that are gathered at once. Open pixels are also determined once per batch.
pub(crate) const BATCH: usize = 32;

/// The blended image, by tiles.
pub(crate) struct Blended<T> {
    /// Channels of each tile: colour, features, depth.
    pub channels: Vec<Plane<T>>,
    /// Remaining transmittance, one plane per tile.
    pub transmittance: Vec<Plane<T>>,
    /// One plus the position in the tile's list of the last Gaussian that each pixel added.
    pub last: Vec<Plane<i32>>,
}

/// The data that all tiles of an image share.
#[derive(Clone, Copy)]
pub(crate) struct TileSource<'a, T> {
    pub cloud: Cloud<'a, T>,
    pub view: &'a View<T>,
    /// Rows of projected Gaussians.
    pub records: &'a [[T; PROJECTED_LEN]],
    /// Tile lists, see [`super::tiles::Bins`].
    pub sorted: &'a [i32],
    pub starts: &'a [i32],
}

impl<'a, T: Lane> TileSource<'a, T> {
    /// The Gaussians of a tile, front to back.
    pub fn list(&self, tile: usize) -> &'a [i32] {
        &self.sorted[self.starts[tile] as usize..self.starts[tile + 1] as usize]
    }

    /// First pixel of a tile.
    pub fn origin(&self, tile: usize) -> [usize; 2] {
        let columns = self.view.grid()[0];
        [tile % columns * TILE, tile / columns * TILE]
    }
}

/// Counts the work of blending. `()` counts nothing at no cost.
pub(crate) trait Tally: Default + Send {
    /// Called for each evaluated segment, with the weights of the Gaussian in its pixels (zero if it was not added).
    fn segment<T: Lane>(&mut self, weights: &Lanes<T>);
}

impl Tally for () {
    #[inline(always)]
    fn segment<T: Lane>(&mut self, _: &Lanes<T>) {}
}

/// Blends an image. Returns one tally per tile, in order.
pub(crate) fn blend<T: Lane, K: Tally>(source: &TileSource<T>) -> (Blended<T>, Vec<K>) {
    let (tiles, channels) = (source.view.tile_count(), source.cloud.channels());
    let mut blended = Blended {
        channels: vec![[[T::zero(); LANES]; SEGMENTS]; tiles * channels],
        transmittance: vec![[[T::zero(); LANES]; SEGMENTS]; tiles],
        last: vec![[[0; LANES]; SEGMENTS]; tiles],
    };
    let outputs = blended.channels.par_chunks_mut(channels).zip(&mut blended.transmittance).zip(&mut blended.last);
    let tallies = outputs
        .enumerate()
        .map(|(tile, ((channels, transmittance), last))| {
            let output = TileOutput { channels, transmittance, last };
            blend_tile(source, tile, output)
        })
        .collect();
    (blended, tallies)
}

struct TileOutput<'a, T> {
    channels: &'a mut [Plane<T>],
    transmittance: &'a mut Plane<T>,
    last: &'a mut Plane<i32>,
}

/// Selects a version with unrolled loops for the common numbers of channels.
fn blend_tile<T: Lane, K: Tally>(source: &TileSource<T>, tile: usize, output: TileOutput<T>) -> K {
    match source.cloud.channels() {
        4 if size_of::<T>() == 4 => T::run(BlendTile::<T, K, 4> { source, tile, output, tally: K::default() }),
        7 if size_of::<T>() == 4 => T::run(BlendTile::<T, K, 7> { source, tile, output, tally: K::default() }),
        _ => T::run(BlendTile::<T, K, 0> { source, tile, output, tally: K::default() }),
    }
}

/// One tile to blend, with `C` channels, or any number if `C` is 0.
struct BlendTile<'a, T, K, const C: usize> {
    source: &'a TileSource<'a, T>,
    tile: usize,
    output: TileOutput<'a, T>,
    tally: K,
}

impl<T: Lane, K: Tally, const C: usize> VectorJob<T> for BlendTile<'_, T, K, C> {
    type Output = K;

    #[inline(always)]
    fn run<X: Vectors<T>>(mut self, x: X) -> K {
        let count = if C == 0 { self.source.cloud.channels() } else { C };
        let channels = &mut self.output.channels[..count];
        let (list, origin) = (self.source.list(self.tile), self.source.origin(self.tile));
        *self.output.transmittance = inside_picture(origin, self.source.view);
        let mut stage = Stage::new(count);
        for (number, ids) in list.chunks(BATCH).enumerate() {
            let open = open_segments(x, self.output.transmittance);
            if open == 0 {
                break;
            }
            stage.gather(x, self.source, origin, ids);
            for (k, splat) in stage.splats[..ids.len()].iter().enumerate() {
                let mut segments = splat.segments & open;
                let values = &stage.values[k * count..][..count];
                let dx = splat.offsets_x(x);
                while segments != 0 {
                    let segment = segments.trailing_zeros() as usize % SEGMENTS;
                    segments &= segments - 1;
                    let falloff = splat.falloff(x, dx[segment / TILE], splat.offset_y(segment % TILE));
                    let pixels = Pixels {
                        transmittance: &mut self.output.transmittance[segment],
                        last: &mut self.output.last[segment],
                        place: (number * BATCH + k + 1) as i32,
                    };
                    let weights = pixels.composite_forward(x, splat.opacity, falloff, self.source.view);
                    for (channel, &value) in channels.iter_mut().zip(values) {
                        let sum = x.fma(weights, x.splat(value), x.load(&channel[segment]));
                        channel[segment] = x.store(sum);
                    }
                    self.tally.segment(&x.store(weights));
                }
            }
        }
        add_background::<T>(channels, self.output.transmittance, self.source.cloud.values.background);
        self.tally
    }
}

/// The state of a segment's pixels during blending.
struct Pixels<'a, T> {
    /// Positive while the pixel is open, negative once it is finished, zero outside the image.
    transmittance: &'a mut Lanes<T>,
    last: &'a mut Lanes<i32>,
    place: i32,
}

impl<T: Lane> Pixels<'_, T> {
    /// Blends the Gaussian into the pixels where it is visible, and returns its weights.
    #[inline(always)]
    fn composite_forward<X: Vectors<T>>(self, x: X, opacity: T, falloff: X::V, view: &View<T>) -> X::V {
        let zero = x.splat(T::zero());
        let alpha = x.min(x.mul(x.splat(opacity), falloff), x.splat(view.alpha_clamp));
        let before = x.load(self.transmittance);
        let after = x.sub_product(before, before, alpha);
        let seen = x.both(x.at_most(x.splat(T::of(MIN_ALPHA)), alpha), x.less(zero, before));
        let added = x.both(seen, x.at_most(x.splat(view.stop), after));
        let closed = x.select(seen, x.sub(zero, before), before);
        *self.transmittance = x.store(x.select(added, after, closed));
        *self.last = x.store_index(x.select_index(added, x.splat_index(self.place), x.load_index(self.last)));
        x.select(added, x.mul(alpha, before), zero)
    }
}

/// Transmittance before the first Gaussian: 1 inside the image, 0 outside.
fn inside_picture<T: Lane>(origin: [usize; 2], view: &View<T>) -> Plane<T> {
    std::array::from_fn(|segment| {
        let row = origin[1] + segment % TILE;
        let column = origin[0] + segment / TILE * LANES;
        std::array::from_fn(|lane| if row < view.height && column + lane < view.width { T::one() } else { T::zero() })
    })
}

/// Segments with an open pixel, one bit per segment.
#[inline(always)]
fn open_segments<T: Lane, X: Vectors<T>>(x: X, transmittance: &Plane<T>) -> u32 {
    let mut open = 0;
    for (segment, lanes) in transmittance.iter().enumerate() {
        let any = x.bits(x.less(x.splat(T::zero()), x.load(lanes))) != 0;
        open |= u32::from(any) << segment;
    }
    open
}

/// Drops the sign that marks finished pixels, and adds the background.
fn add_background<T: Lane>(channels: &mut [Plane<T>], transmittance: &mut Plane<T>, background: &[T]) {
    for left in transmittance.as_flattened_mut() {
        *left = left.abs();
    }
    for (channel, &colour) in channels.iter_mut().zip(background) {
        for (sum, &left) in channel.as_flattened_mut().iter_mut().zip(transmittance.as_flattened()) {
            *sum += left * colour;
        }
    }
}

/// A projected Gaussian in the coordinates of a tile.
#[derive(Clone, Copy, Default)]
pub(crate) struct Staged<T> {
    /// Offset from the Gaussian's centre to the centre of the tile's first pixel.
    pub first: [T; 2],
    pub half_curve_x: T,
    pub slope: T,
    pub half_curve_y: T,
    pub opacity: T,
    /// Segments that it may touch.
    pub segments: u32,
}

impl<T: Lane> Staged<T> {
    /// Offsets along x of the tile's columns from the Gaussian's centre.
    #[inline(always)]
    pub fn offsets_x<X: Vectors<T>>(&self, x: X) -> [X::V; HALVES] {
        // No closure here: it would be compiled without the instruction set of the caller.
        let first = x.splat(self.first[0]);
        [x.add(first, x.load(&columns(0))), x.add(first, x.load(&columns(1)))]
    }

    /// Offset along y of a row of the tile from the Gaussian's centre.
    #[inline(always)]
    pub fn offset_y(&self, row: usize) -> T {
        self.first[1] + T::COUNT[row]
    }

    /// `exp(-sigma)` at the pixels of a segment.
    #[inline(always)]
    pub fn falloff<X: Vectors<T>>(&self, x: X, dx: X::V, dy: T) -> X::V {
        let u = x.fma(x.splat(self.slope), x.splat(dy), dx);
        let along_y = x.splat(-self.half_curve_y * dy * dy);
        x.exp(x.sub_product(along_y, x.mul(x.splat(self.half_curve_x), u), u))
    }
}

/// A gathered batch of Gaussians of a tile.
pub(crate) struct Stage<T> {
    pub splats: [Staged<T>; BATCH],
    /// Channel values of each Gaussian: colour, features, depth.
    pub values: Vec<T>,
}

impl<T: Lane> Stage<T> {
    /// Allocates a batch.
    pub fn new(channels: usize) -> Self {
        Self { splats: [Staged::default(); BATCH], values: vec![T::zero(); BATCH * channels] }
    }

    /// Gathers the Gaussians `ids` for the tile at `origin`.
    #[inline(always)]
    pub fn gather<X: Vectors<T>>(&mut self, x: X, source: &TileSource<T>, origin: [usize; 2], ids: &[i32]) {
        let channels = self.values.len() / BATCH;
        let depth = depth_channel(channels);
        let (origin, half) = (origin.map(|x| T::of(x as f64)), T::of(0.5));
        let rooms = self.splats.iter_mut().zip(self.values.chunks_exact_mut(channels));
        for (&id, (staged, values)) in ids.iter().zip(rooms) {
            let splat = Projected::from_row(&source.records[id as usize]);
            *staged = Staged {
                first: [origin[0] + half - splat.centre[0], origin[1] + half - splat.centre[1]],
                half_curve_x: half * splat.curve_x,
                slope: splat.slope,
                half_curve_y: half * splat.curve_y,
                opacity: splat.opacity,
                segments: touched_segments(x, &splat, origin),
            };
            values[..COLOUR_CHANNELS].copy_from_slice(&splat.colour);
            values[COLOUR_CHANNELS..depth].copy_from_slice(source.cloud.features_of(id as usize));
            values[depth] = splat.depth;
        }
    }
}
