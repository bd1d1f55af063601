//! Vector instructions selected at run time, for loops that the compiler vectorises and as an explicit type.
//!
//! Results do not depend on the instruction set: sums keep their written order, and nothing is contracted.

use std::ops::{Add, Div, Mul, Sub};

use bytemuck::Pod;
use pulp::{Arch, Simd, WithSimd};

use crate::Real;

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

/// A float with a vector type. The methods implement the operators of [`Wide`].
pub(crate) trait Lanes: Real {
    /// A register of this float.
    type Vector<S: Simd>: Copy + Pod;

    fn splat<S: Simd>(simd: S, value: Self) -> Self::Vector<S>;
    fn add<S: Simd>(simd: S, a: Self::Vector<S>, b: Self::Vector<S>) -> Self::Vector<S>;
    fn sub<S: Simd>(simd: S, a: Self::Vector<S>, b: Self::Vector<S>) -> Self::Vector<S>;
    fn mul<S: Simd>(simd: S, a: Self::Vector<S>, b: Self::Vector<S>) -> Self::Vector<S>;
    fn div<S: Simd>(simd: S, a: Self::Vector<S>, b: Self::Vector<S>) -> Self::Vector<S>;
    fn max<S: Simd>(simd: S, a: Self::Vector<S>, b: Self::Vector<S>) -> Self::Vector<S>;
    fn min<S: Simd>(simd: S, a: Self::Vector<S>, b: Self::Vector<S>) -> Self::Vector<S>;
    fn sqrt<S: Simd>(simd: S, a: Self::Vector<S>) -> Self::Vector<S>;
    fn where_equal<S: Simd>(
        simd: S,
        pair: [Self::Vector<S>; 2],
        a: Self::Vector<S>,
        b: Self::Vector<S>,
    ) -> Self::Vector<S>;
    fn where_less<S: Simd>(
        simd: S,
        pair: [Self::Vector<S>; 2],
        a: Self::Vector<S>,
        b: Self::Vector<S>,
    ) -> Self::Vector<S>;
}

macro_rules! lanes {
    ($float:ty, $vector:ident, $splat:ident, $sqrt:ident, $equal:ident, $less:ident, $select:ident,
     $($own:ident: $theirs:ident),*) => {
        impl Lanes for $float {
            type Vector<S: Simd> = S::$vector;

            #[inline(always)]
            fn splat<S: Simd>(simd: S, value: Self) -> S::$vector {
                simd.$splat(value)
            }

            $(#[inline(always)]
            fn $own<S: Simd>(simd: S, a: S::$vector, b: S::$vector) -> S::$vector {
                simd.$theirs(a, b)
            })*

            #[inline(always)]
            fn sqrt<S: Simd>(simd: S, a: S::$vector) -> S::$vector {
                simd.$sqrt(a)
            }

            #[inline(always)]
            fn where_equal<S: Simd>(simd: S, pair: [S::$vector; 2], a: S::$vector, b: S::$vector) -> S::$vector {
                simd.$select(simd.$equal(pair[0], pair[1]), a, b)
            }

            #[inline(always)]
            fn where_less<S: Simd>(simd: S, pair: [S::$vector; 2], a: S::$vector, b: S::$vector) -> S::$vector {
                simd.$select(simd.$less(pair[0], pair[1]), a, b)
            }
        }
    };
}
lanes!(f32, f32s, splat_f32s, sqrt_f32s, equal_f32s, less_than_f32s, select_f32s,
    add: add_f32s, sub: sub_f32s, mul: mul_f32s, div: div_f32s, max: max_f32s, min: min_f32s);
lanes!(f64, f64s, splat_f64s, sqrt_f64s, equal_f64s, less_than_f64s, select_f64s,
    add: add_f64s, sub: sub_f64s, mul: mul_f64s, div: div_f64s, max: max_f64s, min: min_f64s);

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

    /// Applies a scalar function to every lane.
    #[inline(always)]
    pub(crate) fn map(self, function: impl Fn(T) -> T) -> Self {
        let mut block = [T::zero(); MAX_LANES];
        self.store(&mut block, 0);
        for lane in &mut block[..Self::LANES] {
            *lane = function(*lane);
        }
        Self::load(self.simd, &block, 0)
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

    /// This vector where `a` equals `b`, zero elsewhere.
    #[inline(always)]
    pub(crate) fn where_equal(self, a: Self, b: Self) -> Self {
        let zero = T::splat(self.simd, T::zero());
        let vector = T::where_equal(self.simd, [a.vector, b.vector], self.vector, zero);
        Self { simd: self.simd, vector }
    }

    /// `yes` where this vector is less than `bound`, `no` elsewhere and where it is NaN.
    #[inline(always)]
    pub(crate) fn if_less(self, bound: Self, yes: Self, no: Self) -> Self {
        let vector = T::where_less(self.simd, [self.vector, bound.vector], yes.vector, no.vector);
        Self { simd: self.simd, vector }
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
        })*
    };
}
operator!(Add add, Sub sub, Mul mul, Div div);
