//! Segments: neighbouring pixels of a row that are processed at once.
//!
//! The hot loops are written once, against [`Vectors`]. For `f32` they use AVX2 registers if the processor has them.
//! Without these, the compiler turned the selects of the loops into branches, which were four times slower. Otherwise
//! they use arrays, which the compiler vectorises as far as possible.

use std::fmt::Debug;

use mvfusion_kernels::splat::TILE;
use pulp::{Simd, WithSimd};

use crate::Real;
use crate::simd::{self, EXP_SERIES, LN_2_HIGH, LN_2_LOW, ROUNDER};

#[cfg(any(target_arch = "x86", target_arch = "x86_64"))]
mod avx2;

/// Pixels of a segment: one 256-bit register of `f32`.
pub(crate) const LANES: usize = 8;
/// Segments side by side in a tile.
pub(crate) const HALVES: usize = TILE / LANES;
/// Segments of a tile; segment `half * TILE + row` has the pixels of that half of that row.
pub(crate) const SEGMENTS: usize = HALVES * TILE;

/// One value for each pixel of a segment.
pub(crate) type Lanes<T> = [T; LANES];
/// One value for each pixel of a tile, by segments.
pub(crate) type Plane<T> = [Lanes<T>; SEGMENTS];

/// Distance of a row or column of a tile from the tile's middle.
#[inline(always)]
pub(crate) fn from_middle<T: Lane>(index: usize) -> T {
    T::COUNT[index] - T::of((TILE as f64 - 1.0) / 2.0)
}

/// Distances of the columns of a half of a tile from its first column.
#[inline(always)]
pub(crate) fn columns<T: Lane>(half: usize) -> Lanes<T> {
    std::array::from_fn(|lane| T::COUNT[half * LANES + lane])
}

/// A float type for segments.
pub(crate) trait Lane: simd::Lanes + Debug + Default {
    /// Relative rounding error.
    const ROUNDING: Self;

    /// 0, 1, 2, …: the rows and columns of a tile.
    const COUNT: [Self; TILE];

    /// A key with the same order as positive values.
    fn order_key(self) -> u64;

    /// The next larger value.
    fn next_above(self) -> Self;

    /// `exp(x)` of each lane, for `x <= 0`; arguments below -86 are taken as -86 in single precision, which is below
    /// any threshold.
    fn exp_lanes<S: Simd>(x: Lanes<Self>) -> Lanes<Self>;

    /// Runs a job with the best instruction set of the processor.
    fn run<J: VectorJob<Self>>(job: J) -> J::Output;
}

/// Work on segments of any type. Implementations mark `run` as `#[inline(always)]`.
pub(crate) trait VectorJob<T> {
    /// The result.
    type Output;

    /// Does the work.
    fn run<X: Vectors<T>>(self, x: X) -> Self::Output;
}

/// Arithmetic on segments.
pub(crate) trait Vectors<T>: Copy {
    /// A value for each pixel.
    type V: Copy;
    /// A boolean for each pixel.
    type M: Copy;
    /// An index for each pixel.
    type I: Copy;

