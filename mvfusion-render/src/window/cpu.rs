//! CPU twin of the window ops: each output row sums the columns of the rows around it, then sums along itself. Rows are
//! independent, so threads share nothing and the result does not depend on their number.

use std::array;

use rayon::prelude::*;

use super::Window;
use crate::Real;
use crate::simd::vectorised;

/// Neighbouring pixels that are worked on at once, in registers.
const LANES: usize = 16;

/// Rows that are worth a thread's while.
const MIN_ROWS: usize = 4;

/// The constants of SSIM for pictures in `0..=1` (METHOD §4.4), and that of its structure term.
const C1: f64 = 1e-4;
const C2: f64 = 9e-4;
const C3: f64 = C2 / 2.0;

/// Where the structure map is cut off (METHOD §4.4 item 4).
const STRUCTURE_MAX: f64 = 0.98;

/// Which similarity of two pictures.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) enum Similarity {
    /// SSIM.
    Ssim,
    /// The structure term K, within `0..=0.98`.
    Structure,
}

/// The windowed moments of two pictures at one pixel: mean a, mean b, mean a², mean b², mean ab.
type Moments<T> = [T; 5];

/// A similarity and its slopes with respect to mean a, mean b, mean a² or b² (they are equal) and mean ab.
type Point<T> = [T; 5];

/// Blurs planes of `[height, width]` pixels, stored one after another.
pub(super) fn blur<T: Real>(images: &[T], size: [usize; 2], window: &Window) -> Vec<T> {
    let none: [&[T]; 0] = [];
    let [out] = windowed(
        [images],
        none,
        size,
        window,
        #[inline(always)]
        |pixel| pixel,
        #[inline(always)]
        |sums, []| sums,
    );
    out
}

/// The similarity of `a` and `b` alone.
pub(super) fn similarity<T: Real>(kind: Similarity, pair: [&[T]; 2], size: [usize; 2], window: &Window) -> Vec<T> {
    let [map] = match kind {
        Similarity::Ssim => pointwise(
            pair,
            size,
            window,
            #[inline(always)]
            |moments| [ssim(moments)[0]],
        ),
        Similarity::Structure => pointwise(
            pair,
            size,
            window,
            #[inline(always)]
            |moments| [structure(moments)[0]],
        ),
    };
    map
}

/// The similarity of `a` and `b`, and the four slopes that its adjoint needs.
pub(super) fn similarity_with_slopes<T: Real>(
    kind: Similarity,
    pair: [&[T]; 2],
    size: [usize; 2],
    window: &Window,
) -> [Vec<T>; 5] {
    match kind {
        Similarity::Ssim => pointwise(
            pair,
            size,
            window,
            #[inline(always)]
            |moments| ssim(moments),
        ),
        Similarity::Structure => pointwise(
            pair,
            size,
            window,
            #[inline(always)]
            |moments| structure(moments),
        ),
    }
}

/// The adjoints of `a` and `b`: the window is its own adjoint, so the slopes times the cotangent are blurred back.
pub(super) fn similarity_backward<T: Real>(
    pair: [&[T]; 2],
    slopes: [&[T]; 4],
    v_map: &[T],
    size: [usize; 2],
    window: &Window,
) -> [Vec<T>; 2] {
    let [mean_a, mean_b, square, cross] = slopes;
    let two = T::of(2.0);
    windowed(
        [v_map, mean_a, mean_b, square, cross],
        pair,
        size,
        window,
        #[inline(always)]
        |[v, mean_a, mean_b, square, cross]| [v * mean_a, v * mean_b, v * square, v * cross],
        #[inline(always)]
        |[mean_a, mean_b, square, cross], [a, b]| {
            [mean_a + two * a * square + b * cross, mean_b + two * b * square + a * cross]
        },
    )
}

/// Functions of the windowed moments of two pictures.
fn pointwise<T: Real, const O: usize>(
    pair: [&[T]; 2],
    size: [usize; 2],
    window: &Window,
    function: impl Fn(Moments<T>) -> [T; O] + Sync,
) -> [Vec<T>; O] {
    let none: [&[T]; 0] = [];
    windowed(
        pair,
        none,
        size,
        window,
        #[inline(always)]
        |pair| products(pair),
        #[inline(always)]
        |moments, []| function(moments),
    )
}

