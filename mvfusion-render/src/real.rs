//! The two floating-point types of the CPU twins.

use std::iter::Sum;
use std::ops::{AddAssign, MulAssign, SubAssign};

use burn::tensor::Element;
use bytemuck::Pod;
use num_traits::{Float, FromPrimitive};

/// `f32` for training, `f64` for finite differences.
pub trait Real:
    Float + FromPrimitive + Element + Pod + Send + Sync + Sum + AddAssign + MulAssign + SubAssign + 'static
{
    /// The nearest value of this type.
    fn of(value: f64) -> Self;

    /// The value in double precision.
    fn wide(self) -> f64;

    /// The value as an index, truncated towards zero. NaN and negative numbers give 0; the largest index is `i32::MAX`.
    fn trunc_index(self) -> usize;

    /// An index below `i32::MAX` as a value.
    fn of_index(index: usize) -> Self;
}

impl Real for f32 {
    #[inline(always)]
    fn of(value: f64) -> Self {
        value as f32
    }

    #[inline(always)]
    fn wide(self) -> f64 {
        f64::from(self)
    }

    #[inline(always)]
    fn trunc_index(self) -> usize {
        (self as i32).max(0) as usize
    }

    #[inline(always)]
    fn of_index(index: usize) -> Self {
        index as i32 as Self
    }
}

impl Real for f64 {
    #[inline(always)]
    fn of(value: f64) -> Self {
        value
    }

    #[inline(always)]
    fn wide(self) -> f64 {
        self
    }

    #[inline(always)]
    fn trunc_index(self) -> usize {
        (self as i32).max(0) as usize
    }

    #[inline(always)]
    fn of_index(index: usize) -> Self {
        index as i32 as Self
    }
}

/// Evaluates `$body` with `$T` as the float type of `$dtype`. Panics for other types.
macro_rules! with_real {
    ($dtype:expr, $T:ident => $body:expr) => {
        match $dtype {
            burn::tensor::DType::F32 => {
                type $T = f32;
                $body
            }
            burn::tensor::DType::F64 => {
                type $T = f64;
                $body
            }
            // Proof: an op's public function rejects other dtypes, or lists them under `Panics`.
            other => panic!("CPU twins run in f32 and f64, not in {other:?}"),
        }
    };
}
pub(crate) use with_real;
