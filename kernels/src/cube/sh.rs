//! Colours from spherical harmonics, and their gradients. CPU twin: `splat/cpu/sh.rs`.

use cubecl::prelude::*;

use super::maths::{Triple, constant, dot, triple_at};
use crate::sh::{MAX_DEGREE, SH_C0, SH_C1, SH_C2, SH_C3, coefficient_count};

/// Coefficients of the highest degree.
const MAX_COEFFICIENTS: usize = coefficient_count(MAX_DEGREE);

/// The basis at a unit direction up to `degree`.
#[cube]
pub fn basis(direction: &Triple, #[comptime] degree: usize) -> Array<f32> {
    let (x, y, z) = (direction.x, direction.y, direction.z);
    let mut basis = Array::<f32>::new(MAX_COEFFICIENTS);
    basis[0] = constant(SH_C0);
    if comptime!(degree >= 1) {
        let c = constant(SH_C1);
        basis[1] = -c * y;
        basis[2] = c * z;
        basis[3] = -c * x;
    }
    let (xx, yy, zz) = (x * x, y * y, z * z);
    if comptime!(degree >= 2) {
        basis[4] = constant(SH_C2[0]) * x * y;
        basis[5] = constant(SH_C2[1]) * y * z;
        basis[6] = constant(SH_C2[2]) * (2.0f32 * zz - xx - yy);
        basis[7] = constant(SH_C2[3]) * x * z;
        basis[8] = constant(SH_C2[4]) * (xx - yy);
    }
    if comptime!(degree >= 3) {
        basis[9] = constant(SH_C3[0]) * y * (3.0f32 * xx - yy);
        basis[10] = constant(SH_C3[1]) * x * y * z;
        basis[11] = constant(SH_C3[2]) * y * (4.0f32 * zz - xx - yy);
        basis[12] = constant(SH_C3[3]) * z * (2.0f32 * zz - 3.0f32 * xx - 3.0f32 * yy);
        basis[13] = constant(SH_C3[4]) * x * (4.0f32 * zz - xx - yy);
        basis[14] = constant(SH_C3[5]) * z * (xx - yy);
        basis[15] = constant(SH_C3[6]) * x * (xx - 3.0f32 * yy);
    }
    basis
}

/// Colour before its clamp at zero; `first` is the row of `sh` with the Gaussian's first coefficient.
#[cube]
pub fn colour(direction: &Triple, sh: &[f32], first: usize, #[comptime] degree: usize) -> Triple {
    let basis = basis(direction, degree);
    let mut red = 0.5f32;
    let mut green = 0.5f32;
    let mut blue = 0.5f32;
    #[unroll]
    for k in 0..comptime!(coefficient_count(degree)) {
        let row = triple_at(sh, first + k);
        red += basis[k] * row.x;
        green += basis[k] * row.y;
        blue += basis[k] * row.z;
    }
    Triple { x: red, y: green, z: blue }
}

/// Gradient of `v_colour · colour` with respect to the direction, without the constraint of unit length.
#[cube]
pub fn direction_gradient(
    direction: &Triple,
    sh: &[f32],
    first: usize,
    v_colour: &Triple,
    #[comptime] degree: usize,
) -> Triple {
    let (x, y, z) = (direction.x, direction.y, direction.z);
    let mut w = Array::<f32>::new(MAX_COEFFICIENTS);
    #[unroll]
    for k in 0..comptime!(coefficient_count(degree)) {
        w[k] = dot(&triple_at(sh, first + k), v_colour);
    }
    let mut by_x = 0.0f32;
    let mut by_y = 0.0f32;
    let mut by_z = 0.0f32;
    if comptime!(degree >= 1) {
        let c = constant(SH_C1);
        by_x -= c * w[3];
        by_y -= c * w[1];
        by_z += c * w[2];
    }
    if comptime!(degree >= 2) {
        let xy = constant(SH_C2[0]) * w[4];
        let yz = constant(SH_C2[1]) * w[5];
        let zz = 2.0f32 * constant(SH_C2[2]) * w[6];
        let xz = constant(SH_C2[3]) * w[7];
        let xx = 2.0f32 * constant(SH_C2[4]) * w[8];
        by_x += xy * y - zz * x + xz * z + xx * x;
        by_y += xy * x + yz * z - zz * y - xx * y;
        by_z += yz * y + 2.0f32 * zz * z + xz * x;
    }
    if comptime!(degree >= 3) {
        let (xx, yy, zz) = (x * x, y * y, z * z);
        let a = constant(SH_C3[0]) * w[9];
        let b = constant(SH_C3[1]) * w[10];
        let c = constant(SH_C3[2]) * w[11];
        let d = constant(SH_C3[3]) * w[12];
        let e = constant(SH_C3[4]) * w[13];
        let f = constant(SH_C3[5]) * w[14];
        let g = constant(SH_C3[6]) * w[15];
        by_x += 6.0f32 * a * x * y + b * y * z - 2.0f32 * c * x * y - 6.0f32 * d * x * z
            + e * (4.0f32 * zz - 3.0f32 * xx - yy)
            + 2.0f32 * f * x * z
            + 3.0f32 * g * (xx - yy);
        by_y += 3.0f32 * a * (xx - yy) + b * x * z + c * (4.0f32 * zz - xx - 3.0f32 * yy)
            - 6.0f32 * d * y * z
            - 2.0f32 * e * x * y
            - 2.0f32 * f * y * z
            - 6.0f32 * g * x * y;
        by_z += b * x * y
            + 8.0f32 * c * y * z
            + d * (6.0f32 * zz - 3.0f32 * xx - 3.0f32 * yy)
            + 8.0f32 * e * x * z
            + f * (xx - yy);
    }
    Triple { x: by_x, y: by_y, z: by_z }
}
