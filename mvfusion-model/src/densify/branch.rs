//! A branch in training: its Gaussians, their moments and what was seen of them.

use burn::tensor::{Int, Tensor, TensorData};
use glam::{DQuat, DVec3};
use serde::{Deserialize, Serialize};

use super::plan::{SplitParent, logit_of, split_log_scale};
use super::{DensifyPlan, DensifyStatistics, RelocationPlan, ResetPlan, Share};
use crate::config::OpacityReset;
use crate::gaussians::{Attribute, Gaussians};
use crate::optim::GaussianOptimiser;
use crate::random::Stream;
use crate::{ModelError, tensors};

/// The Gaussians of a branch with all that training keeps about them.
#[derive(Clone, Debug)]
pub struct Branch {
    /// The Gaussians.
    pub gaussians: Gaussians,
    /// Their moments.
    pub optimiser: GaussianOptimiser,
    /// What was seen of them.
    pub statistics: DensifyStatistics,
    /// Degree of the spherical harmonics in use.
    pub sh_degree: usize,
}

/// How often the rows of a branch changed.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct Census {
    /// Gaussians cloned or made by splitting.
    pub added: usize,
    /// Gaussians removed by pruning.
    pub pruned: usize,
    /// Gaussians moved instead of removed.
    #[serde(default)]
    pub relocated: usize,
    /// Opacity resets.
    pub resets: usize,
}

/// Where the rows of a branch come from after Gaussians were added.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Growth {
    /// The parent of every row.
    pub sources: Vec<usize>,
    /// So many rows at the beginning are their own parents; the others are new.
    pub kept: usize,
}

/// Which Gaussians a branch has no place for.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct PruneRule {
    /// Fainter ones.
    pub min_opacity: f64,
    /// Dynamic ones that were never part of the foreground to this probability (METHOD §4.10).
    pub min_foreground: Option<f64>,
    /// Those that covered more pixels than this around their centre (4DGS, METHOD §9).
    pub max_radius: Option<f64>,
    /// Those longer than this, world units (4DGS).
    pub max_scale: Option<f64>,
}

/// For every row of `[N, 1]` whether it is at least `least`.
fn at_least(least: f64, values: Tensor<2>) -> Result<Vec<bool>, ModelError> {
    Ok(tensors::read::<2, f64>(values)?.into_iter().map(|value| value >= least).collect())
}

impl Branch {
    /// A branch before its first step.
    pub fn new(gaussians: Gaussians) -> Self {
        let statistics = DensifyStatistics::new(&gaussians.means.val());
        Self { gaussians, optimiser: GaussianOptimiser::default(), statistics, sh_degree: 0 }
    }

    /// Forgets moments and statistics, as at the start of a stage.
    pub fn restart(&mut self) {
        self.optimiser = GaussianOptimiser::default();
        self.statistics = DensifyStatistics::new(&self.gaussians.means.val());
    }

    /// Clones and splits the Gaussians with large gradients, up to `most` in all. Returns where the rows come from, or
    /// `None` if nothing changed.
    ///
    /// # Errors
    /// If the device cannot hand its numbers back.
    pub fn densify(
        &mut self,
        threshold: f64,
        clone_size: f64,
        most: usize,
        stream: &mut Stream,
    ) -> Result<Option<Growth>, ModelError> {
        let gradients: Vec<f64> = tensors::read(self.statistics.mean_gradients())?;
        let axes: Vec<f64> = tensors::read(self.plain(Attribute::LogScales).max_dim(1).exp())?;
        let room = most.saturating_sub(gradients.len());
        let plan = DensifyPlan::new(&gradients, &axes, threshold, clone_size).limited(&gradients, room);
        let normals = (0..2 * plan.split.len())
            .map(|_| DVec3::from_array(std::array::from_fn(|_| stream.normal())))
            .collect::<Vec<_>>();
        self.grow(&plan, &normals)
    }

