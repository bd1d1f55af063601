//! CPU twin of the window ops. Each output row first sums the columns of the rows around it, then sums along the row.
//! Rows are independent, so the result does not depend on the number of threads.
#![allow(clippy::needless_range_loop, reason = "lane loops over several arrays become vector instructions as they are")]

use std::array;

use pulp::{Arch, Simd, WithSimd};
use rayon::prelude::*;

use super::Window;
use super::similarity::{Blur, FirstAdjoint, Similarity, SimilarityAdjoint, Traced, Weighted, Windowed};
use crate::simd::{Lanes, MAX_LANES, Wide};

/// Minimum number of rows per task.
const MIN_ROWS: usize = 4;

/// Number of vectors summed in parallel.
const VECTORS: usize = 2;

/// Minimum width of a row: one block of vectors.
const MIN_WIDTH: usize = VECTORS * MAX_LANES;

/// Blurs planes of `[height, width]` pixels, stored one after another.
pub(super) fn blur<T: Lanes>(images: &[T], size: [usize; 2], window: &Window) -> Vec<T> {
    let [out] = windowed(Blur, [images], [], size, window);
    out
}

/// The similarity of two images, without derivatives.
pub(super) fn similarity<T: Lanes>(kind: Similarity, pair: [&[T]; 2], size: [usize; 2], window: &Window) -> Vec<T> {
    let [map] = windowed(kind, pair, [], size, window);
    map
}

/// The similarity of two images, and the four derivatives that its adjoint needs.
pub(super) fn similarity_with_slopes<T: Lanes>(
    kind: Similarity,
    pair: [&[T]; 2],
    size: [usize; 2],
    window: &Window,
) -> [Vec<T>; 5] {
    windowed(Traced(kind), pair, [], size, window)
}

/// The adjoints of the two images.
pub(super) fn similarity_backward<T: Lanes>(
    pair: [&[T]; 2],
    slopes: [&[T]; 4],
    v_map: &[T],
    size: [usize; 2],
    window: &Window,
) -> [Vec<T>; 2] {
    let [mean_a, mean_b, square, cross] = slopes;
    windowed(SimilarityAdjoint, [v_map, mean_a, mean_b, square, cross], pair, size, window)
}

/// The similarity of two images, and its derivatives with respect to mean a, mean a² + b² and mean ab, times a weight
/// per pixel.
pub(crate) fn weighted_similarity<T: Lanes>(
    kind: Similarity,
    pair: [&[T]; 2],
    weights: &[T],
    size: [usize; 2],
    window: &Window,
) -> [Vec<T>; 4] {
    windowed(Weighted(kind), pair, [weights], size, window)
}

/// The adjoint of the first image for the weighted sum of a similarity, from its weighted derivatives.
pub(crate) fn weighted_backward<T: Lanes>(
    pair: [&[T]; 2],
    slopes: [&[T]; 3],
    size: [usize; 2],
    window: &Window,
) -> Vec<T> {
    let [first] = windowed(FirstAdjoint, slopes, pair, size, window);
    first
}

/// Applies `work` to the window around every pixel of every plane. `own` are maps that are read only at the pixel
/// itself.
fn windowed<T: Lanes, W: Windowed<M, P, K, O>, const M: usize, const P: usize, const K: usize, const O: usize>(
    work: W,
    maps: [&[T]; M],
    own: [&[T]; P],
    [height, width]: [usize; 2],
    window: &Window,
) -> [Vec<T>; O] {
    if maps[0].is_empty() {
        return array::from_fn(|_| Vec::new());
    }
    if width < MIN_WIDTH {
        // Zeros on the right do not change the result, because pixels outside are zero. The extra columns are removed
        // again.
        let (maps, own) =
            (maps.map(|map| with_width(map, width, MIN_WIDTH)), own.map(|map| with_width(map, width, MIN_WIDTH)));
        let (maps, own) = (maps.each_ref().map(Vec::as_slice), own.each_ref().map(Vec::as_slice));
        let wide = windowed(work, maps, own, [height, MIN_WIDTH], window);
        return wide.map(|map| with_width(&map, MIN_WIDTH, width));
    }
    let mut out: [Vec<T>; O] = array::from_fn(|_| vec![T::zero(); maps[0].len()]);
    let weights: Vec<T> = window.weights().iter().map(|&weight| T::of(f64::from(weight))).collect();
    let arch = Arch::new();
    rows_of(&mut out, width).into_par_iter().with_min_len(MIN_ROWS).enumerate().for_each_init(
        || array::from_fn(|_| vec![T::zero(); width + weights.len() - 1]),
        |sums: &mut [Vec<T>; K], (row, mut out)| {
            let first = row / height * height * width;
            let planes = maps.map(|map| &map[first..first + height * width]);
            let own = own.map(|map| &map[row * width..(row + 1) * width]);
            arch.dispatch(Row { work, planes, own, row: row % height, weights: &weights, sums, out: &mut out });
        },
    );
    out
}

/// Rows of `from` values as rows of `to` values, cropped or padded with zeros.
fn with_width<T: Lanes>(map: &[T], from: usize, to: usize) -> Vec<T> {
    let rows = map.chunks(from);
    rows.flat_map(|row| (0..to).map(|column| row.get(column).copied().unwrap_or(T::zero()))).collect()
}

/// The rows of several maps of the same size: one array per row.
fn rows_of<T, const O: usize>(maps: &mut [Vec<T>; O], width: usize) -> Vec<[&mut [T]; O]> {
    let mut chunks = maps.each_mut().map(|map| map.chunks_mut(width));
    let rows = chunks[0].len();
    // Proof: all maps have the same length, so each has a chunk for every row.
    (0..rows).map(|_| chunks.each_mut().map(|chunk| chunk.next().expect("maps are of one size"))).collect()
}

