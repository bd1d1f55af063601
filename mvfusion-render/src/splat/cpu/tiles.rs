//! The Gaussians that touch each tile, in blending order.

use std::sync::atomic::{AtomicI32, AtomicUsize, Ordering};

use mvfusion_kernels::splat::{PROJECTED_LEN, Projected, TILE, TOUCH_ROUNDINGS};
use rayon::prelude::*;

use super::depth_order::depth_order;
use super::lanes::{HALVES, LANES, Lane, Vectors, columns};
use super::project::Projections;
use super::tile_rectangle::TileRectangle;
use super::view::View;
use crate::splat::SplatError;

/// Minimum number of Gaussians per chunk, so that a chunk's counters are worth their memory.
const MIN_GAUSSIANS_PER_CHUNK: usize = 1024;
/// Gaussians that are loaded together. In order of depth they are scattered in memory; loading them one by one took
/// half the time of binning.
const GATHERED: usize = 16;
/// Pairs of a Gaussian and a tile that a chunk may have more than it has told the other chunks.
const UNTOLD_PAIRS: usize = 1 << 16;
/// The most pairs of a Gaussian and a tile that an index can count.
const MOST_PAIRS: usize = i32::MAX as usize;

/// The tile lists of an image.
pub(crate) struct Bins {
    /// Gaussians by tile, within a tile by depth, ties by index.
    pub sorted: Vec<i32>,
    /// Start of each tile's list in `sorted`, with one more entry for the end.
    pub starts: Vec<i32>,
    /// The start and the number of each Gaussian's positions, then the positions in `sorted`, by Gaussian and within a
    /// Gaussian by tile.
    pub slots: Vec<i32>,
}

impl Bins {
    /// The lists of an empty image.
    pub fn none(gaussians: usize, tiles: usize) -> Self {
        Self { sorted: Vec::new(), starts: vec![0; tiles + 1], slots: vec![0; 2 * gaussians] }
    }
}

/// Whether the ellipse at the smallest visible alpha touches the box of pixel centres `low..=high`.
///
/// Errors never lose a pixel: the offset along the sheared axis is reduced by the possible rounding error, here and at
/// the pixel.
#[inline(always)]
pub(crate) fn touches_box<T: Lane>(splat: &Projected<T>, low: [T; 2], high: [T; 2]) -> bool {
    let zero = T::zero();
    let low = [low[0] - splat.centre[0], low[1] - splat.centre[1]];
    let high = [high[0] - splat.centre[0], high[1] - splat.centre[1]];
    let nearest = [zero.max(low[0]).min(high[0]), zero.max(low[1]).min(high[1])];
    if nearest == [zero; 2] {
        return splat.reach > zero;
    }
    let rounding = T::of(TOUCH_ROUNDINGS)
        * T::ROUNDING
        * (low[0].abs().max(high[0].abs())
            + splat.slope.abs() * low[1].abs().max(high[1].abs())
            + splat.centre[0].abs()
            + splat.centre[1].abs() * splat.slope.abs());
    let sigma = |dx: T, dy: T| {
        let u = ((dx + splat.slope * dy).abs() - rounding).max(zero);
        T::of(0.5) * (splat.curve_x * u * u + splat.curve_y * dy * dy)
    };
    // The minimum over the box is on a side that faces the centre.
    let shear = splat.curve_x * splat.slope;
    let dy = (-shear * nearest[0] / (splat.curve_y + shear * splat.slope)).max(low[1]).min(high[1]);
    let dx = (-splat.slope * nearest[1]).max(low[0]).min(high[0]);
    sigma(nearest[0], dy).min(sigma(dx, nearest[1])) <= splat.reach
}

/// The segments that the Gaussian may touch, one bit per segment, in the tile whose first pixel is `origin`.
#[inline(always)]
pub(crate) fn touched_segments<T: Lane, X: Vectors<T>>(x: X, splat: &Projected<T>, origin: [T; 2]) -> u32 {
    let half = T::of(0.5);
    let first = [origin[0] + half - splat.centre[0], origin[1] + half - splat.centre[1]];
    let span = T::of((TILE - 1) as f64);
    let farthest = [0, 1].map(|axis| first[axis].abs().max((first[axis] + span).abs()));
    let rounding = T::of(TOUCH_ROUNDINGS)
        * T::ROUNDING
        * (farthest[0]
            + splat.slope.abs() * farthest[1]
            + splat.centre[0].abs()
            + splat.centre[1].abs() * splat.slope.abs());
    let (limit, slope) = (x.splat(splat.reach + splat.reach), x.splat(splat.slope));
    let (curve_x, curve_y) = (x.splat(splat.curve_x), x.splat(splat.curve_y));
    let mut mask = 0;
    for rows in 0..TILE / LANES {
        let dy = x.add(x.splat(first[1] + T::of((rows * LANES) as f64)), x.load(&columns(0)));
        let (shift, beside) = (x.mul(slope, dy), x.mul(curve_y, x.mul(dy, dy)));
        for side in 0..HALVES {
            let low = first[0] + T::of((side * LANES) as f64) - rounding;
            let high = low + T::of((LANES - 1) as f64) + rounding + rounding;
            // Distance of the segment from the sheared axis, on either side.
            let (left, right) = (x.add(x.splat(low), shift), x.sub(x.splat(-high), shift));
            let u = x.max(x.max(left, right), x.splat(T::zero()));
            let touched = x.at_most(x.fma(curve_x, x.mul(u, u), beside), limit);
            mask |= x.bits(touched) << (side * TILE + rows * LANES);
        }
    }
    mask
}

