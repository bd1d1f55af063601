//! Exponential and logarithm of vectors.
//!
//! In single precision they are series without branches. Like all arithmetic of [`Wide`] they give the same bits with
//! every instruction set.

use std::f32::consts::{FRAC_1_SQRT_2, LOG2_E};

use pulp::Simd;

use super::Wide;

/// Adding this constant to a small float leaves the nearest integer in the low bits of the sum.
pub(crate) const ROUNDER: f32 = 12_582_912.0;
/// ln 2 in two parts. The first has few bits, so that its product with an exponent is exact.
pub(crate) const LN_2_HIGH: f32 = 355.0 / 512.0;
pub(crate) const LN_2_LOW: f32 = (std::f64::consts::LN_2 - 355.0 / 512.0) as f32;
/// `exp(r)` for `|r| <= ln 2 / 2`, highest power first, interpolated at Chebyshev nodes: error 1e-8.
pub(crate) const EXP_SERIES: [f32; 7] = [0.001_392_618_4, 0.008_363_179, 0.041_666_556, 0.166_665_76, 0.5, 1.0, 1.0];

/// Largest argument with a finite exponential, and smallest with a normal one.
const EXP_RANGE: [f32; 2] = [-87.336_54, 88.722_83];

/// `2 atanh(s) / s` in powers of `s²`, highest first: error 4e-9 for the `s` of [`ln_single`].
const ATANH_SERIES: [f32; 5] = [2.0 / 9.0, 2.0 / 7.0, 2.0 / 5.0, 2.0 / 3.0, 2.0];

/// Bits of a float before the exponent.
const MANTISSA_BITS: u32 = 23;

/// A polynomial, highest power first.
#[inline(always)]
fn polynomial<S: Simd, const N: usize>(x: Wide<S, f32>, coefficients: [f32; N]) -> Wide<S, f32> {
    let mut sum = Wide::splat(x.simd, coefficients[0]);
    for &coefficient in &coefficients[1..] {
        sum = sum * x + coefficient;
    }
    sum
}

/// `x = n ln 2 + r`, a polynomial for `exp(r)`, and `n` added to its exponent.
#[inline(always)]
pub(super) fn exp_single<S: Simd>(x: Wide<S, f32>) -> Wide<S, f32> {
    let simd = x.simd;
    let shifted = x * LOG2_E + ROUNDER;
    let n = shifted - ROUNDER;
    let r = (x - n * LN_2_HIGH) - n * LN_2_LOW;
    let power = polynomial(r, EXP_SERIES);
    let exponent = simd.transmute_u32s_f32s(shifted.vector);
    let exponent = simd.wrapping_dyn_shl_u32s(exponent, simd.splat_u32s(MANTISSA_BITS));
    let scaled = simd.add_u32s(simd.transmute_u32s_f32s(power.vector), exponent);
    let scaled = Wide { simd, vector: simd.transmute_f32s_u32s(scaled) };
    let [lowest, highest] = [Wide::splat(simd, EXP_RANGE[0]), Wide::splat(simd, EXP_RANGE[1])];
    // Beyond the range, the sum is infinite; it keeps NaN.
    let bounded = x.not_above(highest).select(scaled, x + f32::INFINITY);
    x.less(lowest).select(Wide::splat(simd, 0.0), bounded)
}

/// `x = 2^n m` with `m` between `sqrt(1/2)` and `sqrt(2)`, and `ln m = 2 atanh(s)` with `s = (m - 1) / (m + 1)`.
#[inline(always)]
pub(super) fn ln_single<S: Simd>(x: Wide<S, f32>) -> Wide<S, f32> {
    let simd = x.simd;
    let (one, shift) = (simd.splat_u32s(1f32.to_bits()), simd.splat_u32s(MANTISSA_BITS));
    let bits = simd.transmute_u32s_f32s(x.vector);
    // The exponent with its bias. A mantissa above that of sqrt(1/2) carries into it.
    let carry = simd.splat_u32s(1f32.to_bits() - FRAC_1_SQRT_2.to_bits());
    let biased = simd.wrapping_dyn_shr_u32s(simd.add_u32s(bits, carry), shift);
    let mantissa = simd.add_u32s(simd.sub_u32s(bits, simd.wrapping_dyn_shl_u32s(biased, shift)), one);
    let m = Wide { simd, vector: simd.transmute_f32s_u32s(mantissa) };
    // An integer in the low bits of a float that is so large that its last bit is one.
    let large = (1u32 << MANTISSA_BITS) as f32;
    let counted = simd.transmute_f32s_u32s(simd.or_u32s(biased, simd.splat_u32s(large.to_bits())));
    let n = Wide { simd, vector: counted } - (large + 127.0);
    let s = (m - 1.0) / (m + 1.0);
    let series = s * polynomial(s * s, ATANH_SERIES);
    let logarithm = n * LN_2_HIGH + (n * LN_2_LOW + series);
    let normal = Wide::splat(simd, f32::MIN_POSITIVE).not_above(x);
    // Below the range, the difference is minus infinity; it keeps NaN.
    normal.select(logarithm, x - f32::INFINITY)
}

