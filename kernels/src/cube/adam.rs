//! Adam, element by element. CPU twin: `optim/cpu.rs`.

use cubecl::prelude::*;

use super::maths::{constant, is_finite};
use crate::adam::LARGEST_GRADIENT;

/// The constants of one step.
#[derive(CubeType, CubeLaunch, Clone, Copy)]
pub struct AdamStep {
    /// Decay of the first moment.
    pub beta1: f32,
    /// One minus that decay.
    pub rest1: f32,
    /// Decay of the second moment.
    pub beta2: f32,
    /// One minus that decay.
    pub rest2: f32,
    /// Learning rate divided by the first moment's bias correction.
    pub rate: f32,
    /// Inverse square root of the second moment's bias correction.
    pub root: f32,
    /// Added to the square root of the second moment.
    pub epsilon: f32,
}

/// One step of a parameter, in place.
#[cube(launch)]
pub fn adam(
    values: &mut [f32],
    firsts: &mut [f32],
    seconds: &mut [f32],
    gradients: &[f32],
    count: u32,
    step: AdamStep,
) {
    if ABSOLUTE_POS < count as usize {
        advance(values, firsts, seconds, gradients, ABSOLUTE_POS, &step);
    }
}

/// One step of three parameters, in place: as many as a device is sure to bind with their moments and gradients. Most
/// parameters are so small that a launch of their own takes longer than the step.
#[cube(launch)]
pub fn adam_of_three(
    values_a: &mut [f32],
    firsts_a: &mut [f32],
    seconds_a: &mut [f32],
    gradients_a: &[f32],
    values_b: &mut [f32],
    firsts_b: &mut [f32],
    seconds_b: &mut [f32],
    gradients_b: &[f32],
    values_c: &mut [f32],
    firsts_c: &mut [f32],
    seconds_c: &mut [f32],
    gradients_c: &[f32],
    count_a: u32,
    count_b: u32,
    count_c: u32,
    step_a: AdamStep,
    step_b: AdamStep,
    step_c: AdamStep,
) {
    let (first_b, first_c) = (count_a as usize, (count_a + count_b) as usize);
    if ABSOLUTE_POS < first_b {
        advance(values_a, firsts_a, seconds_a, gradients_a, ABSOLUTE_POS, &step_a);
    } else if ABSOLUTE_POS < first_c {
        advance(values_b, firsts_b, seconds_b, gradients_b, ABSOLUTE_POS - first_b, &step_b);
    } else if ABSOLUTE_POS < first_c + count_c as usize {
        advance(values_c, firsts_c, seconds_c, gradients_c, ABSOLUTE_POS - first_c, &step_c);
    }
}

/// One step of one number.
#[cube]
fn advance(
    values: &mut [f32],
    firsts: &mut [f32],
    seconds: &mut [f32],
    gradients: &[f32],
    index: usize,
    step: &AdamStep,
) {
    let gradient = bounded(gradients[index]);
    let first = step.beta1 * firsts[index] + step.rest1 * gradient;
    let second = step.beta2 * seconds[index] + step.rest2 * (gradient * gradient);
    firsts[index] = first;
    seconds[index] = second;
    values[index] -= step.rate * first / (second.sqrt() * step.root + step.epsilon);
}

/// A finite gradient within the bounds of [`LARGEST_GRADIENT`]. Others stay, so that they show.
#[cube]
fn bounded(gradient: f32) -> f32 {
    let (low, high) = (constant(-LARGEST_GRADIENT), constant(LARGEST_GRADIENT));
    select(is_finite(gradient), clamp(gradient, low, high), gradient)
}
