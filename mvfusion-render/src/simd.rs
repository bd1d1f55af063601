//! Vector instructions selected at run time, for loops that the compiler vectorises and as an explicit type.
//!
//! Nothing is contracted, and sums keep their written order, in which the number of lanes has a part: where a loop sums
//! lane by lane, the last bits depend on the instruction set.

mod elementary;
mod number;
mod rows;

use std::ops::{Add, Div, Mul, Neg, Sub};

use bytemuck::Pod;
use pulp::{Arch, Simd, WithSimd};

use crate::Real;

pub(crate) use elementary::{EXP_SERIES, LN_2_HIGH, LN_2_LOW, ROUNDER};
pub(crate) use number::{Number, cross, dot};
pub(crate) use rows::{Rows, to_rows};

/// A closure that is called by reference. A call by value goes through a shim that is compiled for the baseline.
struct Work<F>(F);

impl<R, F: FnMut() -> R> WithSimd for Work<F> {
    type Output = R;

    #[inline(always)]
    fn with_simd<S: Simd>(mut self, _: S) -> R {
        (self.0)()
    }
}

/// Calls `work` compiled for the best instruction set of this machine. The closure and everything that it calls in its
/// loops must be `#[inline(always)]`; other functions are compiled for the baseline.
#[inline]
pub(crate) fn vectorised<R>(work: impl FnMut() -> R) -> R {
    Arch::new().dispatch(Work(work))
}

/// A float with a vector type. The methods implement the operators of [`Wide`] and [`Mask`].
pub(crate) trait Lanes: Real {
    /// A register of this float.
    type Vector<S: Simd>: Copy + Pod;
    /// A boolean for each lane.
    type Mask<S: Simd>: Copy;

    fn splat<S: Simd>(simd: S, value: Self) -> Self::Vector<S>;
    fn add<S: Simd>(simd: S, a: Self::Vector<S>, b: Self::Vector<S>) -> Self::Vector<S>;
    fn sub<S: Simd>(simd: S, a: Self::Vector<S>, b: Self::Vector<S>) -> Self::Vector<S>;
    fn mul<S: Simd>(simd: S, a: Self::Vector<S>, b: Self::Vector<S>) -> Self::Vector<S>;
    fn div<S: Simd>(simd: S, a: Self::Vector<S>, b: Self::Vector<S>) -> Self::Vector<S>;
    fn max<S: Simd>(simd: S, a: Self::Vector<S>, b: Self::Vector<S>) -> Self::Vector<S>;
    fn min<S: Simd>(simd: S, a: Self::Vector<S>, b: Self::Vector<S>) -> Self::Vector<S>;
    fn sqrt<S: Simd>(simd: S, a: Self::Vector<S>) -> Self::Vector<S>;
    fn neg<S: Simd>(simd: S, a: Self::Vector<S>) -> Self::Vector<S>;
    fn less<S: Simd>(simd: S, a: Self::Vector<S>, b: Self::Vector<S>) -> Self::Mask<S>;
    fn not_above<S: Simd>(simd: S, a: Self::Vector<S>, b: Self::Vector<S>) -> Self::Mask<S>;
    fn equal<S: Simd>(simd: S, a: Self::Vector<S>, b: Self::Vector<S>) -> Self::Mask<S>;
    fn both<S: Simd>(simd: S, a: Self::Mask<S>, b: Self::Mask<S>) -> Self::Mask<S>;
    fn select<S: Simd>(simd: S, mask: Self::Mask<S>, yes: Self::Vector<S>, no: Self::Vector<S>) -> Self::Vector<S>;
    fn exp<S: Simd>(x: Wide<S, Self>) -> Wide<S, Self>;
    fn ln<S: Simd>(x: Wide<S, Self>) -> Wide<S, Self>;
}

