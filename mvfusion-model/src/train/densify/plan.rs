//! The selection of rows to change, on plain values.

use glam::{DQuat, DVec3};

use crate::config::OpacityReset;
use crate::random::Stream;

/// Divisor of the scales in a split (3DGS: 0.8 times two samples).
const SPLIT_SHRINK: f64 = 1.6;

/// Maximum opacity of a selected Gaussian after a reset (3DGS).
const RESET_OPACITY: f64 = 0.01;

/// The Gaussians to clone and to split (METHOD §4.9).
#[derive(Clone, Debug, PartialEq)]
pub struct DensifyPlan {
    /// Rows that do not change, ascending.
    pub kept: Vec<usize>,
    /// Rows that are copied.
    pub cloned: Vec<usize>,
    /// Rows that are replaced by two smaller ones.
    pub split: Vec<usize>,
}

impl DensifyPlan {
    /// Gaussians whose mean gradient reaches `threshold` are cloned if their longest axis is at most `clone_size`, and
    /// split if it is longer.
    pub fn new(mean_gradients: &[f64], longest_axes: &[f64], threshold: f64, clone_size: f64) -> Self {
        let mut plan = Self { kept: Vec::new(), cloned: Vec::new(), split: Vec::new() };
        for (row, (&gradient, &axis)) in mean_gradients.iter().zip(longest_axes).enumerate() {
            match (gradient >= threshold, axis > clone_size) {
                (true, true) => plan.split.push(row),
                (true, false) => {
                    plan.kept.push(row);
                    plan.cloned.push(row);
                }
                (false, _) => plan.kept.push(row),
            }
        }
        plan
    }

    /// The plan with at most `room` additional rows. Candidates with the largest `mean_gradients` take precedence; on a
    /// tie, the lower row does. A clone and a split each need one row. The others do not change.
    ///
    /// Departure: 3DGS and DeGauss execute the whole plan of a branch that is below its cap, so it may end far above.
    pub fn limited(mut self, mean_gradients: &[f64], room: usize) -> Self {
        let mut candidates: Vec<usize> = self.cloned.iter().chain(&self.split).copied().collect();
        if candidates.len() <= room {
            return self;
        }
        candidates.sort_by(|&a, &b| mean_gradients[b].total_cmp(&mean_gradients[a]).then(a.cmp(&b)));
        let mut chosen = vec![false; mean_gradients.len()];
        candidates.iter().take(room).for_each(|&row| chosen[row] = true);
        self.cloned.retain(|&row| chosen[row]);
        self.kept.extend(self.split.iter().filter(|&&row| !chosen[row]));
        self.kept.sort_unstable();
        self.split.retain(|&row| chosen[row]);
        self
    }

    /// Whether nothing changes.
    pub fn is_empty(&self) -> bool {
        self.cloned.is_empty() && self.split.is_empty()
    }

    /// The parent of every new row: rows that stay, clones, first halves of the split rows, second halves.
    pub fn sources(&self) -> Vec<usize> {
        [&self.kept, &self.cloned, &self.split, &self.split].into_iter().flatten().copied().collect()
    }

    /// Number of new rows without moments to inherit.
    pub fn added(&self) -> usize {
        self.cloned.len() + 2 * self.split.len()
    }
}

/// A Gaussian to split, which determines the distribution of its halves.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SplitParent {
    /// Centre.
    pub mean: DVec3,
    /// Log-scales.
    pub log_scale: DVec3,
    /// Quaternion, not normalised.
    pub rotation: DQuat,
}

impl SplitParent {
    /// Centre of a half: a draw from the parent's distribution, `mean + R (s * normal)`.
    pub fn child(&self, normal: DVec3) -> DVec3 {
        let rotation = if self.rotation.length_squared() > 0.0 { self.rotation.normalize() } else { DQuat::IDENTITY };
        self.mean + rotation * (self.log_scale.exp() * normal)
    }
}

/// The change of the log-scales in a split.
pub fn split_log_scale() -> f64 {
    -SPLIT_SHRINK.ln()
}

/// The Gaussians that an opacity reset selects (METHOD §4.11).
#[derive(Clone, Debug, PartialEq)]
pub struct ResetPlan {
    /// One flag per row.
    pub selected: Vec<bool>,
}

impl ResetPlan {
    /// The first `floor(share * N)` rows of a random order.
    pub fn draw(count: usize, share: f64, stream: &mut Stream) -> Self {
        Self::from_order(&stream.permutation(count), share)
    }