#[inline(always)]
fn products<T: Real>([a, b]: [T; 2]) -> Moments<T> {
    [a, b, a * a, b * b, a * b]
}

/// Variances that rounding made negative count as zero, so that no denominator can vanish.
#[inline(always)]
fn variance<T: Real>(square: T, mean: T) -> T {
    (square - mean * mean).max(T::zero())
}

#[inline(always)]
fn ssim<T: Real>([mean_a, mean_b, square_a, square_b, cross]: Moments<T>) -> Point<T> {
    let two = T::of(2.0);
    let luminance = two * mean_a * mean_b + T::of(C1);
    let contrast = two * (cross - mean_a * mean_b) + T::of(C2);
    let means = mean_a * mean_a + mean_b * mean_b + T::of(C1);
    let variances = variance(square_a, mean_a) + variance(square_b, mean_b) + T::of(C2);
    let inverse = T::one() / (means * variances);
    let value = luminance * contrast * inverse;
    let (by_means, by_variances) = (value * variances * inverse, value * means * inverse);
    let slope = |mean: T, other: T| two * (other * (contrast - luminance) * inverse + mean * (by_variances - by_means));
    [value, slope(mean_a, mean_b), slope(mean_b, mean_a), -by_variances, two * luminance * inverse]
}

#[inline(always)]
fn structure<T: Real>([mean_a, mean_b, square_a, square_b, cross]: Moments<T>) -> Point<T> {
    let covariance = cross - mean_a * mean_b + T::of(C3);
    let variances = variance(square_a, mean_a) + variance(square_b, mean_b) + T::of(C3);
    let inverse = T::one() / variances.sqrt();
    let value = covariance * inverse;
    let clipped = value.max(T::zero()).min(T::of(STRUCTURE_MAX));
    let open = if clipped == value { inverse } else { T::zero() };
    let by_variances = value * inverse * open;
    let slope = |mean: T, other: T| mean * by_variances - other * open;
    [clipped, slope(mean_a, mean_b), slope(mean_b, mean_a), -by_variances * T::of(0.5), open]
}

/// The work of all ops here: `finish(window sums of product(maps), own)` for every pixel of every plane; `own` are maps
/// that are read at the pixel itself alone.
fn windowed<T: Real, const M: usize, const P: usize, const K: usize, const O: usize>(
    maps: [&[T]; M],
    own: [&[T]; P],
    [height, width]: [usize; 2],
    window: &Window,
    product: impl Fn([T; M]) -> [T; K] + Sync,
    finish: impl Fn([T; K], [T; P]) -> [T; O] + Sync,
) -> [Vec<T>; O] {
    let mut out: [Vec<T>; O] = array::from_fn(|_| vec![T::zero(); maps[0].len()]);
    if maps[0].is_empty() {
        return out;
    }
    let weights: Vec<T> = window.weights().iter().map(|&weight| T::of(f64::from(weight))).collect();
    let padded = width.next_multiple_of(LANES) + weights.len() - 1;
    rows_of(&mut out, width).into_par_iter().with_min_len(MIN_ROWS).enumerate().for_each_init(
        || array::from_fn(|_| vec![T::zero(); padded]),
        |sums: &mut [Vec<T>; K], (row, mut out)| {
            let first = row / height * height * width;
            let planes = maps.map(|map| &map[first..first + height * width]);
            let own = own.map(|map| &map[row * width..(row + 1) * width]);
            vectorised(
                #[inline(always)]
                || {
                    sum_columns(planes, row % height, &weights, &product, sums, width);
                    sum_along(sums, &weights, own, &finish, &mut out);
                },
            );
        },
    );
    out
}