    /// From memory.
    fn load(self, lanes: &Lanes<T>) -> Self::V;
    /// To memory.
    fn store(self, v: Self::V) -> Lanes<T>;
    /// The same value everywhere.
    fn splat(self, value: T) -> Self::V;
    /// `a + b`.
    fn add(self, a: Self::V, b: Self::V) -> Self::V;
    /// `a - b`.
    fn sub(self, a: Self::V, b: Self::V) -> Self::V;
    /// `a b`.
    fn mul(self, a: Self::V, b: Self::V) -> Self::V;
    /// `a / b`.
    fn div(self, a: Self::V, b: Self::V) -> Self::V;
    /// `a b + c`, fused if the instruction set supports it.
    fn fma(self, a: Self::V, b: Self::V, c: Self::V) -> Self::V;
    /// `c - a b`, fused if the instruction set supports it.
    fn sub_product(self, c: Self::V, a: Self::V, b: Self::V) -> Self::V;
    /// The smaller, if both are numbers.
    fn min(self, a: Self::V, b: Self::V) -> Self::V;
    /// The larger, if both are numbers.
    fn max(self, a: Self::V, b: Self::V) -> Self::V;
    /// `exp(a)` for `a <= 0`, see [`Lane::exp_lanes`].
    fn exp(self, a: Self::V) -> Self::V;
    /// `a < b`.
    fn less(self, a: Self::V, b: Self::V) -> Self::M;
    /// `a <= b`.
    fn at_most(self, a: Self::V, b: Self::V) -> Self::M;
    /// Logical and.
    fn both(self, a: Self::M, b: Self::M) -> Self::M;
    /// One bit per pixel.
    fn bits(self, mask: Self::M) -> u32;
    /// `yes` where the mask is true, else `no`.
    fn select(self, mask: Self::M, yes: Self::V, no: Self::V) -> Self::V;
    /// Indices from memory.
    fn load_index(self, lanes: &Lanes<i32>) -> Self::I;
    /// Indices to memory.
    fn store_index(self, v: Self::I) -> Lanes<i32>;
    /// The same index everywhere.
    fn splat_index(self, value: i32) -> Self::I;
    /// `a < b`.
    fn index_less(self, a: Self::I, b: Self::I) -> Self::M;
    /// `yes` where the mask is true, else `no`.
    fn select_index(self, mask: Self::M, yes: Self::I, no: Self::I) -> Self::I;
}

/// Sum of a segment by a fixed tree.
#[inline(always)]
pub(crate) fn sum_lanes<T: Real>(x: Lanes<T>) -> T {
    let four: [T; 4] = std::array::from_fn(|i| x[i] + x[i + 4]);
    (four[0] + four[2]) + (four[1] + four[3])
}

/// Sum of a segment in registers by the same tree.
#[inline(always)]
pub(crate) fn sum_vector<T: Real, X: Vectors<T>>(x: X, v: X::V) -> T {
    sum_lanes(x.store(v))
}

/// Segments as arrays.
#[derive(Clone, Copy)]
struct Arrays<S>(std::marker::PhantomData<S>);

/// `a * b + c`, fused if the instruction set supports it.
#[inline(always)]
fn fma<S: Simd, T: Real>(a: T, b: T, c: T) -> T {
    if S::IS_SCALAR { a * b + c } else { a.mul_add(b, c) }
}

macro_rules! lanewise {
    (|$lane:ident| $value:expr) => {
        std::array::from_fn(|$lane| $value)
    };
}

impl<T: Lane, S: Simd> Vectors<T> for Arrays<S> {
    type V = Lanes<T>;
    type M = Lanes<bool>;
    type I = Lanes<i32>;

