//! The backward half of a step: statistics, changes of rows, optimiser steps (METHOD §4.1, order inside an iteration).

use burn::tensor::{Gradients, Tensor};

use super::step::{Forward, Sighting};
use super::{Position, Stage, Trainer};
use crate::ModelError;
use crate::config::BranchDensifyConfig;
use crate::densify::{Branch, Census, ResetPlan};
use crate::gaussians::Attribute;
use crate::motion::{MotionCache, Trajectories};
use crate::optim::{GaussianGradients, Rates};

/// Foreground probability below which a dynamic Gaussian counts as unused, as a share of the least opacity (METHOD §4.10).
const UNUSED_SHARE: f64 = 0.1;

/// Which of the two branches.
#[derive(Clone, Copy, PartialEq, Eq)]
enum Which {
    Dynamic,
    Static,
}

impl Trainer {
    /// Learns from a forward pass.
    pub(super) fn learn(&mut self, forward: Forward, position: &Position) -> Result<(), ModelError> {
        let mut gradients = forward.total.backward();
        let Forward { probes, dynamic, static_, total, loss: _ } = forward;
        drop(total);
        let rates = Rates::at(position.step, self.surroundings.extent, &self.config.optim);

        for (which, sighting, probe) in
            [(Which::Dynamic, dynamic, probes.dynamic), (Which::Static, static_, probes.static_)]
        {
            let screen = probe.grad_remove(&mut gradients);
            let mut own = GaussianGradients::take(&self.branch(which).gaussians, &mut gradients);
            if position.step < self.config.densify.until {
                self.observe(which, sighting, screen);
                self.change_rows(which, position, &mut own)?;
            }
            let rates = if which == Which::Dynamic { &rates.dynamic } else { &rates.static_ };
            let config = self.config.optim.clone();
            let branch = self.branch_mut(which);
            branch.optimiser.step(&mut branch.gaussians, own, rates, &config);
        }
        self.step_networks(&mut gradients, &rates);
        Ok(())
    }

    /// Takes what the step saw of a branch into its statistics.
    fn observe(&mut self, which: Which, sighting: Sighting, screen: Option<Tensor<2>>) {
        let statistics = &mut self.branch_mut(which).statistics;
        if let Some(foreground) = sighting.foreground {
            statistics.record_foreground(foreground, sighting.visible.clone());
        }
        if let Some(screen) = screen {
            statistics.record(screen, sighting.visible);
        }
    }

    /// Clones, splits, prunes and resets, each when due.
    fn change_rows(
        &mut self,
        which: Which,
        position: &Position,
        gradients: &mut GaussianGradients,
    ) -> Result<(), ModelError> {
        let config = self.config.densify.clone();
        let limits = if which == Which::Dynamic { &config.dynamic } else { &config.static_ };
        let step = position.step;
        let due = |from: usize, interval: usize| step > from && step.is_multiple_of(interval);

        let count = self.branch(which).gaussians.count();
        if due(config.from, config.interval) && count < limits.max_gaussians {
            let clone_size = config.clone_below * self.surroundings.extent;
            self.densify(which, threshold(limits, position), clone_size, gradients)?;
        }
        let count = self.branch(which).gaussians.count();
        if due(config.prune_from, config.prune_interval) && count > limits.prune_above {
            self.prune(which, position, gradients)?;
        }
        let skipped = !config.reset_at_stage_end && position.stage == Stage::Geometry && position.ends_stage();
        if step.is_multiple_of(config.reset_interval) && !skipped {
            let count = self.branch(which).gaussians.count();
            let plan = ResetPlan::draw(count, limits.reset_share, &mut self.state.streams.densify);
            self.branch_mut(which).reset_opacity(&plan, config.reset)?;
            self.census_mut(which).resets += 1;
            gradients.forget(Attribute::OpacityLogits);
        }
        Ok(())
    }

