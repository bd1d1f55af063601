//! The cached motion descriptors of the dynamic Gaussians.

use burn::tensor::{Int, Tensor};

use super::normaliser::MovingNormaliser;
use super::statistics::{SIGNATURE_WIDTH, TrajectoryStatistics};
use crate::config::{Descriptor, MotionConfig};
use crate::tensors;
use crate::timeline::between;

/// Normalised descriptors, one row a Gaussian, without gradient (METHOD A10, A25). Rows follow the Gaussians through
/// cloning, splitting and pruning; children inherit their parent's.
#[derive(Clone, Debug)]
pub struct MotionCache {
    /// Normalised signatures: `[N, 13]`.
    pub signatures: Tensor<2>,
    /// Normalised local variances at the knots: `[N, knots]`.
    pub local: Tensor<2>,
    /// Raw motion intensity, for pictures and pruning: `[N, 1]`.
    pub intensity: Tensor<2>,
    /// Times of the knots.
    pub knot_times: Vec<f64>,
}

/// The normalisers of signatures and local variances.
#[derive(Clone, Debug, Default, PartialEq, serde::Serialize, serde::Deserialize)]
pub struct Normalisers {
    /// Thirteen columns.
    pub signatures: MovingNormaliser,
    /// One column for all knots (A10b).
    pub local: MovingNormaliser,
}

impl MotionCache {
    /// The cache of fresh statistics, or of the part of them that MVG is to be shown; `like` gives device and dtype.
    pub fn new(
        statistics: TrajectoryStatistics,
        normalisers: &mut Normalisers,
        config: &MotionConfig,
        like: &Tensor<2>,
    ) -> Self {
        let statistics = match config.descriptor {
            // Before the normaliser, which makes zeros of columns of zeros.
            Descriptor::PositionVariance => statistics.position_only(),
            // Raw offsets are taken when they are needed. What is measured serves the tokens and the intensity.
            Descriptor::Variances | Descriptor::Offsets => statistics,
        };
        let signatures = normalisers.signatures.update_and_normalise(&statistics.signatures, SIGNATURE_WIDTH, config);
        let local = match config.normalise_local {
            true => normalisers.local.update_and_normalise(&statistics.local, 1, config),
            false => statistics.local.clone(),
        };
        let knots = statistics.knot_times.len();
        let table = |values, columns| tensors::from_data_like(TrajectoryStatistics::table(values, columns), like);
        Self {
            signatures: table(signatures, SIGNATURE_WIDTH),
            local: table(local, knots),
            intensity: table(statistics.intensities(), 1),
            knot_times: statistics.knot_times,
        }
    }

    /// Local motion intensity `e(t)`, `[N, 1]`: linear between knots, held outside.
    pub fn local_at(&self, time: f64) -> Tensor<2> {
        let place = between(&self.knot_times, time);
        let knot = |index| self.local.clone().narrow(1, index, 1);
        if place.lower == place.upper {
            return knot(place.lower);
        }
        knot(place.lower) * (1.0 - place.weight) + knot(place.upper) * place.weight
    }

    /// Without descriptors from row `kept` on.
    pub fn forget_from(self, kept: usize) -> Self {
        let forget = |values: Tensor<2>| {
            let new = values.dims()[0] - kept;
            if new == 0 {
                return values;
            }
            let fresh = values.clone().narrow(0, kept, new).zeros_like();
            Tensor::cat(vec![values.narrow(0, 0, kept), fresh], 0)
        };
        Self {
            signatures: forget(self.signatures),
            local: forget(self.local),
            intensity: forget(self.intensity),
            knot_times: self.knot_times,
        }
    }

    /// The rows of the given Gaussians, in that order.
    pub fn select(self, rows: &Tensor<1, Int>) -> Self {
        Self {
            signatures: self.signatures.select(0, rows.clone()),
            local: self.local.select(0, rows.clone()),
            intensity: self.intensity.select(0, rows.clone()),
            knot_times: self.knot_times,
        }
    }
}
