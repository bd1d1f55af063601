//! What the window ops compute at one pixel, before and after the window's sums.

use pulp::Simd;

use crate::simd::{Lanes, Wide};

/// The constants of SSIM for pictures in `0..=1` (METHOD §4.4), and that of its structure term.
pub(crate) const C1: f64 = 1e-4;
pub(crate) const C2: f64 = 9e-4;
pub(crate) const C3: f64 = C2 / 2.0;

/// Where the structure map is cut off (METHOD §4.4 item 4).
pub(crate) const STRUCTURE_MAX: f64 = 0.98;

/// A computation around window sums: of `M` maps it sums `K` products, and of the sums and `P` numbers of the pixel
/// itself it makes `O` results.
pub(super) trait Windowed<const M: usize, const P: usize, const K: usize, const O: usize>: Copy + Sync {
    /// What is summed.
    fn product<S: Simd, T: Lanes>(self, maps: [Wide<S, T>; M]) -> [Wide<S, T>; K];

    /// What is made of the sums.
    fn finish<S: Simd, T: Lanes>(self, sums: [Wide<S, T>; K], own: [Wide<S, T>; P]) -> [Wide<S, T>; O];
}

/// The sums themselves.
#[derive(Clone, Copy)]
pub(super) struct Blur;

impl Windowed<1, 0, 1, 1> for Blur {
    #[inline(always)]
    fn product<S: Simd, T: Lanes>(self, maps: [Wide<S, T>; 1]) -> [Wide<S, T>; 1] {
        maps
    }

    #[inline(always)]
    fn finish<S: Simd, T: Lanes>(self, sums: [Wide<S, T>; 1], _: [Wide<S, T>; 0]) -> [Wide<S, T>; 1] {
        sums
    }
}

/// Which similarity of two pictures.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) enum Similarity {
    /// SSIM.
    Ssim,
    /// The structure term K, within `0..=0.98`.
    Structure,
}

/// The windowed moments of two pictures at one pixel: mean a, mean b, mean a² + b², mean ab.
type Moments<S, T> = [Wide<S, T>; 4];

/// A similarity, and its slopes with respect to the moments.
type Trace<S, T> = [Wide<S, T>; 5];

#[inline(always)]
fn products<S: Simd, T: Lanes>([a, b]: [Wide<S, T>; 2]) -> Moments<S, T> {
    [a, b, a * a + b * b, a * b]
}

impl Similarity {
    #[inline(always)]
    fn trace<S: Simd, T: Lanes>(self, moments: Moments<S, T>) -> Trace<S, T> {
        match self {
            Self::Ssim => ssim(moments),
            Self::Structure => structure(moments),
        }
    }
}

impl Windowed<2, 0, 4, 1> for Similarity {
    #[inline(always)]
    fn product<S: Simd, T: Lanes>(self, maps: [Wide<S, T>; 2]) -> Moments<S, T> {
        products(maps)
    }

    #[inline(always)]
    fn finish<S: Simd, T: Lanes>(self, sums: Moments<S, T>, _: [Wide<S, T>; 0]) -> [Wide<S, T>; 1] {
        [self.trace(sums)[0]]
    }
}

/// A similarity with its slopes.
#[derive(Clone, Copy)]
pub(super) struct Traced(pub(super) Similarity);

impl Windowed<2, 0, 4, 5> for Traced {
    #[inline(always)]
    fn product<S: Simd, T: Lanes>(self, maps: [Wide<S, T>; 2]) -> Moments<S, T> {
        products(maps)
    }

    #[inline(always)]
    fn finish<S: Simd, T: Lanes>(self, sums: Moments<S, T>, _: [Wide<S, T>; 0]) -> Trace<S, T> {
        self.0.trace(sums)
    }
}

/// Variances that rounding made negative count as zero, so that no denominator can vanish.
#[inline(always)]
fn positive<S: Simd, T: Lanes>(variance: Wide<S, T>) -> Wide<S, T> {
    variance.max(variance.value(0.0))
}

#[inline(always)]
fn ssim<S: Simd, T: Lanes>([mean_a, mean_b, square, cross]: Moments<S, T>) -> Trace<S, T> {
    let [two, one, zero] = [2.0, 1.0, 0.0].map(|value| square.value(value));
    let [c1, c2] = [C1, C2].map(|value| square.value(value));
    let squared_means = mean_a * mean_a + mean_b * mean_b;
    let luminance = two * mean_a * mean_b + c1;
    let contrast = two * (cross - mean_a * mean_b) + c2;
    let (means, variances) = (squared_means + c1, positive(square - squared_means) + c2);
    let inverse = one / (means * variances);
    let value = luminance * contrast * inverse;
    let (by_means, by_variances) = (value * variances * inverse, value * means * inverse);
    let (through_other, through_own) = (two * (contrast - luminance) * inverse, two * (by_variances - by_means));
    [
        value,
        mean_b * through_other + mean_a * through_own,
        mean_a * through_other + mean_b * through_own,
        zero - by_variances,
        two * luminance * inverse,
    ]
}

#[inline(always)]
fn structure<S: Simd, T: Lanes>([mean_a, mean_b, square, cross]: Moments<S, T>) -> Trace<S, T> {
    let [half, one, zero] = [0.5, 1.0, 0.0].map(|value| square.value(value));
    let c3 = square.value(C3);
    let covariance = cross - mean_a * mean_b + c3;
    let variances = positive(square - (mean_a * mean_a + mean_b * mean_b)) + c3;
    let inverse = one / variances.sqrt();
    let value = covariance * inverse;
    let clipped = value.max(zero).min(square.value(STRUCTURE_MAX));
    let open = inverse.where_equal(value, clipped);
    let by_variances = value * inverse * open;
    [
        clipped,
        mean_a * by_variances - mean_b * open,
        mean_b * by_variances - mean_a * open,
        zero - half * by_variances,
        open,
    ]
}

/// The adjoints of two pictures from the cotangent of their similarity and its four slopes: the window is its own
/// adjoint, so the slopes times the cotangent are summed by it.
#[derive(Clone, Copy)]
pub(super) struct SimilarityAdjoint;

impl Windowed<5, 2, 4, 2> for SimilarityAdjoint {
    #[inline(always)]
    fn product<S: Simd, T: Lanes>(self, [v_map, mean_a, mean_b, square, cross]: [Wide<S, T>; 5]) -> [Wide<S, T>; 4] {
        [v_map * mean_a, v_map * mean_b, v_map * square, v_map * cross]
    }

    #[inline(always)]
    fn finish<S: Simd, T: Lanes>(
        self,
        [v_mean_a, v_mean_b, v_square, v_cross]: [Wide<S, T>; 4],
        [a, b]: [Wide<S, T>; 2],
    ) -> [Wide<S, T>; 2] {
        let v_square = v_square + v_square;
        [v_mean_a + a * v_square + b * v_cross, v_mean_b + b * v_square + a * v_cross]
    }
}
