//! The computations of the window ops at one pixel, before and after the window's sums.

use pulp::Simd;

use crate::simd::{Lanes, Wide};

/// The constants of SSIM for images in `0..=1` (METHOD §4.4), and of its structure term.
pub(crate) const C1: f64 = 1e-4;
pub(crate) const C2: f64 = 9e-4;
pub(crate) const C3: f64 = C2 / 2.0;

/// Upper bound of the structure map (METHOD §4.4 item 4).
pub(crate) const STRUCTURE_MAX: f64 = 0.98;

/// A computation around window sums. It sums `K` products of `M` maps down each column, then sums these along the row.
/// From the sums and `P` values of the pixel itself it computes `O` results. Nonlinear products also get the middle of
/// each sum as their reference.
pub(super) trait Windowed<const M: usize, const P: usize, const K: usize, const O: usize>: Copy + Sync {
    /// The summands down a column, from a pixel and the middle pixel. Outside the image, maps are zero.
    fn product<S: Simd, T: Lanes>(self, maps: [Wide<S, T>; M], middle: [Wide<S, T>; M]) -> [Wide<S, T>; K];

    /// The result of a column.
    #[inline(always)]
    fn column<S: Simd, T: Lanes>(self, sums: [Wide<S, T>; K], _: [Wide<S, T>; M]) -> [Wide<S, T>; K] {
        sums
    }

    /// The summands along a row, from a column and the middle column. Outside the image, a column is zero.
    #[inline(always)]
    fn along<S: Simd, T: Lanes>(self, column: [Wide<S, T>; K], _: [Wide<S, T>; K]) -> [Wide<S, T>; K] {
        column
    }

    /// The results from the sums, the middle column and the pixel.
    fn finish<S: Simd, T: Lanes>(
        self,
        sums: [Wide<S, T>; K],
        middle: [Wide<S, T>; K],
        own: [Wide<S, T>; P],
    ) -> [Wide<S, T>; O];
}

/// Returns the sums themselves.
#[derive(Clone, Copy)]
pub(super) struct Blur;

impl Windowed<1, 0, 1, 1> for Blur {
    #[inline(always)]
    fn product<S: Simd, T: Lanes>(self, maps: [Wide<S, T>; 1], _: [Wide<S, T>; 1]) -> [Wide<S, T>; 1] {
        maps
    }

    #[inline(always)]
    fn finish<S: Simd, T: Lanes>(
        self,
        sums: [Wide<S, T>; 1],
        _: [Wide<S, T>; 1],
        _: [Wide<S, T>; 0],
    ) -> [Wide<S, T>; 1] {
        sums
    }
}

/// The kind of similarity of two images.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) enum Similarity {
    /// SSIM.
    Ssim,
    /// The structure term K, within `0..=0.98`.
    Structure,
}

/// The windowed moments of two images at one pixel: mean a, mean b, variance of a + variance of b, covariance.
///
/// In a bright, flat image, the variance `mean a² - (mean a)²` is a small difference of large numbers. In single
/// precision, SSIM would keep three digits. Pixels are therefore relative to the middle of their column, and columns to
/// the middle of their row. The variance is the mean of the columns' variances plus the variance of their means. This
/// is exact, because the weights sum to exactly 1; black outside the image counts like any other pixel.
type Moments<S, T> = [Wide<S, T>; 4];

/// A similarity, and its derivatives with respect to mean a, mean b, mean a² + b² and mean ab.
type Trace<S, T> = [Wide<S, T>; 5];

/// A pixel's summands down its column.
#[inline(always)]
fn of_pixel<S: Simd, T: Lanes>([a, b]: [Wide<S, T>; 2], [middle_a, middle_b]: [Wide<S, T>; 2]) -> Moments<S, T> {
    let (a, b) = (a - middle_a, b - middle_b);
    [a, b, a * a + b * b, a * b]
}

/// A column's summands along the row.
#[inline(always)]
fn of_column<S: Simd, T: Lanes>(column: Moments<S, T>, middle: Moments<S, T>) -> Moments<S, T> {
    let (a, b) = (column[0] - middle[0], column[1] - middle[1]);
    [a, b, column[2] + (a * a + b * b), column[3] + a * b]
}

/// Moments from sums relative to the middle.
#[inline(always)]
fn from_middle<S: Simd, T: Lanes>(
    [a, b, squares, product]: Moments<S, T>,
    [middle_a, middle_b]: [Wide<S, T>; 2],
) -> Moments<S, T> {
    [middle_a + a, middle_b + b, squares - (a * a + b * b), product - a * b]
}

/// The sums of a [`Windowed`] computation on moments.
macro_rules! sums_of_moments {
    () => {
        #[inline(always)]
        fn product<S: Simd, T: Lanes>(self, maps: [Wide<S, T>; 2], middle: [Wide<S, T>; 2]) -> Moments<S, T> {
            of_pixel(maps, middle)
        }

        #[inline(always)]
        fn column<S: Simd, T: Lanes>(self, sums: Moments<S, T>, middle: [Wide<S, T>; 2]) -> Moments<S, T> {
            from_middle(sums, middle)
        }

        #[inline(always)]
        fn along<S: Simd, T: Lanes>(self, column: Moments<S, T>, middle: Moments<S, T>) -> Moments<S, T> {
            of_column(column, middle)
        }
    };
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
    sums_of_moments!();

    #[inline(always)]
    fn finish<S: Simd, T: Lanes>(
        self,
        sums: Moments<S, T>,
        middle: Moments<S, T>,
        _: [Wide<S, T>; 0],
    ) -> [Wide<S, T>; 1] {
        [self.trace(from_middle(sums, [middle[0], middle[1]]))[0]]
    }
}