/// The rows of several maps of one size: one array a row.
fn rows_of<T, const O: usize>(maps: &mut [Vec<T>; O], width: usize) -> Vec<[&mut [T]; O]> {
    let mut chunks = maps.each_mut().map(|map| map.chunks_mut(width));
    let rows = chunks[0].len();
    // Proof: all maps have the same length, so each has a chunk for every row.
    (0..rows).map(|_| chunks.each_mut().map(|chunk| chunk.next().expect("maps are of one size"))).collect()
}

/// The weighted column sums around `row`, written behind a margin of one window radius that stays zero.
#[inline(always)]
fn sum_columns<T: Real, const M: usize, const K: usize>(
    planes: [&[T]; M],
    row: usize,
    weights: &[T],
    product: impl Fn([T; M]) -> [T; K],
    sums: &mut [Vec<T>; K],
    width: usize,
) {
    let (radius, height) = (weights.len() / 2, planes[0].len() / width);
    let (top, bottom) = (row.saturating_sub(radius), (row + radius + 1).min(height));
    for start in (0..width).step_by(LANES) {
        let lanes = LANES.min(width - start);
        let mut totals = [[T::zero(); LANES]; K];
        for source in top..bottom {
            let weight = weights[source + radius - row];
            let pixels = lanes_of(planes, source * width + start, lanes);
            for lane in 0..LANES {
                let values = product(nth(&pixels, lane));
                for k in 0..K {
                    totals[k][lane] += weight * values[k];
                }
            }
        }
        for k in 0..K {
            // The sums reach to a multiple of LANES; what lies beyond the row is zero like the margin.
            sums[k][radius + start..][..LANES].copy_from_slice(&totals[k]);
        }
    }
}

/// Sums the column sums along the row, and writes what `finish` makes of each pixel's sums.
#[inline(always)]
fn sum_along<T: Real, const P: usize, const K: usize, const O: usize>(
    sums: &[Vec<T>; K],
    weights: &[T],
    own: [&[T]; P],
    finish: impl Fn([T; K], [T; P]) -> [T; O],
    out: &mut [&mut [T]; O],
) {
    let width = out[0].len();
    for start in (0..width).step_by(LANES) {
        let lanes = LANES.min(width - start);
        let mut totals = [[T::zero(); LANES]; K];
        for (tap, &weight) in weights.iter().enumerate() {
            for k in 0..K {
                let sums = lanes_at(&sums[k], start + tap);
                for lane in 0..LANES {
                    totals[k][lane] += weight * sums[lane];
                }
            }
        }
        let own = lanes_of(own, start, lanes);
        let mut finished = [[T::zero(); LANES]; O];
        for lane in 0..LANES {
            let values = finish(nth(&totals, lane), nth(&own, lane));
            for o in 0..O {
                finished[o][lane] = values[o];
            }
        }
        for o in 0..O {
            let out = &mut out[o][start..];
            if lanes == LANES {
                out[..LANES].copy_from_slice(&finished[o]);
            } else {
                out.copy_from_slice(&finished[o][..lanes]);
            }
        }
    }
}

/// The next `lanes` numbers of each map from `at` on, with zeros behind them.
#[inline(always)]
fn lanes_of<T: Real, const M: usize>(maps: [&[T]; M], at: usize, lanes: usize) -> [[T; LANES]; M] {
    let mut out = [[T::zero(); LANES]; M];
    for m in 0..M {
        if lanes == LANES {
            out[m] = *lanes_at(maps[m], at);
        } else {
            out[m][..lanes].copy_from_slice(&maps[m][at..at + lanes]);
        }
    }
    out
}

/// A slice's next [`LANES`] numbers from `at` on.
#[inline(always)]
fn lanes_at<T>(numbers: &[T], at: usize) -> &[T; LANES] {
    // Proof: the slice taken has exactly that length.
    numbers[at..at + LANES].try_into().expect("a slice of that length")
}

/// One lane of each map; a loop, because `array::map` is not inlined where vector instructions are chosen.
#[inline(always)]
fn nth<T: Real, const M: usize>(maps: &[[T; LANES]; M], lane: usize) -> [T; M] {
    let mut out = [T::zero(); M];
    for m in 0..M {
        out[m] = maps[m][lane];
    }
    out
}
