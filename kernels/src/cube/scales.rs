//! The cost of large and of elongated Gaussians, and its adjoint. CPU twin: `scales/cpu.rs`.

use cubecl::prelude::*;

use super::UNITS;

/// Gaussians that a unit sums.
const ITEMS: usize = 4;
/// Gaussians that a cube sums.
pub const SCALES_BLOCK: usize = UNITS * ITEMS;

/// Weights of the two terms, each divided by the number of Gaussians, and the values above which they count.
#[derive(CubeType, CubeLaunch, Clone, Copy)]
pub struct ScaleRule {
    /// Weight of the largest scale.
    pub large: f32,
    /// Scale above which a Gaussian is large.
    pub large_above: f32,
    /// Weight of the ratio of the largest to the smallest scale.
    pub spiky: f32,
    /// Ratio above which a Gaussian is spiky.
    pub spiky_above: f32,
}

/// The axes of the largest and the smallest scale, the first of equal ones.
#[derive(CubeType, Clone, Copy)]
struct Extremes {
    largest: usize,
    smallest: usize,
    scale: f32,
    ratio: f32,
}

/// Each cube's part of the cost, `sums` `[cubes, 1]`, of the log-scales `[count, 3]`.
#[cube(launch_unchecked)]
pub fn scale_cost(log_scales: &[f32], sums: &mut [f32], rule: ScaleRule, count: u32, cubes: u32) {
    let mut scratch = Shared::<[f32]>::new_slice(UNITS);
    if CUBE_POS < cubes as usize {
        let unit = UNIT_POS as usize;
        let mut sum = 0.0f32;
        for item in 0..ITEMS {
            let at = CUBE_POS * SCALES_BLOCK + item * UNITS + unit;
            if at < count as usize {
                let found = extremes(log_scales, at);
                // A term without weight adds nothing, also where it is infinite.
                let large = rule.large * max(found.scale - rule.large_above, 0.0f32);
                let spiky = rule.spiky * max(found.ratio - rule.spiky_above, 0.0f32);
                sum += select(rule.large > 0.0f32, large, 0.0f32) + select(rule.spiky > 0.0f32, spiky, 0.0f32);
            }
        }
        scratch[unit] = sum;
        sync_cube();
        let mut half = CUBE_DIM as usize / 2;
        while half > 0 {
            if unit < half {
                scratch[unit] += scratch[unit + half];
            }
            sync_cube();
            half /= 2;
        }
        if unit == 0 {
            sums[CUBE_POS] = scratch[0];
        }
    }
}

/// The adjoint of the log-scales for the cotangent `v_cost` `[1]`. A unit is one Gaussian.
#[cube(launch_unchecked)]
pub fn scale_cost_backward(log_scales: &[f32], v_cost: &[f32], v_log_scales: &mut [f32], rule: ScaleRule, count: u32) {
    let at = ABSOLUTE_POS;
    if at < count as usize {
        let found = extremes(log_scales, at);
        let is_large = rule.large > 0.0f32 && found.scale > rule.large_above;
        let is_spiky = rule.spiky > 0.0f32 && found.ratio > rule.spiky_above;
        let v_large = select(is_large, v_cost[0] * rule.large * found.scale, 0.0f32);
        let v_spiky = select(is_spiky, v_cost[0] * rule.spiky * found.ratio, 0.0f32);
        #[unroll]
        for axis in 0..3usize {
            let up = select(axis == found.largest, v_large + v_spiky, 0.0f32);
            v_log_scales[3 * at + axis] = up - select(axis == found.smallest, v_spiky, 0.0f32);
        }
    }
}

#[cube]
fn extremes(log_scales: &[f32], at: usize) -> Extremes {
    let mut largest = 0usize;
    let mut smallest = 0usize;
    let mut most = log_scales[3 * at];
    let mut least = most;
    #[unroll]
    for axis in 1..3usize {
        let value = log_scales[3 * at + axis];
        if value > most {
            most = value;
            largest = axis;
        }
        if value < least {
            least = value;
            smallest = axis;
        }
    }
    Extremes { largest, smallest, scale: most.exp(), ratio: (most - least).exp() }
}