macro_rules! lanes {
    ($float:ty, $vector:ident, $mask:ident, $splat:ident, $both:ident, $select:ident, $exp:path, $ln:path,
     [$($one:ident: $its:ident),*], [$($own:ident: $theirs:ident),*], [$($test:ident: $tests:ident),*]) => {
        impl Lanes for $float {
            type Vector<S: Simd> = S::$vector;
            type Mask<S: Simd> = S::$mask;

            #[inline(always)]
            fn splat<S: Simd>(simd: S, value: Self) -> S::$vector {
                simd.$splat(value)
            }

            $(#[inline(always)]
            fn $one<S: Simd>(simd: S, a: S::$vector) -> S::$vector {
                simd.$its(a)
            })*

            $(#[inline(always)]
            fn $own<S: Simd>(simd: S, a: S::$vector, b: S::$vector) -> S::$vector {
                simd.$theirs(a, b)
            })*

            $(#[inline(always)]
            fn $test<S: Simd>(simd: S, a: S::$vector, b: S::$vector) -> S::$mask {
                simd.$tests(a, b)
            })*

            #[inline(always)]
            fn both<S: Simd>(simd: S, a: S::$mask, b: S::$mask) -> S::$mask {
                simd.$both(a, b)
            }

            #[inline(always)]
            fn select<S: Simd>(simd: S, mask: S::$mask, yes: S::$vector, no: S::$vector) -> S::$vector {
                simd.$select(mask, yes, no)
            }

            #[inline(always)]
            fn exp<S: Simd>(x: Wide<S, Self>) -> Wide<S, Self> {
                $exp(x)
            }

            #[inline(always)]
            fn ln<S: Simd>(x: Wide<S, Self>) -> Wide<S, Self> {
                $ln(x)
            }
        }
    };
}
lanes!(
    f32, f32s, m32s, splat_f32s, and_m32s, select_f32s, elementary::exp_single, elementary::ln_single,
    [sqrt: sqrt_f32s, neg: neg_f32s],
    [add: add_f32s, sub: sub_f32s, mul: mul_f32s, div: div_f32s, max: max_f32s, min: min_f32s],
    [less: less_than_f32s, not_above: less_than_or_equal_f32s, equal: equal_f32s]
);
lanes!(
    f64, f64s, m64s, splat_f64s, and_m64s, select_f64s, elementary::exp_double, elementary::ln_double,
    [sqrt: sqrt_f64s, neg: neg_f64s],
    [add: add_f64s, sub: sub_f64s, mul: mul_f64s, div: div_f64s, max: max_f64s, min: min_f64s],
    [less: less_than_f64s, not_above: less_than_or_equal_f64s, equal: equal_f64s]
);

/// A vector with its instruction set, so that the usual operators work.
#[derive(Clone, Copy)]
pub(crate) struct Wide<S: Simd, T: Lanes> {
    simd: S,
    vector: T::Vector<S>,
}

/// Largest number of lanes of a vector.
pub(crate) const MAX_LANES: usize = 16;

impl<S: Simd, T: Lanes> Wide<S, T> {
    /// Number of lanes, at most [`MAX_LANES`].
    pub(crate) const LANES: usize = size_of::<T::Vector<S>>() / size_of::<T>();

    #[inline(always)]
    pub(crate) fn splat(simd: S, value: T) -> Self {
        Self { simd, vector: T::splat(simd, value) }
    }

    /// A vector for each of several values.
    #[inline(always)]
    pub(crate) fn splat_each<const N: usize>(simd: S, values: [T; N]) -> [Self; N] {
        let mut vectors = [Self::splat(simd, T::zero()); N];
        for (vector, value) in vectors.iter_mut().zip(values) {
            *vector = Self::splat(simd, value);
        }
        vectors
    }

    /// Loads the values from `at` on.
    #[inline(always)]
    pub(crate) fn load(simd: S, numbers: &[T], at: usize) -> Self {
        let block = &numbers[at..at + Self::LANES];
        Self { simd, vector: bytemuck::pod_read_unaligned(bytemuck::cast_slice(block)) }
    }

    /// Stores the values from `at` on.
    #[inline(always)]
    pub(crate) fn store(self, numbers: &mut [T], at: usize) {
        numbers[at..at + Self::LANES].copy_from_slice(bytemuck::cast_slice(std::slice::from_ref(&self.vector)));
    }

    /// Loads the values from `at` on, and zeros beyond the last one.
    #[inline(always)]
    pub(crate) fn load_up_to_end(simd: S, numbers: &[T], at: usize) -> Self {
        if at + Self::LANES <= numbers.len() {
            return Self::load(simd, numbers, at);
        }
        let mut block = [T::zero(); MAX_LANES];
        block[..numbers.len() - at].copy_from_slice(&numbers[at..]);
        Self::load(simd, &block, 0)
    }

    /// Stores the values from `at` on, without those beyond the last one.
    #[inline(always)]
    pub(crate) fn store_up_to_end(self, numbers: &mut [T], at: usize) {
        if at + Self::LANES <= numbers.len() {
            return self.store(numbers, at);
        }
        let mut block = [T::zero(); MAX_LANES];
        self.store(&mut block, 0);
        let rest = &mut numbers[at..];
        rest.copy_from_slice(&block[..rest.len()]);
    }

    /// A vector of one value of the float's own type with the same instruction set.
    #[inline(always)]
    pub(crate) fn scalar(self, value: T) -> Self {
        Self::splat(self.simd, value)
    }

    /// A vector of one value with the same instruction set.
    #[inline(always)]
    pub(crate) fn value(self, value: f64) -> Self {
        Self::splat(self.simd, T::of(value))
    }

    #[inline(always)]
    pub(crate) fn max(self, other: Self) -> Self {
        Self { simd: self.simd, vector: <T as Lanes>::max(self.simd, self.vector, other.vector) }
    }