    fn densify(
        &mut self,
        which: Which,
        threshold: f64,
        clone_size: f64,
        gradients: &mut GaussianGradients,
    ) -> Result<(), ModelError> {
        let before = self.branch(which).gaussians.count();
        let model = &mut self.state.model;
        let branch = if which == Which::Dynamic { &mut model.dynamic } else { &mut model.static_ };
        let Some(sources) = branch.densify(threshold, clone_size, &mut self.state.streams.densify)? else {
            return Ok(());
        };
        self.census_mut(which).added += sources.len() - before;
        self.rows_moved(which, &sources);
        gradients.forget_all();
        Ok(())
    }

    fn prune(
        &mut self,
        which: Which,
        position: &Position,
        gradients: &mut GaussianGradients,
    ) -> Result<(), ModelError> {
        let config = &self.config.densify;
        let (min_opacity, unused) = (config.min_opacity, config.min_opacity * UNUSED_SHARE);
        // Only after every view was shown does an unused Gaussian deserve the name.
        let round_ended = which == Which::Dynamic && std::mem::take(&mut self.state.sampler.round_ended);
        let late = position.step > self.config.train.stages.deforming() / 2;
        let min_foreground = (config.prune_unused && round_ended && late).then_some(unused);

        let before = self.branch(which).gaussians.count();
        let kept = self.branch_mut(which).prune(min_opacity, min_foreground)?;
        if round_ended {
            let statistics = &mut self.branch_mut(which).statistics;
            statistics.foreground = statistics.foreground.zeros_like();
        }
        if let Some(kept) = kept {
            self.census_mut(which).pruned += before - kept.len();
            self.rows_moved(which, &kept);
            gradients.forget_all();
        }
        Ok(())
    }

    /// Lets the motion cache follow the rows of the dynamic branch (A25).
    fn rows_moved(&mut self, which: Which, sources: &[usize]) {
        if which == Which::Dynamic
            && let Some(cache) = self.state.model.motion.take()
        {
            let rows = crate::tensors::rows_like(sources, &cache.signatures);
            self.state.model.motion = Some(cache.select(&rows));
        }
    }

    fn step_networks(&mut self, gradients: &mut Gradients, rates: &Rates) {
        let config = &self.config.optim;
        let optimiser = &mut self.state.optimiser;
        let model = &mut self.state.model;
        let mut network = model.network.clone();
        network.grid = optimiser.step("grid", network.grid, gradients, rates.grid, config);
        network.trunk = optimiser.step("trunk", network.trunk, gradients, rates.deformation, config);
        network.heads = optimiser.step("heads", network.heads, gradients, rates.deformation, config);
        network.masks = network.masks.map(|masks| optimiser.step("masks", masks, gradients, rates.mask_heads, config));
        model.network = network;
        let refinement = model.refinement.clone();
        model.refinement = optimiser.step("refinement", refinement, gradients, rates.motion, config);
    }

    /// Measures the trajectories of all dynamic Gaussians and fills the motion cache.
    pub(super) fn refresh_motion(&mut self) -> Result<(), ModelError> {
        let model = self.state.model.plain();
        let trajectories = Trajectories {
            network: &model.network,
            timeline: &self.surroundings.timeline,
            config: &self.config.motion,
            extent: self.surroundings.extent,
        };
        let means = model.dynamic.gaussians.means.val();
        let statistics = trajectories.measure(&means)?;
        let cache = MotionCache::new(statistics, &mut self.state.normalisers, &self.config.motion, &means);
        self.state.model.motion = Some(cache);
        self.state.refreshes += 1;
        Ok(())
    }

    fn branch(&self, which: Which) -> &Branch {
        match which {
            Which::Dynamic => &self.state.model.dynamic,
            Which::Static => &self.state.model.static_,
        }
    }

    fn branch_mut(&mut self, which: Which) -> &mut Branch {
        match which {
            Which::Dynamic => &mut self.state.model.dynamic,
            Which::Static => &mut self.state.model.static_,
        }
    }

    fn census_mut(&mut self, which: Which) -> &mut Census {
        &mut self.state.census[if which == Which::Dynamic { 0 } else { 1 }]
    }
}

/// Mean gradient that calls for more Gaussians (METHOD §4.8).
fn threshold(limits: &BranchDensifyConfig, position: &Position) -> f64 {
    if position.stage == Stage::Geometry { limits.geometry_threshold } else { limits.threshold }
}
