//! CPU twin of Adam: one pass over value, gradient and moments.

use rayon::prelude::*;

use super::AdamRule;
use crate::Real;
use crate::simd::vectorised;

/// Values per task.
const NUMBERS_PER_TASK: usize = 1 << 14;

/// The values that a step changes.
pub(super) struct State<'a, T> {
    pub(super) value: &'a mut [T],
    pub(super) first: &'a mut [T],
    pub(super) second: &'a mut [T],
}

/// The constants of one step, in the precision of the values.
#[derive(Clone, Copy)]
struct Step<T> {
    beta1: T,
    rest1: T,
    beta2: T,
    rest2: T,
    /// Learning rate divided by the first moment's bias correction.
    rate: T,
    /// Inverse square root of the second moment's bias correction.
    root: T,
    epsilon: T,
}

impl<T: Real> Step<T> {
    fn new(rule: &AdamRule, step: usize) -> Self {
        let correction = |beta: f64| 1.0 - beta.powf(step as f64);
        Self {
            beta1: T::of(rule.beta1),
            rest1: T::of(1.0 - rule.beta1),
            beta2: T::of(rule.beta2),
            rest2: T::of(1.0 - rule.beta2),
            rate: T::of(rule.learning_rate / correction(rule.beta1)),
            root: T::of(1.0 / correction(rule.beta2).sqrt()),
            epsilon: T::of(rule.epsilon),
        }
    }
}

/// Performs step number `step`, counted from 1.
pub(super) fn step<T: Real>(state: State<T>, gradient: &[T], rule: &AdamRule, step: usize) {
    let step = Step::<T>::new(rule, step);
    let values = state.value.par_chunks_mut(NUMBERS_PER_TASK);
    let firsts = state.first.par_chunks_mut(NUMBERS_PER_TASK);
    let seconds = state.second.par_chunks_mut(NUMBERS_PER_TASK);
    let gradients = gradient.par_chunks(NUMBERS_PER_TASK);
    values.zip(firsts).zip(seconds.zip(gradients)).for_each(|((value, first), (second, gradient))| {
        vectorised(
            #[inline(always)]
            || {
                let moments = first.iter_mut().zip(second.iter_mut());
                for ((value, &gradient), (first, second)) in value.iter_mut().zip(gradient).zip(moments) {
                    *first = step.beta1 * *first + step.rest1 * gradient;
                    *second = step.beta2 * *second + step.rest2 * (gradient * gradient);
                    *value -= step.rate * *first / (second.sqrt() * step.root + step.epsilon);
                }
            },
        );
    });
}