/// The work for one row of one plane.
struct Row<'a, T, W, const M: usize, const P: usize, const K: usize, const O: usize> {
    work: W,
    planes: [&'a [T]; M],
    own: [&'a [T]; P],
    row: usize,
    weights: &'a [T],
    sums: &'a mut [Vec<T>; K],
    out: &'a mut [&'a mut [T]; O],
}

impl<T: Lanes, W: Windowed<M, P, K, O>, const M: usize, const P: usize, const K: usize, const O: usize> WithSimd
    for Row<'_, T, W, M, P, K, O>
{
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(mut self, simd: S) {
        self.sum_columns(simd);
        self.sum_along(simd);
    }
}

impl<T: Lanes, W: Windowed<M, P, K, O>, const M: usize, const P: usize, const K: usize, const O: usize>
    Row<'_, T, W, M, P, K, O>
{
    /// The starts of blocks of [`VECTORS`] vectors. The last block overlaps its neighbour and repeats its values.
    #[inline(always)]
    fn blocks(width: usize, block: usize) -> impl Iterator<Item = usize> {
        (0..width).step_by(block).map(move |start| start.min(width - block))
    }

    /// The pixels of all maps in a block of a row.
    #[inline(always)]
    fn pixels<S: Simd>(&self, simd: S, row: usize, start: usize) -> [[Wide<S, T>; M]; VECTORS] {
        let (lanes, width) = (Wide::<S, T>::LANES, self.out[0].len());
        let mut pixels = [[Wide::<S, T>::splat(simd, T::zero()); M]; VECTORS];
        for m in 0..M {
            let row = &self.planes[m][row * width + start..][..VECTORS * lanes];
            for vector in 0..VECTORS {
                pixels[vector][m] = Wide::load(simd, row, vector * lanes);
            }
        }
        pixels
    }

    /// Writes the weighted column sums around the row, after a margin of one window radius that stays zero.
    #[inline(always)]
    fn sum_columns<S: Simd>(&mut self, simd: S) {
        let (radius, width) = (self.weights.len() / 2, self.out[0].len());
        let (lanes, block) = (Wide::<S, T>::LANES, VECTORS * Wide::<S, T>::LANES);
        let (top, bottom) =
            (self.row.saturating_sub(radius), (self.row + radius + 1).min(self.planes[0].len() / width));
        let weights = &self.weights[top + radius - self.row..][..bottom - top];
        let zero = Wide::<S, T>::splat(simd, T::zero());
        let outside = Wide::<S, T>::splat(simd, T::one() - weights.iter().copied().sum::<T>());
        for start in Self::blocks(width, block) {
            let middle = self.pixels(simd, self.row, start);
            let mut totals = [[zero; K]; VECTORS];
            for (source, &weight) in (top..bottom).zip(weights) {
                let weight = Wide::splat(simd, weight);
                let pixels = self.pixels(simd, source, start);
                for vector in 0..VECTORS {
                    let values = self.work.product(pixels[vector], middle[vector]);
                    for k in 0..K {
                        totals[vector][k] = totals[vector][k] + weight * values[k];
                    }
                }
            }
            for vector in 0..VECTORS {
                let black = self.work.product([zero; M], middle[vector]);
                for k in 0..K {
                    totals[vector][k] = totals[vector][k] + outside * black[k];
                }
                let column = self.work.column(totals[vector], middle[vector]);
                for k in 0..K {
                    column[k].store(&mut self.sums[k][radius + start..][..block], vector * lanes);
                }
            }
        }
    }

    /// The column sums `offset` columns to the right of the start of the margin.
    #[inline(always)]
    fn columns<S: Simd>(&self, simd: S, offset: usize) -> [Wide<S, T>; K] {
        let mut columns = [Wide::<S, T>::splat(simd, T::zero()); K];
        for k in 0..K {
            columns[k] = Wide::load(simd, &self.sums[k], offset);
        }
        columns
    }

    /// Sums the column sums along the row, and writes the work's results for each pixel.
    #[inline(always)]
    fn sum_along<S: Simd>(&mut self, simd: S) {
        let (radius, width) = (self.weights.len() / 2, self.out[0].len());
        let (lanes, block) = (Wide::<S, T>::LANES, VECTORS * Wide::<S, T>::LANES);
        let zero = Wide::<S, T>::splat(simd, T::zero());
        for start in Self::blocks(width, block) {
            for vector in 0..VECTORS {
                let at = start + vector * lanes;
                let middle = self.columns(simd, at + radius);
                let mut totals = [zero; K];
                // The window is symmetric, so two taps with the same weight are multiplied together.
                for tap in 0..radius {
                    let weight = Wide::splat(simd, self.weights[tap]);
                    let left = self.work.along(self.columns(simd, at + tap), middle);
                    let right = self.work.along(self.columns(simd, at + 2 * radius - tap), middle);
                    for k in 0..K {
                        totals[k] = totals[k] + weight * (left[k] + right[k]);
                    }
                }
                let (weight, own) = (Wide::splat(simd, self.weights[radius]), self.work.along(middle, middle));
                for k in 0..K {
                    totals[k] = totals[k] + weight * own[k];
                }
                self.finish(simd, at, totals, middle);
            }
        }
    }

    /// Writes the work's results for a vector of pixels.
    #[inline(always)]
    fn finish<S: Simd>(&mut self, simd: S, at: usize, totals: [Wide<S, T>; K], middle: [Wide<S, T>; K]) {
        let mut own = [Wide::<S, T>::splat(simd, T::zero()); P];
        for p in 0..P {
            own[p] = Wide::load(simd, self.own[p], at);
        }
        let finished = self.work.finish(totals, middle, own);
        for o in 0..O {
            finished[o].store(self.out[o], at);
        }
    }
}