    #[inline(always)]
    fn load(self, lanes: &Lanes<T>) -> Lanes<T> {
        *lanes
    }
    #[inline(always)]
    fn store(self, v: Lanes<T>) -> Lanes<T> {
        v
    }
    #[inline(always)]
    fn splat(self, value: T) -> Lanes<T> {
        [value; LANES]
    }
    #[inline(always)]
    fn add(self, a: Lanes<T>, b: Lanes<T>) -> Lanes<T> {
        lanewise!(|i| a[i] + b[i])
    }
    #[inline(always)]
    fn sub(self, a: Lanes<T>, b: Lanes<T>) -> Lanes<T> {
        lanewise!(|i| a[i] - b[i])
    }
    #[inline(always)]
    fn mul(self, a: Lanes<T>, b: Lanes<T>) -> Lanes<T> {
        lanewise!(|i| a[i] * b[i])
    }
    #[inline(always)]
    fn div(self, a: Lanes<T>, b: Lanes<T>) -> Lanes<T> {
        lanewise!(|i| a[i] / b[i])
    }
    #[inline(always)]
    fn fma(self, a: Lanes<T>, b: Lanes<T>, c: Lanes<T>) -> Lanes<T> {
        lanewise!(|i| fma::<S, T>(a[i], b[i], c[i]))
    }
    #[inline(always)]
    fn sub_product(self, c: Lanes<T>, a: Lanes<T>, b: Lanes<T>) -> Lanes<T> {
        lanewise!(|i| fma::<S, T>(-a[i], b[i], c[i]))
    }
    #[inline(always)]
    fn min(self, a: Lanes<T>, b: Lanes<T>) -> Lanes<T> {
        lanewise!(|i| if a[i] < b[i] { a[i] } else { b[i] })
    }
    #[inline(always)]
    fn max(self, a: Lanes<T>, b: Lanes<T>) -> Lanes<T> {
        lanewise!(|i| if a[i] > b[i] { a[i] } else { b[i] })
    }
    #[inline(always)]
    fn exp(self, a: Lanes<T>) -> Lanes<T> {
        T::exp_lanes::<S>(a)
    }
    #[inline(always)]
    fn less(self, a: Lanes<T>, b: Lanes<T>) -> Lanes<bool> {
        lanewise!(|i| a[i] < b[i])
    }
    #[inline(always)]
    fn at_most(self, a: Lanes<T>, b: Lanes<T>) -> Lanes<bool> {
        lanewise!(|i| a[i] <= b[i])
    }
    #[inline(always)]
    fn both(self, a: Lanes<bool>, b: Lanes<bool>) -> Lanes<bool> {
        lanewise!(|i| a[i] & b[i])
    }
    #[inline(always)]
    fn bits(self, mask: Lanes<bool>) -> u32 {
        mask.iter().enumerate().fold(0, |bits, (lane, &truth)| bits | u32::from(truth) << lane)
    }
    #[inline(always)]
    fn select(self, mask: Lanes<bool>, yes: Lanes<T>, no: Lanes<T>) -> Lanes<T> {
        lanewise!(|i| if mask[i] { yes[i] } else { no[i] })
    }
    #[inline(always)]
    fn load_index(self, lanes: &Lanes<i32>) -> Lanes<i32> {
        *lanes
    }
    #[inline(always)]
    fn store_index(self, v: Lanes<i32>) -> Lanes<i32> {
        v
    }
    #[inline(always)]
    fn splat_index(self, value: i32) -> Lanes<i32> {
        [value; LANES]
    }
    #[inline(always)]
    fn index_less(self, a: Lanes<i32>, b: Lanes<i32>) -> Lanes<bool> {
        lanewise!(|i| a[i] < b[i])
    }
    #[inline(always)]
    fn select_index(self, mask: Lanes<bool>, yes: Lanes<i32>, no: Lanes<i32>) -> Lanes<i32> {
        lanewise!(|i| if mask[i] { yes[i] } else { no[i] })
    }
}

/// Runs a job on arrays.
struct OnArrays<T, J>(J, std::marker::PhantomData<T>);

impl<T: Lane, J: VectorJob<T>> WithSimd for OnArrays<T, J> {
    type Output = J::Output;

    #[inline(always)]
    fn with_simd<S: Simd>(self, _: S) -> J::Output {
        self.0.run(Arrays::<S>(std::marker::PhantomData))
    }
}

impl Lane for f32 {
    const ROUNDING: f32 = f32::EPSILON * 0.5;

    const COUNT: [f32; TILE] = [0.0, 1.0, 2.0, 3.0, 4.0, 5.0, 6.0, 7.0, 8.0, 9.0, 10.0, 11.0, 12.0, 13.0, 14.0, 15.0];

    fn order_key(self) -> u64 {
        u64::from(self.to_bits())
    }

    fn next_above(self) -> f32 {
        self.next_up()
    }

    #[inline(always)]
    fn exp_lanes<S: Simd>(x: Lanes<f32>) -> Lanes<f32> {
        exp_single(Arrays::<S>(std::marker::PhantomData), x, |p, shifted| {
            lanewise!(|i| f32::from_bits(p[i].to_bits().wrapping_add(shifted[i].to_bits() << 23)))
        })
    }

    fn run<J: VectorJob<f32>>(job: J) -> J::Output {
        #[cfg(any(target_arch = "x86", target_arch = "x86_64"))]
        if let Some(avx2) = pulp::x86::V3::try_new() {
            return avx2.vectorize(avx2::OnAvx2(job, avx2));
        }
        pulp::Arch::new().dispatch(OnArrays(job, std::marker::PhantomData))
    }
}

