//! A branch in training: its Gaussians, and everything with one row per Gaussian.

use burn::tensor::{Int, Tensor, TensorData};
use glam::{DQuat, DVec3};
use mvfusion_render::activation::sigmoid;
use serde::{Deserialize, Serialize};

use super::plan::{SplitParent, logit_of, split_log_scale};
use super::{DensifyPlan, DensifyStatistics, RelocationPlan, ResetPlan, Share};
use crate::config::OpacityReset;
use crate::model::gaussians::{Attribute, Gaussians};
use crate::model::motion::MotionCache;
use crate::model::rows::{PerGaussian, RowMap};
use crate::random::Stream;
use crate::train::BranchGradients;
use crate::train::optim::{GaussianGradients, GaussianOptimiser};
use crate::{ModelError, tensors};

/// The training state of a branch.
///
/// Everything with one row per Gaussian follows row changes in [`PerGaussian::follow`]. That function destructures this
/// struct, so a new field is a compile error until it is handled there.
///
/// ```compile_fail,E0027
/// # use mvfusion_model::train::densify::BranchState;
/// fn follow(state: &mut BranchState) {
///     // The statistics are forgotten.
///     let BranchState { optimiser, pending, counts } = state;
/// }
/// ```
#[derive(Clone, Debug)]
pub struct BranchState {
    /// Adam's moments.
    pub optimiser: GaussianOptimiser,
    /// Statistics of the Gaussians since rows were last added.
    pub statistics: DensifyStatistics,
    /// Accumulated gradients for the branch's next step.
    pub pending: Option<BranchGradients>,
    /// Counts of row changes.
    pub counts: DensifyCounts,
}

/// A branch whose rows may change: its Gaussians and everything that follows their rows.
#[derive(Debug)]
pub struct Branch<'a> {
    /// The Gaussians.
    pub gaussians: &'a mut Gaussians,
    /// Their training state.
    pub state: &'a mut BranchState,
    /// Motion descriptors; only for the dynamic branch, once they were measured.
    pub motion: Option<&'a mut MotionCache>,
    /// Gradients of the current step, if there is one.
    pub gradients: Option<&'a mut GaussianGradients>,
}

/// Counts of a branch's row changes.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct DensifyCounts {
    /// Gaussians that were cloned, split or born.
    pub added: usize,
    /// Gaussians removed by pruning.
    pub pruned: usize,
    /// Gaussians relocated instead of removed.
    #[serde(default)]
    pub relocated: usize,
    /// Opacity resets.
    pub resets: usize,
}

/// The rule that selects Gaussians to remove.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct PruneRule {
    /// Gaussians with a lower opacity.
    pub min_opacity: f64,
    /// Dynamic Gaussians whose foreground probability never reached this value (METHOD §4.10).
    pub min_foreground: Option<f64>,
    /// Gaussians whose screen radius exceeded this value, in pixels (4DGS, METHOD §9).
    pub max_radius: Option<f64>,
    /// Gaussians longer than this, in world units (4DGS).
    pub max_scale: Option<f64>,
}

/// For every row of `[N, 1]`, whether it is at least `least`.
fn at_least(least: f64, values: Tensor<2>) -> Result<Vec<bool>, ModelError> {
    Ok(tensors::read::<2, f64>(values)?.into_iter().map(|value| value >= least).collect())
}

impl BranchState {
    /// The state before the first step of these Gaussians.
    pub fn new(gaussians: &Gaussians) -> Self {
        Self {
            optimiser: GaussianOptimiser::default(),
            statistics: DensifyStatistics::new(&gaussians.means.val()),
            pending: None,
            counts: DensifyCounts::default(),
        }
    }

    /// Resets moments, statistics and pending gradients, as at the start of a stage.
    pub fn restart(&mut self, gaussians: &Gaussians) {
        *self = Self { counts: self.counts, ..Self::new(gaussians) };
    }
}

impl PerGaussian for BranchState {
    fn follow(&mut self, map: &RowMap) {
        let Self { optimiser, statistics, pending, counts: _ } = self;
        optimiser.follow(map);
        statistics.follow(map);
        pending.follow(map);
    }
}

impl PerGaussian for Branch<'_> {
    fn follow(&mut self, map: &RowMap) {
        let Self { gaussians, state, motion, gradients } = self;
        gaussians.follow(map);
        state.follow(map);
        motion.follow(map);
        gradients.follow(map);
    }
}

