//! Adam, element by element. CPU twin: `optim/cpu.rs`.

use cubecl::prelude::*;

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

/// One step, in place.
#[cube(launch)]
pub fn adam(
    values: &mut [f32],
    firsts: &mut [f32],
    seconds: &mut [f32],
    gradients: &[f32],
    count: u32,
    step: AdamStep,
) {
    let unit = ABSOLUTE_POS;
    if unit < count as usize {
        let gradient = gradients[unit];
        let first = step.beta1 * firsts[unit] + step.rest1 * gradient;
        let second = step.beta2 * seconds[unit] + step.rest2 * (gradient * gradient);
        firsts[unit] = first;
        seconds[unit] = second;
        values[unit] -= step.rate * first / (second.sqrt() * step.root + step.epsilon);
    }
}