impl Lane for f64 {
    const ROUNDING: f64 = f64::EPSILON * 0.5;

    const COUNT: [f64; TILE] = [0.0, 1.0, 2.0, 3.0, 4.0, 5.0, 6.0, 7.0, 8.0, 9.0, 10.0, 11.0, 12.0, 13.0, 14.0, 15.0];

    fn order_key(self) -> u64 {
        self.to_bits()
    }

    fn next_above(self) -> f64 {
        self.next_up()
    }

    #[inline(always)]
    fn exp_lanes<S: Simd>(x: Lanes<f64>) -> Lanes<f64> {
        x.map(f64::exp)
    }

    fn run<J: VectorJob<f64>>(job: J) -> J::Output {
        pulp::Arch::new().dispatch(OnArrays(job, std::marker::PhantomData))
    }
}

/// Branch-free `exp` of `x <= 0` in single precision, relative error about 1e-7: `x = n ln 2 + r`, a polynomial for
/// `exp(r)`, and `n` added to the exponent by `scale`, which gets the polynomial and a float whose low bits are `n`.
#[inline(always)]
fn exp_single<X: Vectors<f32>>(x: X, argument: X::V, scale: impl FnOnce(X::V, X::V) -> X::V) -> X::V {
    const LOWEST: f32 = -86.0;

    let argument = x.max(argument, x.splat(LOWEST));
    let shifted = x.fma(argument, x.splat(std::f32::consts::LOG2_E), x.splat(ROUNDER));
    let n = x.sub(shifted, x.splat(ROUNDER));
    let r = x.sub_product(x.sub_product(argument, n, x.splat(LN_2_HIGH)), n, x.splat(LN_2_LOW));
    let mut p = x.splat(EXP_SERIES[0]);
    for &coefficient in &EXP_SERIES[1..] {
        p = x.fma(p, r, x.splat(coefficient));
    }
    scale(p, shifted)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// One rounding in the reduced argument and one in the last step.
    const EXP_TOLERANCE: f64 = 2e-7;

    /// Exponentials of some arguments.
    struct Exponentials<'a>(&'a [Lanes<f32>]);

    impl VectorJob<f32> for Exponentials<'_> {
        type Output = Vec<f32>;

        fn run<X: Vectors<f32>>(self, x: X) -> Vec<f32> {
            self.0.iter().flat_map(|lanes| x.store(x.exp(x.load(lanes)))).collect()
        }
    }

    fn both_ways(arguments: &[Lanes<f32>]) -> [Vec<f32>; 2] {
        let scalar = Arrays::<pulp::Scalar>(std::marker::PhantomData);
        [f32::run(Exponentials(arguments)), Exponentials(arguments).run(scalar)]
    }

    #[test]
    fn the_exponential_is_accurate_over_its_range() {
        let arguments: Vec<f32> = (0..200_000).map(|i| -80.0 * (i as f32 / 200_000.0).powi(2)).collect();
        for ours in both_ways(arguments.as_chunks().0) {
            for (&x, &ours) in arguments.iter().zip(&ours) {
                let truth = f64::from(x).exp();
                assert!((f64::from(ours) / truth - 1.0).abs() < EXP_TOLERANCE, "exp({x}) = {ours}, not {truth}");
            }
            assert_eq!(ours[0], 1.0);
        }
    }

    #[test]
    fn the_exponential_of_far_away_is_tiny_and_not_nan() {
        for ours in both_ways(&[[-87.0, -1e10, f32::MIN, f32::NEG_INFINITY, -90.0, -1e3, -1e5, -1e20]]) {
            assert!(ours.iter().all(|e| (0.0..1e-30).contains(e)), "{ours:?}");
        }
    }

    #[test]
    fn a_segment_is_summed_whole() {
        assert_eq!(sum_lanes([1.0, 2.0, 3.0, 4.0, 5.0, 6.0, 7.0, 8.0f64]), 36.0);
    }
}