    /// Carries out a plan; `normals` are one draw for each half of a split Gaussian, first halves first.
    ///
    /// # Errors
    /// If the device cannot hand its numbers back.
    pub fn grow(&mut self, plan: &DensifyPlan, normals: &[DVec3]) -> Result<Option<Growth>, ModelError> {
        if plan.is_empty() {
            self.statistics = self.statistics.rearranged(&self.rows(&plan.sources()));
            return Ok(None);
        }
        let sources = plan.sources();
        let children = self.children(plan, normals)?;
        let whole = plan.kept.len() + plan.cloned.len();
        let rows = self.rows(&sources);
        for attribute in Attribute::ALL {
            let Some(values) = self.gaussians.plain(attribute) else { continue };
            let values = values.select(0, rows.clone());
            let (old, halves) = (values.clone().narrow(0, 0, whole), 2 * plan.split.len());
            let values = match attribute {
                _ if halves == 0 => values,
                Attribute::Means => Tensor::cat(vec![old, children.clone()], 0),
                Attribute::LogScales => Tensor::cat(vec![old, values.narrow(0, whole, halves) + split_log_scale()], 0),
                _ => values,
            };
            self.gaussians.replace(attribute, values);
        }
        self.optimiser.rearrange(&self.rows(&plan.kept), plan.added());
        self.statistics = self.statistics.rearranged(&rows);
        Ok(Some(Growth { sources, kept: plan.kept.len() }))
    }

    /// Puts further Gaussians after the others. They have all attributes that these have, and start without moments and
    /// statistics.
    pub fn append(&mut self, further: &Gaussians) {
        let added = further.count();
        let whole = self.rows(&(0..self.gaussians.count()).collect::<Vec<_>>());
        for attribute in Attribute::ALL {
            if let (Some(values), Some(further)) = (self.gaussians.plain(attribute), further.plain(attribute)) {
                self.gaussians.replace(attribute, Tensor::cat(vec![values, further], 0));
            }
        }
        self.optimiser.rearrange(&whole, added);
        self.statistics = self.statistics.extended(added);
    }