    #[inline(always)]
    pub(crate) fn min(self, other: Self) -> Self {
        Self { simd: self.simd, vector: <T as Lanes>::min(self.simd, self.vector, other.vector) }
    }

    #[inline(always)]
    pub(crate) fn sqrt(self) -> Self {
        Self { simd: self.simd, vector: <T as Lanes>::sqrt(self.simd, self.vector) }
    }

    /// `exp(x)`. In single precision, results below the smallest normal number are zero.
    #[inline(always)]
    pub(crate) fn exp(self) -> Self {
        <T as Lanes>::exp(self)
    }

    /// `ln(x)` for finite `x >= 0`. In single precision, arguments below the smallest normal number count as zero.
    #[inline(always)]
    pub(crate) fn ln(self) -> Self {
        <T as Lanes>::ln(self)
    }

    /// The smaller; `bound` where this vector is NaN.
    #[inline(always)]
    pub(crate) fn at_most(self, bound: Self) -> Self {
        self.less(bound).select(self, bound)
    }

    /// `self < other`, false for NaN.
    #[inline(always)]
    pub(crate) fn less(self, other: Self) -> Mask<S, T> {
        Mask { simd: self.simd, mask: T::less(self.simd, self.vector, other.vector) }
    }

    /// `self <= other`, false for NaN.
    #[inline(always)]
    pub(crate) fn not_above(self, other: Self) -> Mask<S, T> {
        Mask { simd: self.simd, mask: T::not_above(self.simd, self.vector, other.vector) }
    }

    /// `self == other`, false for NaN.
    #[inline(always)]
    pub(crate) fn equal(self, other: Self) -> Mask<S, T> {
        Mask { simd: self.simd, mask: T::equal(self.simd, self.vector, other.vector) }
    }

    /// This vector where `a` equals `b`, zero elsewhere.
    #[inline(always)]
    pub(crate) fn where_equal(self, a: Self, b: Self) -> Self {
        a.equal(b).or_zero(self)
    }

    /// `yes` where this vector is less than `bound`, `no` elsewhere and where it is NaN.
    #[inline(always)]
    pub(crate) fn if_less(self, bound: Self, yes: Self, no: Self) -> Self {
        self.less(bound).select(yes, no)
    }

    /// The lanes of this vector, then zeros.
    #[inline(always)]
    pub(crate) fn to_lanes(self) -> [T; MAX_LANES] {
        let mut lanes = [T::zero(); MAX_LANES];
        self.store(&mut lanes, 0);
        lanes
    }
}

/// A boolean for each lane of a [`Wide`].
#[derive(Clone, Copy)]
pub(crate) struct Mask<S: Simd, T: Lanes> {
    simd: S,
    mask: T::Mask<S>,
}

impl<S: Simd, T: Lanes> Mask<S, T> {
    /// Logical and.
    #[inline(always)]
    pub(crate) fn and(self, other: Self) -> Self {
        Self { simd: self.simd, mask: T::both(self.simd, self.mask, other.mask) }
    }

    /// `yes` where the mask is true, else `no`.
    #[inline(always)]
    pub(crate) fn select(self, yes: Wide<S, T>, no: Wide<S, T>) -> Wide<S, T> {
        Wide { simd: self.simd, vector: T::select(self.simd, self.mask, yes.vector, no.vector) }
    }

    /// `yes` where the mask is true, else zero.
    #[inline(always)]
    pub(crate) fn or_zero(self, yes: Wide<S, T>) -> Wide<S, T> {
        self.select(yes, Wide::splat(self.simd, T::zero()))
    }

    /// The lanes of this mask, then `false`.
    #[inline(always)]
    pub(crate) fn to_lanes(self) -> [bool; MAX_LANES] {
        let one = self.or_zero(Wide::splat(self.simd, T::one())).to_lanes();
        let mut lanes = [false; MAX_LANES];
        for (lane, one) in lanes.iter_mut().zip(one) {
            *lane = one != T::zero();
        }
        lanes
    }
}

macro_rules! operator {
    ($($name:ident $method:ident),*) => {
        $(impl<S: Simd, T: Lanes> $name for Wide<S, T> {
            type Output = Self;

            #[inline(always)]
            fn $method(self, other: Self) -> Self {
                Self { simd: self.simd, vector: <T as Lanes>::$method(self.simd, self.vector, other.vector) }
            }
        }

        impl<S: Simd, T: Lanes> $name<T> for Wide<S, T> {
            type Output = Self;

            #[inline(always)]
            fn $method(self, other: T) -> Self {
                $name::$method(self, Self::splat(self.simd, other))
            }
        })*
    };
}
operator!(Add add, Sub sub, Mul mul, Div div);

impl<S: Simd, T: Lanes> Neg for Wide<S, T> {
    type Output = Self;

    #[inline(always)]
    fn neg(self) -> Self {
        Self { simd: self.simd, vector: <T as Lanes>::neg(self.simd, self.vector) }
    }
}