/// A similarity with its derivatives.
#[derive(Clone, Copy)]
pub(super) struct Traced(pub(super) Similarity);

impl Windowed<2, 0, 4, 5> for Traced {
    sums_of_moments!();

    #[inline(always)]
    fn finish<S: Simd, T: Lanes>(self, sums: Moments<S, T>, middle: Moments<S, T>, _: [Wide<S, T>; 0]) -> Trace<S, T> {
        self.0.trace(from_middle(sums, [middle[0], middle[1]]))
    }
}

/// A similarity with its derivatives with respect to mean a, mean a² + b² and mean ab, times the pixel's weight.
#[derive(Clone, Copy)]
pub(super) struct Weighted(pub(super) Similarity);

impl Windowed<2, 1, 4, 4> for Weighted {
    sums_of_moments!();

    #[inline(always)]
    fn finish<S: Simd, T: Lanes>(
        self,
        sums: Moments<S, T>,
        middle: Moments<S, T>,
        [weight]: [Wide<S, T>; 1],
    ) -> [Wide<S, T>; 4] {
        let [value, by_mean_a, _, by_square, by_cross] = self.0.trace(from_middle(sums, [middle[0], middle[1]]));
        [value, weight * by_mean_a, weight * by_square, weight * by_cross]
    }
}

/// Variances that are negative due to rounding count as zero, so that no denominator vanishes.
#[inline(always)]
fn positive<S: Simd, T: Lanes>(variance: Wide<S, T>) -> Wide<S, T> {
    variance.max(variance.value(0.0))
}

#[inline(always)]
fn ssim<S: Simd, T: Lanes>([mean_a, mean_b, variances, covariance]: Moments<S, T>) -> Trace<S, T> {
    let [two, one, zero] = [2.0, 1.0, 0.0].map(|value| mean_a.value(value));
    let [c1, c2] = [C1, C2].map(|value| mean_a.value(value));
    let squared_means = mean_a * mean_a + mean_b * mean_b;
    let luminance = two * mean_a * mean_b + c1;
    let contrast = two * covariance + c2;
    let (means, variances) = (squared_means + c1, positive(variances) + c2);
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
fn structure<S: Simd, T: Lanes>([mean_a, mean_b, variances, covariance]: Moments<S, T>) -> Trace<S, T> {
    let [half, one, zero] = [0.5, 1.0, 0.0].map(|value| mean_a.value(value));
    let c3 = mean_a.value(C3);
    let (covariance, variances) = (covariance + c3, positive(variances) + c3);
    let inverse = one / variances.sqrt();
    let value = covariance * inverse;
    let clipped = value.max(zero).min(mean_a.value(STRUCTURE_MAX));
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

/// The adjoints of two images, from the cotangent of their similarity and its four derivatives. The window is its own
/// adjoint, so it sums the derivatives times the cotangent.
#[derive(Clone, Copy)]
pub(super) struct SimilarityAdjoint;

impl Windowed<5, 2, 4, 2> for SimilarityAdjoint {
    #[inline(always)]
    fn product<S: Simd, T: Lanes>(
        self,
        [v_map, mean_a, mean_b, square, cross]: [Wide<S, T>; 5],
        _: [Wide<S, T>; 5],
    ) -> [Wide<S, T>; 4] {
        [v_map * mean_a, v_map * mean_b, v_map * square, v_map * cross]
    }

    #[inline(always)]
    fn finish<S: Simd, T: Lanes>(
        self,
        [v_mean_a, v_mean_b, v_square, v_cross]: [Wide<S, T>; 4],
        _: [Wide<S, T>; 4],
        [a, b]: [Wide<S, T>; 2],
    ) -> [Wide<S, T>; 2] {
        let v_square = v_square + v_square;
        [v_mean_a + a * v_square + b * v_cross, v_mean_b + b * v_square + a * v_cross]
    }
}

/// The adjoint of the first image alone, from the derivatives times the cotangent.
#[derive(Clone, Copy)]
pub(super) struct FirstAdjoint;

impl Windowed<3, 2, 3, 1> for FirstAdjoint {
    #[inline(always)]
    fn product<S: Simd, T: Lanes>(self, maps: [Wide<S, T>; 3], _: [Wide<S, T>; 3]) -> [Wide<S, T>; 3] {
        maps
    }

    #[inline(always)]
    fn finish<S: Simd, T: Lanes>(
        self,
        [v_mean, v_square, v_cross]: [Wide<S, T>; 3],
        _: [Wide<S, T>; 3],
        [a, b]: [Wide<S, T>; 2],
    ) -> [Wide<S, T>; 1] {
        [v_mean + a * (v_square + v_square) + b * v_cross]
    }
}