impl Branch<'_> {
    /// Clones and splits Gaussians whose priority reaches a threshold, up to `most` Gaussians in total. Returns the row
    /// map, or `None` if nothing changed. `priorities` are those of [`Branch::priorities`].
    ///
    /// # Errors
    /// If the device fails to return values.
    pub fn densify(
        &mut self,
        priorities: &[f64],
        threshold: f64,
        clone_size: f64,
        most: usize,
        stream: &mut Stream,
    ) -> Result<Option<RowMap>, ModelError> {
        let axes: Vec<f64> = tensors::read(self.plain(Attribute::LogScales).max_dim(1).exp())?;
        let room = most.saturating_sub(priorities.len());
        let plan = DensifyPlan::new(priorities, &axes, threshold, clone_size).limited(priorities, room);
        let normals = (0..2 * plan.split.len())
            .map(|_| DVec3::from_array(std::array::from_fn(|_| stream.normal())))
            .collect::<Vec<_>>();
        self.grow(&plan, &normals)
    }

    /// Mean screen gradient of every Gaussian, times `motion_power` of its relative motion intensity once motion was
    /// measured (`densify.motion_power`).
    ///
    /// # Errors
    /// If the device fails to return values.
    pub fn priorities(&self, motion_power: f64) -> Result<Vec<f64>, ModelError> {
        let gradients: Vec<f64> = tensors::read(self.state.statistics.mean_gradients())?;
        let Some(cache) = self.motion.as_ref().filter(|_| motion_power > 0.0) else { return Ok(gradients) };
        let intensities: Vec<f64> = tensors::read(cache.intensity.clone())?;
        // A Gaussian that came since the last measurement may have none.
        let measured = || intensities.iter().filter(|&&intensity| intensity > 0.0);
        let mean = measured().sum::<f64>() / measured().count().max(1) as f64;
        let relative = |intensity: f64| if intensity > 0.0 { 2.0 * intensity / (intensity + mean) } else { 1.0 };
        let weighted = gradients.iter().zip(&intensities);
        Ok(weighted.map(|(gradient, &intensity)| gradient * relative(intensity).powf(motion_power)).collect())
    }

    /// Executes a plan. `normals` has one draw per half of a split Gaussian, first halves first.
    ///
    /// # Errors
    /// If the device fails to return values.
    pub fn grow(&mut self, plan: &DensifyPlan, normals: &[DVec3]) -> Result<Option<RowMap>, ModelError> {
        self.state.statistics.restart_gradients();
        if plan.is_empty() {
            return Ok(None);
        }
        let children = self.children(plan, normals)?;
        let map = RowMap::of_parents(plan.sources(), plan.kept.len());
        let before = self.gaussians.count();
        self.follow(&map);
        self.state.counts.added += self.gaussians.count() - before;
        if let Some(children) = children {
            let halves = 2 * plan.split.len();
            self.change_last(halves, Attribute::Means, |_| children);
            self.change_last(halves, Attribute::LogScales, |log_scales| log_scales + split_log_scale());
        }
        Ok(Some(map))
    }

    /// Appends Gaussians. They must have the same attributes as the branch, and start without moments and statistics.
    pub fn append(&mut self, further: &Gaussians) {
        let added = further.count();
        self.follow(&RowMap::appending(self.gaussians.count(), added));
        self.state.counts.added += added;
        for attribute in Attribute::ALL {
            if let Some(values) = further.plain(attribute) {
                self.change_last(added, attribute, |_| values);
            }
        }
    }

    /// Centres of both halves of every split Gaussian: `[2 S, 3]`; `None` if none are split.
    fn children(&self, plan: &DensifyPlan, normals: &[DVec3]) -> Result<Option<Tensor<2>>, ModelError> {
        if plan.split.is_empty() {
            return Ok(None);
        }
        let rows = self.rows(&plan.split);
        let read = |attribute| tensors::read::<2, f64>(self.plain(attribute).select(0, rows.clone()));
        let (centres, scales) = (read(Attribute::Means)?, read(Attribute::LogScales)?);
        let rotations = read(Attribute::Quaternions)?;
        let parent = |i: usize| SplitParent {
            mean: DVec3::from_slice(&centres[3 * i..]),
            log_scale: DVec3::from_slice(&scales[3 * i..]),
            rotation: DQuat::from_xyzw(
                rotations[4 * i + 1],
                rotations[4 * i + 2],
                rotations[4 * i + 3],
                rotations[4 * i],
            ),
        };
        let count = plan.split.len();
        let positions: Vec<f64> = normals
            .iter()
            .enumerate()
            .flat_map(|(half, &normal)| parent(half % count).child(normal).to_array())
            .collect();
        let positions = TensorData::new(positions, [2 * count, 3]);
        Ok(Some(tensors::from_data_like(positions, &self.plain(Attribute::Means))))
    }

    /// Removes the Gaussians that a rule selects. Returns the row map, or `None` if all stay.
    ///
    /// # Errors
    /// If the device fails to return values.
    pub fn prune(&mut self, rule: &PruneRule) -> Result<Option<RowMap>, ModelError> {
        let fits = self.fitting(rule)?;
        let kept: Vec<usize> = (0..fits.len()).filter(|&row| fits[row]).collect();
        // A branch never loses its last Gaussian, because ops do not accept empty tensors.
        if kept.len() == fits.len() || kept.is_empty() {
            return Ok(None);
        }
        Ok(Some(self.keep(kept)))
    }

    /// Keeps only the given rows, and counts the others as pruned.
    pub fn keep(&mut self, rows: Vec<usize>) -> RowMap {
        self.state.counts.pruned += self.gaussians.count() - rows.len();
        let map = RowMap::keeping(rows);
        self.follow(&map);
        map
    }

    /// Relocates at most `most` of the Gaussians that a rule selects to Gaussians with high opacity and priority, instead
    /// of removing them. Returns the row map, or `None` if nothing changed.
    ///
    /// # Errors
    /// If the device fails to return values.
    pub fn relocate(
        &mut self,
        priorities: &[f64],
        rule: &PruneRule,
        most: usize,
        stream: &mut Stream,
    ) -> Result<Option<RowMap>, ModelError> {
        let dead: Vec<bool> = self.fitting(rule)?.into_iter().map(|fits| !fits).collect();
        let opacities: Vec<f64> = tensors::read(sigmoid(self.plain(Attribute::OpacityLogits)))?;
        let plan = RelocationPlan::draw(&dead, &opacities, priorities, most, stream);
        if plan.is_empty() {
            return Ok(None);
        }
        let map = RowMap::of_parents(plan.sources(), plan.kept.len());
        self.follow(&map);
        self.state.counts.relocated += plan.shared.len();
        let shares: Vec<Share> = plan.shared.iter().map(|&row| Share::of(opacities[row])).collect();
        let both = 2 * shares.len();
        let like = self.plain(Attribute::OpacityLogits);
        let column = |of: fn(&Share) -> f64| {
            let twice = shares.iter().chain(&shares).map(of).collect::<Vec<f64>>();
            tensors::from_data_like::<2, 2>(TensorData::new(twice, [both, 1]), &like)
        };
        self.change_last(both, Attribute::OpacityLogits, |_| column(|share| logit_of(share.opacity)));
        self.change_last(both, Attribute::LogScales, |log_scales| log_scales + column(|share| share.scale.ln()));
        Ok(Some(map))
    }

    /// For every row, whether a rule keeps it.
    fn fitting(&self, rule: &PruneRule) -> Result<Vec<bool>, ModelError> {
        let statistics = &self.state.statistics;
        let mut fits = at_least(rule.min_opacity, sigmoid(self.plain(Attribute::OpacityLogits)))?;
        let mut narrow = |others: Vec<bool>| fits.iter_mut().zip(others).for_each(|(fits, other)| *fits &= other);
        if let Some(least) = rule.min_foreground {
            narrow(at_least(least, statistics.foreground.clone())?);
        }
        if let Some(most) = rule.max_radius {
            narrow(at_least(-most, -statistics.radii.clone())?);
        }
        if let Some(most) = rule.max_scale {
            narrow(at_least(-most.ln(), -self.plain(Attribute::LogScales).max_dim(1))?);
        }
        Ok(fits)
    }

    /// Makes a random fraction of the Gaussians nearly transparent. The current step does not update opacities.
    ///
    /// # Errors
    /// If the device fails to return values.
    pub fn reset_opacity(&mut self, plan: &ResetPlan, others: OpacityReset) -> Result<(), ModelError> {
        let logits = self.plain(Attribute::OpacityLogits);
        let reset = plan.apply(&tensors::read::<2, f64>(logits.clone())?, others);
        let count = reset.len();
        let reset = tensors::from_data_like(TensorData::new(reset, [count, 1]), &logits);
        self.gaussians.replace(Attribute::OpacityLogits, reset);
        self.state.optimiser.reset(Attribute::OpacityLogits);
        self.state.counts.resets += 1;
        if let Some(gradients) = &mut self.gradients {
            gradients.forget(Attribute::OpacityLogits);
        }
        Ok(())
    }

    /// Changes the last `rows` of an attribute, if the branch has it.
    fn change_last(&mut self, rows: usize, attribute: Attribute, change: impl FnOnce(Tensor<2>) -> Tensor<2>) {
        if let Some(values) = self.gaussians.plain(attribute) {
            let before = values.dims()[0] - rows;
            // Ops do not accept empty tensors, and every Gaussian may have been split.
            let changed = match before {
                0 => change(values),
                _ => {
                    let last = change(values.clone().narrow(0, before, rows));
                    Tensor::cat(vec![values.narrow(0, 0, before), last], 0)
                }
            };
            self.gaussians.replace(attribute, changed);
        }
    }

    /// The values of an attribute that every branch has.
    fn plain(&self, attribute: Attribute) -> Tensor<2> {
        // Proof: the requested attributes are not optional in `Gaussians`.
        self.gaussians.plain(attribute).expect("only mask logits and lifetimes may be absent")
    }

    fn rows(&self, rows: &[usize]) -> Tensor<1, Int> {
        tensors::rows_like(rows, &self.gaussians.means.val())
    }
}

