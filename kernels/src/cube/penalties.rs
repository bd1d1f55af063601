//! The penalties that keep a HexPlane smooth, and their adjoint. CPU twin: `grid/regulariser/cpu.rs`.
//!
//! `layout` `[planes, 4]` has each plane's first cell, width, height, and 1 if its height is time.

use cubecl::prelude::*;

use super::UNITS;

/// Length of a plane's layout.
pub const PLANE_LAYOUT: usize = 4;
/// Number of terms: plane smoothness, time smoothness, distance of the time planes from 1.
pub const TERMS: usize = 3;

/// Values that a unit sums.
const ITEMS: usize = 16;
/// Values that a cube sums.
pub const PENALTY_BLOCK: usize = UNITS * ITEMS;

/// Each cube's part of the terms, already divided by the counts of their means: `sums` `[cubes, TERMS]`.
#[cube(launch_unchecked)]
pub fn penalties(planes: &[f32], layout: &[u32], sums: &mut [f32], numbers: u32, features: u32, cubes: u32) {
    let mut scratch = Shared::<[f32]>::new_slice(comptime!(TERMS * UNITS));
    if CUBE_POS < cubes as usize {
        let unit = UNIT_POS as usize;
        let mut plane_smooth = 0.0f32;
        let mut time_smooth = 0.0f32;
        let mut distance = 0.0f32;
        for item in 0..ITEMS {
            let at = CUBE_POS * PENALTY_BLOCK + item * UNITS + unit;
            if at < numbers as usize {
                let own = number_of(layout, at as u32, features);
                let value = planes[at];
                if own.row + 2u32 < own.height {
                    let row = (own.width * features) as usize;
                    let next = planes[at + row];
                    let difference = second_difference(value, next, planes[at + 2 * row]);
                    let smooth = difference * difference / (row as f32 * f32::cast_from(own.height - 2u32));
                    if own.time {
                        time_smooth += smooth;
                    } else {
                        plane_smooth += smooth;
                    }
                }
                if own.time {
                    distance += (1.0f32 - value).abs() / f32::cast_from(own.width * features * own.height);
                }
            }
        }
        scratch[unit] = plane_smooth;
        scratch[UNITS + unit] = time_smooth;
        scratch[2 * UNITS + unit] = distance;
        sync_cube();
        let mut half = CUBE_DIM as usize / 2;
        while half > 0 {
            if unit < half {
                #[unroll]
                for term in 0..TERMS {
                    scratch[term * UNITS + unit] += scratch[term * UNITS + unit + half];
                }
            }
            sync_cube();
            half /= 2;
        }
        if unit < TERMS {
            sums[CUBE_POS * TERMS + unit] = scratch[unit * UNITS];
        }
    }
}

/// The adjoint of the planes for the cotangents `v_terms` `[TERMS]`. A unit is one value of a plane.
#[cube(launch_unchecked)]
pub fn penalties_backward(
    planes: &[f32],
    layout: &[u32],
    v_terms: &[f32],
    v_planes: &mut [f32],
    numbers: u32,
    features: u32,
) {
    let at = ABSOLUTE_POS;
    if at < numbers as usize {
        let own = number_of(layout, at as u32, features);
        let row = (own.width * features) as usize;
        let mut sum = 0.0f32;
        if own.height > 2u32 {
            let v =
                v_terms[select(own.time, 1usize, 0usize)] * 2.0f32 / (row as f32 * f32::cast_from(own.height - 2u32));
            // The value is the first, the middle and the last element of up to three differences.
            if own.row + 2u32 < own.height {
                sum += v * second_difference(planes[at], planes[at + row], planes[at + 2 * row]);
            }
            if own.row >= 1u32 && own.row + 1u32 < own.height {
                sum -= 2.0f32 * v * second_difference(planes[at - row], planes[at], planes[at + row]);
            }
            if own.row >= 2u32 {
                sum += v * second_difference(planes[at - 2 * row], planes[at - row], planes[at]);
            }
        }
        if own.time {
            let v = v_terms[2] / f32::cast_from(own.width * features * own.height);
            let value = planes[at];
            sum += select(value > 1.0f32, v, select(value < 1.0f32, -v, 0.0f32));
        }
        v_planes[at] = sum;
    }
}

/// `c - 2 b + a` as the difference of two differences; see the twin.
#[cube]
fn second_difference(a: f32, b: f32, c: f32) -> f32 {
    (c - b) - (b - a)
}

/// The position of a value.
#[derive(CubeType, Clone, Copy)]
struct Number {
    /// Width of its plane.
    width: u32,
    height: u32,
    /// Row in its plane.
    row: u32,
    /// Whether the plane's height is time.
    time: bool,
}

#[cube]
fn number_of(layout: &[u32], number: u32, features: u32) -> Number {
    let cell = number / features;
    let planes = layout.len() / PLANE_LAYOUT;
    let mut plane = 0usize;
    for other in 1..planes {
        if layout[other * PLANE_LAYOUT] <= cell {
            plane = other;
        }
    }
    let first = plane * PLANE_LAYOUT;
    let width = layout[first + 1];
    Number { width, height: layout[first + 2], row: (cell - layout[first]) / width, time: layout[first + 3] == 1u32 }
}
