//! Formulas for one number or for a vector of them.

use std::ops::{Add, Div, Mul, Neg, Sub};

use pulp::Simd;

use super::{Lanes, Wide};

/// A number, or a vector of numbers.
pub(crate) trait Number:
    Copy + Add<Output = Self> + Sub<Output = Self> + Mul<Output = Self> + Div<Output = Self> + Neg<Output = Self>
{
    /// A constant. Its type and its instruction set are those of `self`.
    fn value(self, value: f64) -> Self;

    /// The larger; `bound` where this number is NaN.
    fn at_least(self, bound: Self) -> Self;

    /// This number times a constant.
    #[inline(always)]
    fn times(self, factor: f64) -> Self {
        self.value(factor) * self
    }
}

macro_rules! scalar {
    ($($float:ty)*) => {
        $(impl Number for $float {
            #[inline(always)]
            fn value(self, value: f64) -> Self {
                value as $float
            }

            #[inline(always)]
            fn at_least(self, bound: Self) -> Self {
                if bound < self { self } else { bound }
            }
        })*
    };
}
scalar!(f32 f64);

impl<S: Simd, T: Lanes> Number for Wide<S, T> {
    #[inline(always)]
    fn value(self, value: f64) -> Self {
        Wide::value(self, value)
    }

    #[inline(always)]
    fn at_least(self, bound: Self) -> Self {
        bound.less(self).select(self, bound)
    }
}

/// Scalar product.
#[inline(always)]
pub(crate) fn dot<N: Number>(a: [N; 3], b: [N; 3]) -> N {
    a[0] * b[0] + a[1] * b[1] + a[2] * b[2]
}

/// Cross product.
#[inline(always)]
pub(crate) fn cross<N: Number>(a: [N; 3], b: [N; 3]) -> [N; 3] {
    [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]]
}