#[cfg(test)]
mod tests {
    use burn::tensor::DType;
    use glam::Vec3;
    use mvfusion_data::PointCloud;

    use super::*;
    use crate::initial::{Masking, cloud_on, gaussians_of};
    use crate::model::motion::Encoding;
    use crate::test_support::{for_each_device, values};

    #[test]
    fn every_gaussian_may_be_split_at_once() {
        for_each_device(|device| {
            let positions = vec![Vec3::ZERO, Vec3::X];
            let points = PointCloud { colours: vec![Vec3::ONE; positions.len()], positions };
            let cloud = cloud_on(&points, &[1.0; 2], 0.1);
            let mut gaussians = gaussians_of(&cloud, Masking::Absent, 0, &device.clone().autodiff(), DType::F32);
            let mut state = BranchState::new(&gaussians);
            let mut branch = Branch { gaussians: &mut gaussians, state: &mut state, motion: None, gradients: None };
            let plan = DensifyPlan { kept: vec![], cloned: vec![], split: vec![0, 1] };
            branch.grow(&plan, &[DVec3::X, DVec3::ZERO, -DVec3::X, DVec3::ZERO]).expect("grown").expect("changed");
            let (log_scales, means) = (gaussians.log_scales.val(), values(gaussians.means.val().inner()));
            assert_eq!(log_scales.dims(), [4, 3]);
            assert!(
                means.iter().zip([1.0, 0.0, 0.0, 1.0, 0.0, 0.0, -1.0]).all(|(own, other)| (own - other).abs() < 1e-6)
            );
            assert!(values(log_scales.inner()).iter().all(|value| (value - split_log_scale()).abs() < 1e-6));
        });
    }

