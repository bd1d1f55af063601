//! CPU twin of Adam: one pass over value, gradient and moments of all parameters.

use mvfusion_kernels::adam::LARGEST_GRADIENT;
use rayon::prelude::*;

use super::AdamRule;
use crate::Real;
use crate::simd::vectorised;

/// Values per task.
const NUMBERS_PER_TASK: usize = 1 << 14;

/// A parameter, or a piece of one, in a step.
pub(super) struct Piece<'a, T> {
    pub(super) value: &'a mut [T],
    pub(super) first: &'a mut [T],
    pub(super) second: &'a mut [T],
    pub(super) gradient: &'a [T],
    pub(super) step: Step<T>,
}

/// The constants of one step, in the precision of the values.
#[derive(Clone, Copy)]
pub(super) struct Step<T> {
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
    /// The constants of step number `step`, counted from 1.
    pub(super) fn new(rule: &AdamRule, step: usize) -> Self {
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

/// Steps all parameters in one parallel loop, because most of them are too small for a loop of their own.
pub(super) fn step<T: Real>(parameters: Vec<Piece<'_, T>>) {
    let tasks: Vec<Piece<'_, T>> = parameters.into_iter().flat_map(Piece::tasks).collect();
    tasks.into_par_iter().for_each(Piece::learn);
}

impl<'a, T: Real> Piece<'a, T> {
    /// Divides a parameter into tasks.
    fn tasks(self) -> impl Iterator<Item = Self> {
        let Self { value, first, second, gradient, step } = self;
        let moments = first.chunks_mut(NUMBERS_PER_TASK).zip(second.chunks_mut(NUMBERS_PER_TASK));
        let values = value.chunks_mut(NUMBERS_PER_TASK).zip(gradient.chunks(NUMBERS_PER_TASK));
        values.zip(moments).map(move |((value, gradient), (first, second))| Self {
            value,
            first,
            second,
            gradient,
            step,
        })
    }

    fn learn(self) {
        let Self { value, first, second, gradient, step } = self;
        vectorised(
            #[inline(always)]
            || {
                let moments = first.iter_mut().zip(second.iter_mut());
                for ((value, &gradient), (first, second)) in value.iter_mut().zip(gradient).zip(moments) {
                    let gradient = bounded(gradient);
                    *first = step.beta1 * *first + step.rest1 * gradient;
                    *second = step.beta2 * *second + step.rest2 * (gradient * gradient);
                    *value -= step.rate * *first / (second.sqrt() * step.root + step.epsilon);
                }
            },
        );
    }
}

/// A finite gradient within the bounds of [`LARGEST_GRADIENT`]. Others stay, so that they show.
#[inline(always)]
fn bounded<T: Real>(gradient: T) -> T {
    let (largest, size) = (T::of(LARGEST_GRADIENT), gradient.abs());
    if size > largest && size <= T::max_value() { largest.copysign(gradient) } else { gradient }
}
