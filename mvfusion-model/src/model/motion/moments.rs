//! The Gaussians of several moments, which are refined together. Their rows follow each other.

use burn::tensor::Tensor;

use super::{MotionCache, Near};
use crate::tensors;

/// The Gaussians of one moment.
#[derive(Clone, Copy, Debug)]
pub struct MomentRows<'a> {
    /// Their time.
    pub time: f64,
    /// Their descriptors, one row each.
    pub cache: &'a MotionCache,
}

impl<'a> MomentRows<'a> {
    /// Number of Gaussians.
    pub fn count(&self) -> usize {
        self.cache.signatures.dims()[0]
    }

    /// The nearest others of each, for attention in space.
    pub(super) fn near(&self) -> &'a Near {
        // Proof: `MotionCache::new` and checkpoints have neighbours for the configuration of this module.
        self.cache.near.as_ref().expect("attention in space has neighbours")
    }
}

/// Values of all rows, `[M, C]`, from those of each moment.
pub(super) fn joined(moments: &[MomentRows<'_>], values: impl Fn(&MomentRows<'_>) -> Tensor<2>) -> Tensor<2> {
    match moments {
        [one] => values(one),
        _ => Tensor::cat(moments.iter().map(values).collect(), 0),
    }
}

/// Numbers that depend on the time alone: `[M, K]`, or `[1, K]` for the rows of a single moment. Without autodiff.
pub(super) fn of_time(moments: &[MomentRows<'_>], like: &Tensor<2>, numbers: impl Fn(f64) -> Vec<f64>) -> Tensor<2> {
    let parts: Vec<(usize, Vec<f64>)> = moments.iter().map(|rows| (rows.count(), numbers(rows.time))).collect();
    tensors::rows_of_parts(&parts, like)
}