    #[test]
    fn motion_raises_the_priority_of_what_moves_and_leaves_that_of_what_was_not_measured() {
        for_each_device(|device| {
            let points = PointCloud { positions: vec![Vec3::ZERO; 3], colours: vec![Vec3::ONE; 3] };
            let cloud = cloud_on(&points, &[1.0; 3], 0.1);
            let mut gaussians = gaussians_of(&cloud, Masking::Absent, 0, &device.clone().autodiff(), DType::F32);
            let mut state = BranchState::new(&gaussians);
            let column = |values: [f32; 3]| Tensor::<2>::from_data(values.map(|value| [value]), &device);
            state.statistics.gradients = column([2.0, 2.0, 2.0]);
            state.statistics.seen = column([1.0; 3]);
            let mut cache = MotionCache {
                signatures: column([0.0; 3]),
                local: column([0.0; 3]),
                velocities: None,
                near: None,
                intensity: column([1.0, 3.0, 0.0]),
                knot_times: vec![0.5],
                inherits: true,
                includes_travel: false,
                encoding: Encoding::default(),
            };
            let motion = Some(&mut cache);
            let branch = Branch { gaussians: &mut gaussians, state: &mut state, motion, gradients: None };
            let priorities = |power| branch.priorities(power).expect("the device answers");
            assert_eq!(priorities(0.0), [2.0; 3]);
            // The mean of those that were measured is 2: factors 2 / 3 and 6 / 5.
            let found = priorities(2.0);
            let expected = [2.0 * 4.0 / 9.0, 2.0 * 36.0 / 25.0, 2.0];
            assert!(found.iter().zip(expected).all(|(a, b)| (a - b).abs() < 1e-6), "{found:?}");
        });
    }
}
