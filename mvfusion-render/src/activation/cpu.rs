//! CPU twins of the activations.

use rayon::prelude::*;

use super::{SHARE_EPSILON, SHARE_MARGIN};
use crate::Real;

/// Fewest numbers, or Gaussians, per task.
const BLOCK: usize = 4096;

/// The logistic function of each number.
pub(super) fn logistic<T: Real>(logits: &[T]) -> Vec<T> {
    logits.par_iter().with_min_len(BLOCK).map(|&logit| logistic_of(logit)).collect()
}

/// The adjoint of the logits for the cotangents of their `probabilities`.
pub(super) fn logistic_backward<T: Real>(probabilities: &[T], v_probabilities: &[T]) -> Vec<T> {
    let pairs = probabilities.par_iter().zip(v_probabilities).with_min_len(BLOCK);
    pairs.map(|(&probability, &v)| v * probability * (T::one() - probability)).collect()
}

/// The share of the second of two `channels` in both, from logits `[N, columns]`.
pub(super) fn foreground_share<T: Real>(logits: &[T], columns: usize, channels: [usize; 2]) -> Vec<T> {
    let of_one = |row: &[T]| {
        let [static_, dynamic] = channels.map(|channel| logistic_of(row[channel]));
        let share = dynamic / (dynamic + static_ + T::of(SHARE_EPSILON));
        share.max(T::of(SHARE_MARGIN)).min(T::of(1.0 - SHARE_MARGIN))
    };
    logits.par_chunks_exact(columns).with_min_len(BLOCK).map(of_one).collect()
}

/// `1 / (1 + exp(-x))`, by the exponential that does not overflow.
#[inline(always)]
fn logistic_of<T: Real>(logit: T) -> T {
    if logit >= T::zero() {
        return T::one() / (T::one() + (-logit).exp());
    }
    let odds = logit.exp();
    odds / (T::one() + odds)
}
