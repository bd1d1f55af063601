//! CPU twin of the cost of scales.

use rayon::prelude::*;

use super::ScaleRule;
use crate::Real;

/// Gaussians per task. Tasks are added in order.
const BLOCK: usize = 4096;

/// The largest and the smallest of three log-scales, the first of equal ones, as scale and ratio.
struct Extremes<T> {
    largest: usize,
    smallest: usize,
    scale: T,
    ratio: T,
}

impl<T: Real> Extremes<T> {
    #[inline(always)]
    fn of(log_scales: &[T]) -> Self {
        let (mut largest, mut smallest) = (0, 0);
        for axis in 1..3 {
            if log_scales[axis] > log_scales[largest] {
                largest = axis;
            }
            if log_scales[axis] < log_scales[smallest] {
                smallest = axis;
            }
        }
        let [most, least] = [log_scales[largest], log_scales[smallest]];
        Self { largest, smallest, scale: most.exp(), ratio: (most - least).exp() }
    }
}

/// The cost of log-scales `[N, 3]`.
pub(super) fn cost<T: Real>(log_scales: &[T], rule: &ScaleRule) -> f64 {
    let of_one = |log_scales: &[T]| {
        let found = Extremes::of(log_scales);
        // A term without weight adds nothing, also where it is infinite.
        let term = |weight: f64, excess: f64| if weight > 0.0 { weight * excess.max(0.0) } else { 0.0 };
        term(rule.large, found.scale.wide() - rule.large_above)
            + term(rule.spiky, found.ratio.wide() - rule.spiky_above)
    };
    let blocks = log_scales.par_chunks(3 * BLOCK).map(|block| block.chunks_exact(3).map(of_one).sum::<f64>());
    blocks.collect::<Vec<_>>().into_iter().sum()
}

/// The adjoint of the log-scales for the cotangent of the cost.
pub(super) fn cost_backward<T: Real>(log_scales: &[T], v_cost: T, rule: &ScaleRule) -> Vec<T> {
    let mut v_log_scales = vec![T::zero(); log_scales.len()];
    let blocks = v_log_scales.par_chunks_mut(3 * BLOCK).zip(log_scales.par_chunks(3 * BLOCK));
    blocks.for_each(|(v_block, block)| {
        for (v, log_scales) in v_block.chunks_exact_mut(3).zip(block.chunks_exact(3)) {
            let found = Extremes::of(log_scales);
            if rule.large > 0.0 && found.scale.wide() > rule.large_above {
                v[found.largest] += v_cost * T::of(rule.large) * found.scale;
            }
            if rule.spiky > 0.0 && found.ratio.wide() > rule.spiky_above {
                let v_ratio = v_cost * T::of(rule.spiky) * found.ratio;
                v[found.largest] += v_ratio;
                v[found.smallest] -= v_ratio;
            }
        }
    });
    v_log_scales
}