    /// The first `floor(share * N)` rows of `order`.
    pub fn from_order(order: &[usize], share: f64) -> Self {
        let mut selected = vec![false; order.len()];
        let chosen = (share * order.len() as f64).floor() as usize;
        order.iter().take(chosen).for_each(|&row| selected[row] = true);
        Self { selected }
    }

    /// Opacity logits after the reset.
    pub fn apply(&self, logits: &[f64], others: OpacityReset) -> Vec<f64> {
        let reset = |(&logit, &selected): (&f64, &bool)| {
            match (selected, others) {
                // In logits, because an opacity may round to 0.
                (true, _) => logit.min(logit_of(RESET_OPACITY)),
                (false, OpacityReset::Quirk) => 1.0 / (1.0 + (-logit).exp()),
                (false, OpacityReset::Clean) => logit,
            }
        };
        logits.iter().zip(&self.selected).map(reset).collect()
    }
}

pub(super) fn logit_of(probability: f64) -> f64 {
    (probability / (1.0 - probability)).ln()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn small_gaussians_are_cloned_and_large_ones_split() {
        let plan = DensifyPlan::new(&[1.0, 1.0, 0.1, 1.0], &[0.1, 0.9, 0.9, 0.2], 0.5, 0.5);
        assert_eq!(
            (plan.kept.as_slice(), plan.cloned.as_slice(), plan.split.as_slice()),
            ([0, 2, 3].as_slice(), [0, 3].as_slice(), [1].as_slice())
        );
        assert_eq!(plan.sources(), [0, 2, 3, 0, 3, 1, 1]);
        assert_eq!(plan.added(), 4);
    }

    #[test]
    fn where_there_is_little_room_the_largest_gradients_have_it() {
        let (gradients, axes) = ([3.0, 5.0, 0.1, 5.0, 4.0, 5.0], [0.1, 0.9, 0.9, 0.2, 0.8, 0.9]);
        let whole = DensifyPlan::new(&gradients, &axes, 0.5, 0.5);
        assert_eq!(whole.clone().limited(&gradients, 5), whole, "there is room for all");
        let rows = |room| {
            let plan = whole.clone().limited(&gradients, room);
            assert_eq!(plan.sources().len(), gradients.len() + room, "each needs one row");
            (plan.kept, plan.cloned, plan.split)
        };
        // Row 0 is dropped first, then row 4, which is kept instead of split; on ties, the higher rows.
        assert_eq!(rows(4), (vec![0, 2, 3], vec![3], vec![1, 4, 5]));
        assert_eq!(rows(3), (vec![0, 2, 3, 4], vec![3], vec![1, 5]));
        assert_eq!(rows(2), (vec![0, 2, 3, 4, 5], vec![3], vec![1]));
        assert_eq!(rows(1), (vec![0, 2, 3, 4, 5], vec![], vec![1]));
        assert_eq!(rows(0), ((0..6).collect(), vec![], vec![]));
    }

    #[test]
    fn a_reset_makes_the_selected_transparent() {
        let plan = ResetPlan::from_order(&[2, 0, 1], 0.7);
        assert_eq!(plan.selected, [true, false, true]);
        let quirk = plan.apply(&[2.0, 2.0, -9.0], OpacityReset::Quirk);
        assert!((quirk[0] - logit_of(0.01)).abs() < 1e-12);
        assert!((quirk[1] - 1.0 / (1.0 + (-2.0f64).exp())).abs() < 1e-12);
        assert!((quirk[2] + 9.0).abs() < 1e-9, "a fainter one stays as faint");
        assert_eq!(plan.apply(&[2.0, 2.0, -9.0], OpacityReset::Clean)[1], 2.0);
        assert_eq!(plan.apply(&[2.0, 2.0, -7e4], OpacityReset::Quirk)[2], -7e4, "and finite");
    }

    #[test]
    fn a_child_lies_along_the_parents_axes() {
        let turn = DQuat::from_rotation_z(std::f64::consts::FRAC_PI_2);
        let parent = SplitParent { mean: DVec3::ONE, log_scale: DVec3::new(2f64.ln(), 0.0, 0.0), rotation: turn * 3.0 };
        assert!((parent.child(DVec3::X) - DVec3::new(1.0, 3.0, 1.0)).length() < 1e-12);
    }
}
