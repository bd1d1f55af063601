//! Rows of pixels that are worked on at once, written so that the compiler turns each step into vector instructions.

use std::fmt::Debug;

use mvfusion_kernels::splat::TILE;
use pulp::Simd;

use crate::Real;

/// Pixels of a segment: one 256-bit register of `f32`.
pub(crate) const LANES: usize = 8;
/// Segments side by side in a tile.
pub(crate) const HALVES: usize = TILE / LANES;
/// Segments of a tile; segment `half * TILE + row` holds the pixels of that half of that row.
pub(crate) const SEGMENTS: usize = HALVES * TILE;

/// One value for each pixel of a segment.
pub(crate) type Lanes<T> = [T; LANES];
/// One value for each pixel of a tile, by segments.
pub(crate) type Plane<T> = [Lanes<T>; SEGMENTS];

/// A float that segments can be made of.
pub(crate) trait Lane: Real + Debug + Default {
    /// Relative rounding error.
    const ROUNDING: Self;

    /// `exp(x)` for `x <= 0`; arguments below -86 are taken as -86 in single precision, which is below any threshold.
    fn exp_lanes<S: Simd>(x: Lanes<Self>) -> Lanes<Self>;

    /// A key that orders positive values as they are.
    fn order_key(self) -> u64;

    /// The next larger value.
    fn next_above(self) -> Self;
}

/// `a * b + c`, fused where the instruction set can.
#[inline(always)]
pub(crate) fn fma<S: Simd, T: Real>(a: T, b: T, c: T) -> T {
    if S::IS_SCALAR { a * b + c } else { a.mul_add(b, c) }
}

/// Sum of a segment by a fixed tree.
#[inline(always)]
pub(crate) fn sum_lanes<T: Real>(x: Lanes<T>) -> T {
    let four: [T; 4] = std::array::from_fn(|i| x[i] + x[i + 4]);
    (four[0] + four[2]) + (four[1] + four[3])
}

impl Lane for f32 {
    const ROUNDING: f32 = f32::EPSILON * 0.5;

    #[inline(always)]
    fn exp_lanes<S: Simd>(x: Lanes<f32>) -> Lanes<f32> {
        std::array::from_fn(|lane| exp_f32::<S>(x[lane]))
    }

    #[inline(always)]
    fn order_key(self) -> u64 {
        u64::from(self.to_bits())
    }

    fn next_above(self) -> f32 {
        self.next_up()
    }
}

impl Lane for f64 {
    const ROUNDING: f64 = f64::EPSILON * 0.5;

    #[inline(always)]
    fn exp_lanes<S: Simd>(x: Lanes<f64>) -> Lanes<f64> {
        std::array::from_fn(|lane| x[lane].exp())
    }

    #[inline(always)]
    fn order_key(self) -> u64 {
        self.to_bits()
    }

    fn next_above(self) -> f64 {
        self.next_up()
    }
}

/// Branch-free `exp` of `x <= 0` in single precision, relative error about 1e-7: `x = n ln 2 + r`, a polynomial of
/// degree 6 for `exp(r)` (interpolated at Chebyshev nodes, error 1e-8), and `n` added to the exponent.
#[inline(always)]
fn exp_f32<S: Simd>(x: f32) -> f32 {
    const LOWEST: f32 = -86.0;
    /// Adding it leaves the nearest integer in the low bits of the sum.
    const ROUNDER: f32 = 12_582_912.0;
    /// ln 2 in two parts, the first of few bits, so that its product with `n` is exact.
    const LN_2_HIGH: f32 = 0.693_359_375;
    const LN_2_LOW: f32 = (std::f64::consts::LN_2 - 0.693_359_375) as f32;
    const SERIES: [f32; 5] = [0.001_392_618_4, 0.008_363_179, 0.041_666_556, 0.166_665_76, 0.5];

    let x = if x < LOWEST { LOWEST } else { x };
    let shifted = fma::<S, f32>(x, std::f32::consts::LOG2_E, ROUNDER);
    let n = shifted - ROUNDER;
    let r = fma::<S, f32>(n, -LN_2_LOW, fma::<S, f32>(n, -LN_2_HIGH, x));
    let mut p = SERIES[0];
    p = fma::<S, f32>(p, r, SERIES[1]);
    p = fma::<S, f32>(p, r, SERIES[2]);
    p = fma::<S, f32>(p, r, SERIES[3]);
    p = fma::<S, f32>(p, r, SERIES[4]);
    p = fma::<S, f32>(p, r, 1.0);
    p = fma::<S, f32>(p, r, 1.0);
    f32::from_bits(p.to_bits().wrapping_add(shifted.to_bits() << 23))
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A rounding in the reduced argument and one in the last step.
    const EXP_TOLERANCE: f64 = 2e-7;

    #[test]
    fn the_exponential_is_accurate_over_its_range() {
        for i in 0..200_000 {
            let x = -80.0 * (i as f32 / 200_000.0).powi(2);
            let (ours, true_value) = (f64::from(exp_f32::<pulp::Scalar>(x)), f64::from(x).exp());
            assert!((ours / true_value - 1.0).abs() < EXP_TOLERANCE, "exp({x}) = {ours}, not {true_value}");
        }
        assert_eq!(exp_f32::<pulp::Scalar>(0.0), 1.0);
    }

    #[test]
    fn the_exponential_of_far_away_is_tiny_and_not_nan() {
        for x in [-87.0, -1e10, f32::MIN, f32::NEG_INFINITY] {
            let e = exp_f32::<pulp::Scalar>(x);
            assert!((0.0..1e-30).contains(&e), "exp({x}) = {e}");
        }
    }

    #[test]
    fn a_segment_is_summed_whole() {
        assert_eq!(sum_lanes([1.0, 2.0, 3.0, 4.0, 5.0, 6.0, 7.0, 8.0f64]), 36.0);
    }
}
