//! A branch's part of the backward half of a step: what was seen, changes of rows, the optimiser's step (METHOD §4.7 to
//! §4.11).

use burn::tensor::Tensor;
use mvfusion_render::profile::{Part, measure};

use super::step::Sighting;
use super::{Contribution, Position, Sampler, Stage};
use crate::ModelError;
use crate::config::{BranchDensifyConfig, Config};
use crate::densify::{Branch, Census, PruneRule, ResetPlan};
use crate::gaussians::Attribute;
use crate::motion::MotionCache;
use crate::optim::{GaussianGradients, GaussianRates};
use crate::random::Stream;

/// Foreground probability below which a dynamic Gaussian counts as unused, as a share of the least opacity (METHOD §4.10).
const UNUSED_SHARE: f64 = 0.1;

/// A branch at its turn in a step.
pub(super) struct BranchTurn<'a> {
    pub branch: &'a mut Branch,
    pub census: &'a mut Census,
    pub limits: &'a BranchDensifyConfig,
    pub rates: &'a GaussianRates,
    /// What only the dynamic branch has.
    pub moving: Option<Moving<'a>>,
    /// Whether no Gaussian is to be added yet.
    pub waits: bool,
    pub config: &'a Config,
    pub position: &'a Position,
    pub extent: f64,
    pub stream: &'a mut Stream,
}

/// What only the dynamic branch has.
pub(super) struct Moving<'a> {
    /// Motion descriptors, whose rows follow the Gaussians' (A25).
    pub cache: &'a mut Option<MotionCache>,
    /// Knows when every view was shown.
    pub sampler: &'a mut Sampler,
}

impl BranchTurn<'_> {
    /// Learns from what was contributed since the last turn.
    pub fn learn(mut self, contribution: Contribution) -> Result<(), ModelError> {
        let Contribution { sighting, screen, mut gradients } = contribution;
        if self.position.step < self.config.densify.until {
            measure(Part::Densify, || {
                self.observe(sighting, screen);
                self.change_rows(&mut gradients)
            })?;
        }
        let branch = self.branch;
        let step = || branch.optimiser.step(&mut branch.gaussians, gradients, self.rates, &self.config.optim);
        measure(Part::Optimiser, step);
        Ok(())
    }

    fn observe(&mut self, sighting: Sighting, screen: Option<Tensor<2>>) {
        let statistics = &mut self.branch.statistics;
        statistics.record_radii(sighting.radii);
        if let Some(foreground) = sighting.foreground {
            statistics.record_foreground(foreground, sighting.visible.clone());
        }
        if let Some(screen) = screen {
            statistics.record(screen, sighting.visible);
        }
    }

    /// Clones, splits, prunes and resets, each when due.
    fn change_rows(&mut self, gradients: &mut GaussianGradients) -> Result<(), ModelError> {
        let config = &self.config.densify;
        let step = self.position.step;
        let due = |from: usize, interval: usize| step > from && step.is_multiple_of(interval);

        let tidies = due(config.prune_from, config.prune_interval);
        if tidies && config.relocate > 0.0 && !self.waits {
            // Before densification, which takes the statistics.
            self.relocate(gradients)?;
        }
        if due(config.from, config.interval) && !self.waits && self.branch.gaussians.count() < self.limits.max_gaussians
        {
            self.densify(gradients)?;
        }
        if tidies && config.relocate == 0.0 && self.branch.gaussians.count() > self.limits.prune_above {
            self.prune(gradients)?;
        }
        let ends_geometry = self.position.stage == Stage::Geometry && self.position.ends_stage();
        if step.is_multiple_of(config.reset_interval) && (config.reset_at_stage_end || !ends_geometry) {
            let plan = ResetPlan::draw(self.branch.gaussians.count(), self.limits.reset_share, self.stream);
            self.branch.reset_opacity(&plan, config.reset)?;
            self.census.resets += 1;
            gradients.forget(Attribute::OpacityLogits);
        }
        Ok(())
    }

    fn densify(&mut self, gradients: &mut GaussianGradients) -> Result<(), ModelError> {
        let before = self.branch.gaussians.count();
        let clone_size = self.config.densify.clone_below * self.extent;
        let most = self.limits.max_gaussians;
        if let Some(growth) = self.branch.densify(self.threshold(), clone_size, most, self.stream)? {
            self.census.added += growth.sources.len() - before;
            self.rows_moved(&growth.sources);
            if let Some(moving) = self.moving.as_mut().filter(|_| !self.config.motion.inherit) {
                *moving.cache = moving.cache.take().map(|cache| cache.forget_from(growth.kept));
            }
            gradients.forget_all();
        }
        Ok(())
    }

    /// Moves Gaussians that show nothing to where some are needed.
    fn relocate(&mut self, gradients: &mut GaussianGradients) -> Result<(), ModelError> {
        let (rule, round_ended) = self.prune_rule();
        let most = (self.config.densify.relocate * self.branch.gaussians.count() as f64) as usize;
        let moved = self.branch.relocate(&rule, most, self.stream)?;
        self.begin_round(round_ended);
        if let Some(growth) = moved {
            self.census.relocated += (growth.sources.len() - growth.kept) / 2;
            self.rows_moved(&growth.sources);
            gradients.forget_all();
        }
        Ok(())
    }

    fn prune(&mut self, gradients: &mut GaussianGradients) -> Result<(), ModelError> {
        let (rule, round_ended) = self.prune_rule();
        let before = self.branch.gaussians.count();
        let kept = self.branch.prune(&rule)?;
        self.begin_round(round_ended);
        if let Some(kept) = kept {
            self.census.pruned += before - kept.len();
            self.rows_moved(&kept);
            gradients.forget_all();
        }
        Ok(())
    }

    /// Which Gaussians have no place, and whether every view was shown since this was last asked.
    fn prune_rule(&mut self) -> (PruneRule, bool) {
        let config = &self.config.densify;
        // Only after every view was shown does an unused Gaussian deserve the name.
        let round_ended = self.moving.as_mut().is_some_and(|moving| std::mem::take(&mut moving.sampler.round_ended));
        let late = self.position.step > self.config.train.stages.deforming() / 2;
        let masked = self.branch.gaussians.mask_logits.is_some();
        let sized = |most: f64| (most > 0.0 && self.position.step > config.reset_interval).then_some(most);
        let rule = PruneRule {
            min_opacity: config.min_opacity,
            min_foreground: ((config.prune_unused || config.relocate > 0.0) && masked && round_ended && late)
                .then_some(config.min_opacity * UNUSED_SHARE),
            max_radius: sized(config.max_radius),
            max_scale: sized(config.max_scale * self.extent),
        };
        (rule, round_ended)
    }

    /// What was part of the foreground is counted anew once every view was shown.
    fn begin_round(&mut self, round_ended: bool) {
        if round_ended {
            let statistics = &mut self.branch.statistics;
            statistics.foreground = statistics.foreground.zeros_like();
        }
    }

    /// Mean gradient that calls for more Gaussians (METHOD §4.8).
    fn threshold(&self) -> f64 {
        match self.position.stage {
            Stage::Geometry => self.limits.geometry_threshold,
            _ => self.limits.threshold,
        }
    }

    fn rows_moved(&mut self, sources: &[usize]) {
        if let Some(moving) = &mut self.moving
            && let Some(cache) = moving.cache.take()
        {
            let rows = crate::tensors::rows_like(sources, &cache.signatures);
            *moving.cache = Some(cache.select(&rows));
        }
    }
}
