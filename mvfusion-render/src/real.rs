//! The two floating-point types that the CPU twins run in.

use burn::tensor::{DType, Element};
use bytemuck::Pod;
use num_traits::{Float, FromPrimitive};

/// `f32` for work, `f64` for finite differences.
pub trait Real: Float + FromPrimitive + Element + Pod + Send + Sync + std::iter::Sum + std::ops::AddAssign + std::ops::MulAssign + std::ops::SubAssign + 'static {
    /// The tensor type of this float.
    const DTYPE: DType;

    /// The nearest value of this type.
    fn of(value: f64) -> Self;
}

impl Real for f32 {
    const DTYPE: DType = DType::F32;

    #[inline(always)]
    fn of(value: f64) -> Self {
        value as f32
    }
}

impl Real for f64 {
    const DTYPE: DType = DType::F64;

    #[inline(always)]
    fn of(value: f64) -> Self {
        value
    }
}