/// Each lane by the standard library.
#[inline(always)]
fn by_lanes<S: Simd>(x: Wide<S, f64>, function: impl Fn(f64) -> f64) -> Wide<S, f64> {
    let mut lanes = x.to_lanes();
    for lane in &mut lanes[..Wide::<S, f64>::LANES] {
        *lane = function(*lane);
    }
    Wide::load(x.simd, &lanes, 0)
}

#[inline(always)]
pub(super) fn exp_double<S: Simd>(x: Wide<S, f64>) -> Wide<S, f64> {
    by_lanes(x, f64::exp)
}

#[inline(always)]
pub(super) fn ln_double<S: Simd>(x: Wide<S, f64>) -> Wide<S, f64> {
    by_lanes(x, f64::ln)
}

#[cfg(test)]
mod tests {
    use pulp::{Arch, Scalar, WithSimd};

    use super::*;
    use crate::simd::MAX_LANES;

    /// One rounding in the reduced argument, and a few in the last steps.
    const TOLERANCE: f64 = 3e-7;

    #[derive(Clone, Copy)]
    enum Function {
        Exp,
        Ln,
    }

    /// A function of each number.
    struct Each<'a>(Function, &'a [[f32; MAX_LANES]]);

    impl WithSimd for Each<'_> {
        type Output = Vec<f32>;

        #[inline(always)]
        fn with_simd<S: Simd>(self, simd: S) -> Vec<f32> {
            let mut values = self.1.as_flattened().to_vec();
            for at in (0..values.len()).step_by(Wide::<S, f32>::LANES) {
                let x = Wide::load(simd, &values, at);
                let value = match self.0 {
                    Function::Exp => x.exp(),
                    Function::Ln => x.ln(),
                };
                value.store(&mut values, at);
            }
            values
        }
    }

    /// With the best instruction set and without one, which must give the same bits.
    fn each(function: Function, arguments: &[f32]) -> Vec<f32> {
        let mut padded = arguments.to_vec();
        padded.resize(arguments.len().next_multiple_of(MAX_LANES), 1.0);
        let packs = padded.as_chunks().0;
        let values = Arch::new().dispatch(Each(function, packs));
        let scalar = Each(function, packs).with_simd(Scalar::new());
        assert!(values.iter().zip(&scalar).all(|(a, b)| a.to_bits() == b.to_bits() || a.is_nan() && b.is_nan()));
        values[..arguments.len()].to_vec()
    }

    #[test]
    fn the_exponential_is_accurate_over_its_range() {
        let [low, high] = EXP_RANGE;
        let arguments: Vec<f32> = (0..=100_000).map(|i| low + (high - low) * (i as f32 / 1e5)).collect();
        for (&x, ours) in arguments.iter().zip(each(Function::Exp, &arguments)) {
            let truth = f64::from(x).exp();
            assert!((f64::from(ours) / truth - 1.0).abs() < TOLERANCE, "exp({x}) = {ours}, not {truth}");
        }
    }

    #[test]
    fn the_logarithm_is_accurate_over_its_range() {
        let mut arguments: Vec<f32> = (0..100_000).map(|i| f32::from_bits(0x0080_0000 + i * 0x5300)).collect();
        arguments.extend((0..1000).map(|i| 0.5 + i as f32 * 1e-3));
        for (&x, ours) in arguments.iter().zip(each(Function::Ln, &arguments)) {
            let truth = f64::from(x).ln();
            assert!(
                (f64::from(ours) - truth).abs() < TOLERANCE * truth.abs().max(1.0),
                "ln({x}) = {ours}, not {truth}"
            );
        }
    }

    #[test]
    fn the_ends_of_the_range_are_those_of_the_standard_library() {
        let arguments = [f32::NEG_INFINITY, -1e30, -200.0, 0.0, 90.0, 1e30, f32::INFINITY, f32::NAN];
        let expected = [0.0, 0.0, 0.0, 1.0, f32::INFINITY, f32::INFINITY, f32::INFINITY, f32::NAN];
        for (ours, expected) in each(Function::Exp, &arguments).into_iter().zip(expected) {
            assert!(ours == expected || ours.is_nan() && expected.is_nan(), "{ours}, not {expected}");
        }
        let [none, one, denormal, nan] = each(Function::Ln, &[0.0, 1.0, 1e-40, f32::NAN])[..] else { panic!("four") };
        assert!(none == f32::NEG_INFINITY && one == 0.0 && denormal == f32::NEG_INFINITY && nan.is_nan());
    }
}