    /// Centres of both halves of every split Gaussian: `[2 S, 3]`.
    fn children(&self, plan: &DensifyPlan, normals: &[DVec3]) -> Result<Tensor<2>, ModelError> {
        let means = self.plain(Attribute::Means);
        if plan.split.is_empty() {
            return Ok(means.narrow(0, 0, 1));
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
        Ok(tensors::from_data_like(TensorData::new(positions, [2 * count, 3]), &means))
    }

    /// Removes what a rule has no place for. Returns the rows that stay, or `None` if all do.
    ///
    /// # Errors
    /// If the device cannot hand its numbers back.
    pub fn prune(&mut self, rule: &PruneRule) -> Result<Option<Vec<usize>>, ModelError> {
        let fits = self.fitting(rule)?;
        let kept: Vec<usize> = (0..fits.len()).filter(|&row| fits[row]).collect();
        // A branch never loses its last Gaussian: an empty tensor is of no use to anyone.
        if kept.len() == fits.len() || kept.is_empty() {
            return Ok(None);
        }
        self.keep(&kept);
        Ok(Some(kept))
    }

    /// Moves at most `most` of those that a rule has no place for to where opacity and gradient are, instead of removing
    /// them. Returns where the rows come from, or `None` if nothing changed.
    ///
    /// # Errors
    /// If the device cannot hand its numbers back.
    pub fn relocate(
        &mut self,
        rule: &PruneRule,
        most: usize,
        stream: &mut Stream,
    ) -> Result<Option<Growth>, ModelError> {
        let dead: Vec<bool> = self.fitting(rule)?.into_iter().map(|fits| !fits).collect();
        let opacities: Vec<f64> =
            tensors::read(burn::tensor::activation::sigmoid(self.plain(Attribute::OpacityLogits)))?;
        let gradients: Vec<f64> = tensors::read(self.statistics.mean_gradients())?;
        let plan = RelocationPlan::draw(&dead, &opacities, &gradients, most, stream);
        if plan.is_empty() {
            return Ok(None);
        }
        let shares: Vec<Share> = plan.shared.iter().map(|&row| Share::of(opacities[row])).collect();
        let (sources, kept) = (plan.sources(), plan.kept.len());
        let rows = self.rows(&sources);
        for attribute in Attribute::ALL {
            let Some(values) = self.gaussians.plain(attribute) else { continue };
            let values = values.select(0, rows.clone());
            let column = |of: fn(&Share) -> f64| {
                let twice = shares.iter().chain(&shares).map(of).collect::<Vec<f64>>();
                let count = twice.len();
                tensors::from_data_like::<2, 2>(TensorData::new(twice, [count, 1]), &values)
            };
            let (own, copies) = (values.clone().narrow(0, 0, kept), values.clone().narrow(0, kept, 2 * shares.len()));
            let values = match attribute {
                Attribute::OpacityLogits => Tensor::cat(vec![own, column(|share| logit_of(share.opacity))], 0),
                Attribute::LogScales => Tensor::cat(vec![own, copies + column(|share| share.scale.ln())], 0),
                _ => values,
            };
            self.gaussians.replace(attribute, values);
        }
        let stays = self.rows(&plan.kept);
        self.optimiser.rearrange(&stays, 2 * shares.len());
        self.statistics = self.statistics.select(&stays).extended(2 * shares.len());
        Ok(Some(Growth { sources, kept }))
    }

    /// For every row whether a rule has a place for it.
    fn fitting(&self, rule: &PruneRule) -> Result<Vec<bool>, ModelError> {
        let opacities = burn::tensor::activation::sigmoid(self.plain(Attribute::OpacityLogits));
        let mut fits = at_least(rule.min_opacity, opacities)?;
        let mut narrow = |others: Vec<bool>| fits.iter_mut().zip(others).for_each(|(fits, other)| *fits &= other);
        if let Some(least) = rule.min_foreground {
            narrow(at_least(least, self.statistics.foreground.clone())?);
        }
        if let Some(most) = rule.max_radius {
            narrow(at_least(-most, -self.statistics.radii.clone())?);
        }
        if let Some(most) = rule.max_scale {
            narrow(at_least(-most.ln(), -self.plain(Attribute::LogScales).max_dim(1))?);
        }
        Ok(fits)
    }

    /// Keeps the given rows alone.
    pub fn keep(&mut self, kept: &[usize]) {
        let rows = self.rows(kept);
        for attribute in Attribute::ALL {
            if let Some(values) = self.gaussians.plain(attribute) {
                self.gaussians.replace(attribute, values.select(0, rows.clone()));
            }
        }
        self.optimiser.rearrange(&rows, 0);
        self.statistics = self.statistics.select(&rows);
    }

    /// Makes a random share of the Gaussians nearly transparent.
    ///
    /// # Errors
    /// If the device cannot hand its numbers back.
    pub fn reset_opacity(&mut self, plan: &ResetPlan, others: OpacityReset) -> Result<(), ModelError> {
        let logits = self.plain(Attribute::OpacityLogits);
        let reset = plan.apply(&tensors::read::<2, f64>(logits.clone())?, others);
        let count = reset.len();
        let reset = tensors::from_data_like(TensorData::new(reset, [count, 1]), &logits);
        self.gaussians.replace(Attribute::OpacityLogits, reset);
        self.optimiser.reset(Attribute::OpacityLogits);
        Ok(())
    }

    /// The numbers of an attribute that every branch has.
    fn plain(&self, attribute: Attribute) -> Tensor<2> {
        // Proof: `Gaussians` holds all but the mask logits without an `Option`, and no caller asks for those.
        self.gaussians.plain(attribute).expect("only mask logits may be absent, and they are not asked for here")
    }

    fn rows(&self, rows: &[usize]) -> Tensor<1, Int> {
        tensors::rows_like(rows, &self.gaussians.means.val())
    }
}
