//! The logistic function with its adjoint, and the foreground's share of a mask. CPU twin: `activation/cpu.rs`.

use cubecl::prelude::*;

use super::maths::sigmoid;

/// Where the logits of a share are, and its constants (METHOD §1.4).
#[derive(CubeType, CubeLaunch, Clone, Copy)]
pub struct ShareKind {
    /// Logits of a row.
    pub columns: u32,
    /// Column of the static branch.
    pub static_: u32,
    /// Column of the dynamic branch.
    pub dynamic: u32,
    /// Added to the sum of both probabilities.
    pub epsilon: f32,
    /// Distance of a share from 0 and 1.
    pub margin: f32,
}

/// The logistic function of `count` numbers. A unit is one number.
#[cube(launch_unchecked)]
pub fn logistic(logits: &[f32], probabilities: &mut [f32], count: u32) {
    let at = ABSOLUTE_POS;
    if at < count as usize {
        probabilities[at] = sigmoid(logits[at]);
    }
}

/// The adjoint of `count` logits for the cotangents of their probabilities. A unit is one number.
#[cube(launch_unchecked)]
pub fn logistic_backward(probabilities: &[f32], v_probabilities: &[f32], v_logits: &mut [f32], count: u32) {
    let at = ABSOLUTE_POS;
    if at < count as usize {
        let probability = probabilities[at];
        v_logits[at] = v_probabilities[at] * probability * (1.0f32 - probability);
    }
}

/// The share of the dynamic branch in the mask probabilities of each Gaussian, `[count, 1]`. A unit is one Gaussian.
#[cube(launch_unchecked)]
pub fn foreground_share(logits: &[f32], shares: &mut [f32], kind: ShareKind, count: u32) {
    let at = ABSOLUTE_POS;
    if at < count as usize {
        let row = at * kind.columns as usize;
        let static_ = sigmoid(logits[row + kind.static_ as usize]);
        let dynamic = sigmoid(logits[row + kind.dynamic as usize]);
        let share = dynamic / (dynamic + static_ + kind.epsilon);
        shares[at] = min(max(share, kind.margin), 1.0f32 - kind.margin);
    }
}