/// The tiles of one chunk of Gaussians, in order of depth.
struct Chunk {
    /// Tiles of its Gaussians, one Gaussian after another.
    tiles: Vec<u32>,
    /// Number of tiles of each Gaussian.
    counts: Vec<u32>,
    /// Number of Gaussians per tile; later, the position of the chunk's first entry in the tile.
    per_tile: Vec<u32>,
}

/// The pairs of a Gaussian and a tile in all chunks together, and their limit.
struct PairTotal {
    pairs: AtomicUsize,
    most: usize,
}

impl PairTotal {
    /// Adds the pairs of a chunk.
    ///
    /// # Errors
    /// If there are then more than the limit. There is no way back, so all chunks end early.
    fn add(&self, pairs: usize) -> Result<(), SplatError> {
        let total = self.pairs.fetch_add(pairs, Ordering::Relaxed).saturating_add(pairs);
        if total > self.most { Err(SplatError::Pairs(u32::try_from(total).unwrap_or(u32::MAX))) } else { Ok(()) }
    }
}

/// Bins projected Gaussians.
///
/// # Errors
/// If there are 2³¹ or more pairs of a Gaussian and a tile.
pub(crate) fn bin<T: Lane>(projections: &Projections<T>, view: &View<T>) -> Result<Bins, SplatError> {
    bin_up_to(MOST_PAIRS, projections, view)
}

/// Bins projected Gaussians if they have at most so many pairs.
fn bin_up_to<T: Lane>(most: usize, projections: &Projections<T>, view: &View<T>) -> Result<Bins, SplatError> {
    let order = depth_order(projections);
    let chunk_len = order.len().div_ceil(4 * rayon::current_num_threads()).max(MIN_GAUSSIANS_PER_CHUNK);
    let pairs = PairTotal { pairs: AtomicUsize::new(0), most };
    let chunks = order.par_chunks(chunk_len).map(|ids| chunk_tiles(projections, view, ids, &pairs));
    let mut chunks = chunks.collect::<Result<Vec<Chunk>, SplatError>>()?;
    let starts = place(&mut chunks, view.tile_count());
    let total = starts[view.tile_count()] as usize;

    let (sorted, spans) = (atomics(total), atomics(projections.radii.len()));
    let mut slots = vec![0i32; spans.len() + total];
    let (head, mut rest) = slots.split_at_mut(spans.len());
    let mut jobs = Vec::with_capacity(chunks.len());
    for (chunk, ids) in chunks.into_iter().zip(order.chunks(chunk_len)) {
        let begin = total - rest.len();
        let (mine, others) = rest.split_at_mut(chunk.tiles.len());
        rest = others;
        jobs.push((chunk, ids, begin, mine));
    }
    jobs.into_par_iter().for_each(|(chunk, ids, begin, slots)| {
        fill_spans(&chunk, ids, begin, &spans);
        fill(chunk, ids, slots, &sorted);
    });
    head.copy_from_slice(&plain(spans));
    Ok(Bins { sorted: plain(sorted), starts, slots })
}

fn atomics(count: usize) -> Vec<AtomicI32> {
    std::iter::repeat_with(AtomicI32::default).take(count).collect()
}

fn plain(atomics: Vec<AtomicI32>) -> Vec<i32> {
    atomics.into_iter().map(AtomicI32::into_inner).collect()
}

/// The tiles of a chunk. Ends early if all chunks together have too many pairs.
fn chunk_tiles<T: Lane>(
    projections: &Projections<T>,
    view: &View<T>,
    ids: &[u32],
    pairs: &PairTotal,
) -> Result<Chunk, SplatError> {
    let columns = view.grid()[0];
    let mut chunk = Chunk {
        tiles: Vec::with_capacity(4 * ids.len()),
        counts: Vec::with_capacity(ids.len()),
        per_tile: vec![0; view.tile_count()],
    };
    let (records, radii) = (projections.records.as_chunks::<PROJECTED_LEN>().0, projections.radii.as_chunks::<2>().0);
    let mut gathered = [(Projected::default(), [0; 2]); GATHERED];
    let mut told = 0;
    for ids in ids.chunks(GATHERED) {
        for (splat, &id) in gathered.iter_mut().zip(ids) {
            *splat = (Projected::from_row(&records[id as usize]), radii[id as usize]);
        }
        for (splat, radii) in &gathered[..ids.len()] {
            chunk.add(splat, TileRectangle::of(splat.centre, *radii, view), columns);
        }
        // Not for every Gaussian: the threads would wait for each other.
        if chunk.tiles.len() - told > UNTOLD_PAIRS {
            pairs.add(chunk.tiles.len() - told)?;
            told = chunk.tiles.len();
        }
    }
    pairs.add(chunk.tiles.len() - told)?;
    Ok(chunk)
}

