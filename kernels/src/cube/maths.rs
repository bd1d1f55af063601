//! Vectors of two and three numbers, and arithmetic that several kernels use.

use cubecl::prelude::*;

/// Two numbers.
#[derive(CubeType, CubeLaunch, Clone, Copy)]
pub struct Pair {
    /// Along x.
    pub x: f32,
    /// Along y.
    pub y: f32,
}

/// Three numbers.
#[derive(CubeType, CubeLaunch, Clone, Copy)]
pub struct Triple {
    /// Along x.
    pub x: f32,
    /// Along y.
    pub y: f32,
    /// Along z.
    pub z: f32,
}

/// A host constant in single precision.
#[cube]
pub fn constant(#[comptime] value: f64) -> f32 {
    f32::new(comptime!(value as f32))
}

/// The `index`-th group of three neighbouring numbers.
#[cube]
pub fn triple_at(values: &[f32], index: usize) -> Triple {
    Triple { x: values[3 * index], y: values[3 * index + 1], z: values[3 * index + 2] }
}

/// `a b`, element by element.
#[cube]
pub fn multiplied(a: &Triple, b: &Triple) -> Triple {
    Triple { x: a.x * b.x, y: a.y * b.y, z: a.z * b.z }
}

/// The vector times a factor.
#[cube]
pub fn scaled(a: &Triple, factor: f32) -> Triple {
    Triple { x: a.x * factor, y: a.y * factor, z: a.z * factor }
}

/// The sum, element by element.
#[cube]
pub fn sum(a: &Triple, b: &Triple) -> Triple {
    Triple { x: a.x + b.x, y: a.y + b.y, z: a.z + b.z }
}

/// Scalar product.
#[cube]
pub fn dot(a: &Triple, b: &Triple) -> f32 {
    a.x * b.x + a.y * b.y + a.z * b.z
}

/// Cross product.
#[cube]
pub fn cross(a: &Triple, b: &Triple) -> Triple {
    Triple { x: a.y * b.z - a.z * b.y, y: a.z * b.x - a.x * b.z, z: a.x * b.y - a.y * b.x }
}

/// Whether a number is neither infinite nor NaN. It tests the bits, because a shader compiler may assume that floats
/// are finite.
#[cube]
pub fn is_finite(x: f32) -> bool {
    (u32::reinterpret(x) & 0x7f80_0000u32) != 0x7f80_0000u32
}

/// Whether a number is zero or negative. NaN is neither. It tests the bits, like [`is_finite()`].
#[cube]
pub fn at_most_zero(x: f32) -> bool {
    let bits = u32::reinterpret(x);
    let magnitude = bits & 0x7fff_ffffu32;
    magnitude == 0u32 || (bits != magnitude && magnitude <= 0x7f80_0000u32)
}

/// The ReLU. NaN stays, so that it shows; `max` would turn it into zero.
#[cube]
pub(super) fn rectified(value: f32) -> f32 {
    select(at_most_zero(value), 0.0f32, value)
}

/// Whether all three are finite.
#[cube]
pub fn all_finite(a: &Triple) -> bool {
    is_finite(a.x) && is_finite(a.y) && is_finite(a.z)
}

/// The logistic function, by the exponential that does not overflow: WGSL guarantees no infinity.
#[cube]
pub fn sigmoid(x: f32) -> f32 {
    let odds = (-x.abs()).exp();
    select(x < 0.0f32, odds, 1.0f32) / (1.0f32 + odds)
}