impl Chunk {
    /// Adds a Gaussian to the tiles that it touches in a rectangle.
    fn add<T: Lane>(&mut self, splat: &Projected<T>, rectangle: TileRectangle, columns: usize) {
        let (half, last) = (T::of(0.5), T::of(TILE as f64 - 0.5));
        let before = self.tiles.len();
        for row in rectangle.low[1]..rectangle.high[1] {
            for column in rectangle.low[0]..rectangle.high[0] {
                let origin = [column, row].map(|i| T::of((i * TILE) as f64));
                if touches_box(splat, origin.map(|x| x + half), origin.map(|x| x + last)) {
                    let tile = row * columns + column;
                    self.tiles.push(tile as u32);
                    self.per_tile[tile] += 1;
                }
            }
        }
        self.counts.push((self.tiles.len() - before) as u32);
    }
}

/// Turns the counts of the chunks into positions, and returns the start of each tile. The chunks have at most
/// [`MOST_PAIRS`] pairs.
fn place(chunks: &mut [Chunk], tile_count: usize) -> Vec<i32> {
    let mut starts = Vec::with_capacity(tile_count + 1);
    let mut next = 0u32;
    for tile in 0..tile_count {
        starts.push(next as i32);
        for chunk in chunks.iter_mut() {
            let count = chunk.per_tile[tile];
            chunk.per_tile[tile] = next;
            next += count;
        }
    }
    starts.push(next as i32);
    starts
}

/// Writes the spans of a chunk's Gaussians, the first of which begins at `begin`. Each Gaussian is in one chunk.
fn fill_spans(chunk: &Chunk, ids: &[u32], begin: usize, spans: &[AtomicI32]) {
    let mut begin = begin as i32;
    for (&id, &count) in ids.iter().zip(&chunk.counts) {
        for (place, value) in [begin, count as i32].into_iter().enumerate() {
            spans[2 * id as usize + place].store(value, Ordering::Relaxed);
        }
        begin += count as i32;
    }
}

/// Writes a chunk's Gaussians to their positions. The positions of all chunks are disjoint; atomics only satisfy the
/// compiler.
fn fill(mut chunk: Chunk, ids: &[u32], slots: &mut [i32], sorted: &[AtomicI32]) {
    let mut entries = chunk.tiles.iter().zip(slots);
    for (&id, &count) in ids.iter().zip(&chunk.counts) {
        for (&tile, slot) in entries.by_ref().take(count as usize) {
            let place = &mut chunk.per_tile[tile as usize];
            sorted[*place as usize].store(id as i32, Ordering::Relaxed);
            *slot = *place as i32;
            *place += 1;
        }
    }
}

#[cfg(test)]
mod tests {
    use glam::{DMat3, DVec3};
    use mvfusion_data::Camera;

    use super::*;
    use crate::splat::{SplatRules, SplatSettings};

    fn view(rules: SplatRules) -> View<f64> {
        let camera = Camera::centred(64, 48, 50.0, DMat3::IDENTITY, DVec3::ZERO);
        View::new(&camera, &SplatSettings { rules, ..Default::default() })
    }

    /// A long, thin Gaussian along the diagonal, wide along u = (1, 1) and narrow across.
    fn needle(centre: [f64; 2]) -> Projected<f64> {
        let [xx, xy, yy] = [100.5, 99.5, 100.5];
        let determinant = xx * yy - xy * xy;
        Projected {
            centre,
            curve_x: yy / determinant,
            slope: -xy / yy,
            curve_y: 1.0 / yy,
            opacity: 1.0,
            reach: 255f64.ln(),
            depth: 1.0,
            colour: [1.0; 3],
        }
    }

    #[test]
    fn the_square_rectangle_follows_the_integer_arithmetic_of_3dgs() {
        let of = |x: f64| TileRectangle::of([x, 8.0], [3, 3], &view(SplatRules::inria()));
        // (12.5 - 0.5 + 3 + 15) / 16 = 1.875 is truncated to 1: the next tile is not reached by three pixels.
        assert_eq!((of(12.5).low[0], of(12.5).high[0]), (0, 1));
        assert_eq!((of(14.5).low[0], of(14.5).high[0]), (0, 2));
        assert!(of(-20.0).is_empty() && of(1e12).is_empty());
    }

    #[test]
    fn a_tile_is_touched_if_a_segment_is_and_a_segment_if_a_pixel_is_visible() {
        struct Touched(Projected<f64>, [f64; 2]);
        impl crate::splat::cpu::lanes::VectorJob<f64> for Touched {
            type Output = u32;
            fn run<X: Vectors<f64>>(self, x: X) -> u32 {
                touched_segments(x, &self.0, self.1)
            }
        }
        for centre in [[20.0, 20.0], [3.3, 40.7], [-10.0, -12.0]] {
            let splat = needle(centre);
            for (x, y) in (0..4).flat_map(|x| (0..3).map(move |y| (f64::from(16 * x), f64::from(16 * y)))) {
                let tile = touches_box(&splat, [x + 0.5, y + 0.5], [x + 15.5, y + 15.5]);
                let segments = f64::run(Touched(splat, [x, y]));
                assert!(tile || segments == 0, "tile at {x}, {y}");
                let visible = (0..256).filter(|pixel| {
                    let d = [x + 0.5 + f64::from(pixel % 16) - centre[0], y + 0.5 + f64::from(pixel / 16) - centre[1]];
                    let u = d[0] + splat.slope * d[1];
                    0.5 * (splat.curve_x * u * u + splat.curve_y * d[1] * d[1]) <= splat.reach
                });
                for pixel in visible {
                    let segment = pixel % 16 / 8 * 16 + pixel / 16;
                    assert!(segments >> segment & 1 == 1, "pixel {pixel} of the tile at {x}, {y}");
                }
            }
        }
    }

    /// Depths of [`needles`].
    const DEPTHS: [f64; 4] = [3.0, 1.0, 2.0, 3.0];

    /// Gaussians with these radii along both axes.
    fn needles(radius: i32) -> Projections<f64> {
        let centres = [[8.0, 8.0], [20.0, 20.0], [24.0, 8.0], [9.0, 9.0]];
        let records = centres.into_iter().zip(DEPTHS).flat_map(|(c, depth)| Projected { depth, ..needle(c) }.to_row());
        Projections { records: records.collect(), radii: vec![radius; 2 * DEPTHS.len()] }
    }

    #[test]
    fn more_pairs_than_an_index_counts_are_refused() {
        let (projections, view) = (needles(31), view(SplatRules::inria()));
        let pairs = bin(&projections, &view).expect("few pairs").sorted.len();
        assert!(pairs > DEPTHS.len(), "a needle touches several tiles");
        assert!(bin_up_to(pairs, &projections, &view).is_ok());
        let refused = bin_up_to(pairs - 1, &projections, &view).err();
        assert_eq!(refused, Some(SplatError::Pairs(pairs as u32)));
    }

    #[test]
    fn pairs_of_several_chunks_are_counted_together() {
        let pairs = PairTotal { pairs: AtomicUsize::new(0), most: MOST_PAIRS };
        assert_eq!(pairs.add(MOST_PAIRS - 1), Ok(()));
        assert_eq!(pairs.add(1), Ok(()));
        assert_eq!(pairs.add(1), Err(SplatError::Pairs(1 << 31)));
        assert_eq!(pairs.add(0), Err(SplatError::Pairs(1 << 31)));
    }

    #[test]
    fn no_lists_are_those_of_gaussians_that_are_not_visible() {
        let view = view(SplatRules::inria());
        let bins = bin(&needles(0), &view).expect("no pairs");
        let none = Bins::none(DEPTHS.len(), view.tile_count());
        assert_eq!((bins.sorted, bins.starts, bins.slots), (none.sorted, none.starts, none.slots));
    }

    #[test]
    fn lists_are_sorted_by_depth_and_slots_lead_back() {
        let (projections, view) = (needles(31), view(SplatRules::inria()));
        let bins = bin(&projections, &view).expect("few pairs");
        for tile in 0..view.tile_count() {
            let list = &bins.sorted[bins.starts[tile] as usize..bins.starts[tile + 1] as usize];
            let keys: Vec<(f64, i32)> = list.iter().map(|&id| (DEPTHS[id as usize], id)).collect();
            assert!(keys.windows(2).all(|pair| pair[0] < pair[1]), "{keys:?}");
        }
        let (spans, slots) = bins.slots.split_at(2 * DEPTHS.len());
        for (id, span) in spans.as_chunks::<2>().0.iter().enumerate() {
            let slots = &slots[span[0] as usize..(span[0] + span[1]) as usize];
            assert!(slots.iter().all(|&slot| bins.sorted[slot as usize] == id as i32) && slots.is_sorted());
        }
        assert_eq!(slots.len(), bins.sorted.len());
    }
}
