//! A branch's part of the backward half of a step: statistics, row changes, the optimiser's step (METHOD §4.7 to
//! §4.11).

use burn::tensor::Tensor;
use mvfusion_render::profile::{Part, measure};

use super::{BranchGradients, Position, Sampler, Stage, Visibility};
use crate::ModelError;
use crate::config::{BranchDensifyConfig, Config, Steps};
use crate::model::gaussians::Gaussians;
use crate::model::motion::MotionCache;
use crate::random::Stream;
use crate::train::densify::{Branch, BranchState, PruneRule, ResetPlan};
use crate::train::optim::{GaussianGradients, GaussianRates};

/// Foreground probability below which a dynamic Gaussian counts as unused, as a fraction of `densify.min_opacity`
/// (METHOD §4.10).
const UNUSED_SHARE: f64 = 0.1;

/// The update of a branch in a step.
pub(super) struct BranchTurn<'a> {
    pub gaussians: &'a mut Gaussians,
    pub state: &'a mut BranchState,
    /// Motion descriptors; only for the dynamic branch.
    pub motion: Option<&'a mut MotionCache>,
    /// Tracks when every view was shown; only for the dynamic branch.
    pub sampler: Option<&'a mut Sampler>,
    pub limits: &'a BranchDensifyConfig,
    pub rates: &'a GaussianRates,
    /// Whether additions must wait.
    pub waits: bool,
    /// Whether opacities may be reset in this step.
    pub may_reset: bool,
    /// Steps from one turn to the next.
    pub accumulation: usize,
    pub config: &'a Config,
    pub position: &'a Position,
    pub extent: f64,
    pub stream: &'a mut Stream,
}

impl BranchTurn<'_> {
    /// Learns from the gradients since the last update.
    pub fn learn(mut self, gradients: BranchGradients) -> Result<(), ModelError> {
        let BranchGradients { visibility, screen, mut attributes } = gradients;
        if self.position.densifies(&self.config.densify) {
            measure(Part::Densify, || {
                self.observe(visibility, screen);
                self.change_rows(&mut attributes)
            })?;
        }
        let step = || self.state.optimiser.step(self.gaussians, attributes, self.rates, &self.config.optim);
        measure(Part::Optimiser, step);
        Ok(())
    }

    fn observe(&mut self, visibility: Visibility, screen: Option<Tensor<2>>) {
        let statistics = &mut self.state.statistics;
        statistics.record_radii(visibility.radii);
        if let Some(foreground) = visibility.foreground {
            statistics.record_foreground(foreground, visibility.visible.clone());
        }
        if let Some(screen) = screen {
            statistics.record(screen, visibility.visible);
        }
    }

    /// The branch, for changes of its rows.
    fn branch<'b>(&'b mut self, gradients: &'b mut GaussianGradients) -> (Branch<'b>, &'b mut Stream) {
        let branch = Branch {
            gaussians: self.gaussians,
            state: self.state,
            motion: self.motion.as_deref_mut(),
            gradients: Some(gradients),
        };
        (branch, self.stream)
    }

    /// Clones, splits, prunes and resets, each when due.
    fn change_rows(&mut self, gradients: &mut GaussianGradients) -> Result<(), ModelError> {
        let config = &self.config.densify;
        let (step, accumulation) = (self.position.step, self.accumulation);
        let after = |first: Steps| move |event: usize| event > first.0;
        let tidies = config.prune_interval.latest_within(accumulation, step).is_some_and(after(config.prune_from));
        if tidies && config.relocate > 0.0 && !self.waits {
            // Before densification, which resets the statistics.
            let most = (config.relocate * self.gaussians.count() as f64) as usize;
            let (rule, round_ended) = self.prune_rule();
            let (mut branch, stream) = self.branch(gradients);
            let priorities = branch.priorities(config.motion_power)?;
            branch.relocate(&priorities, &rule, most, stream)?;
            self.begin_round(round_ended);
        }
        let adds = config.interval.latest_within(accumulation, step).is_some_and(after(config.from));
        if adds && !self.waits && self.gaussians.count() < self.limits.max_gaussians {
            let (threshold, clone_size) = (self.threshold(), config.clone_below * self.extent);
            let most = self.limits.max_gaussians;
            let (mut branch, stream) = self.branch(gradients);
            let priorities = branch.priorities(config.motion_power)?;
            branch.densify(&priorities, threshold, clone_size, most, stream)?;
        }
        if tidies && config.relocate == 0.0 && self.gaussians.count() > self.limits.prune_above {
            let (rule, round_ended) = self.prune_rule();
            self.branch(gradients).0.prune(&rule)?;
            self.begin_round(round_ended);
        }
        if self.may_reset && config.reset_interval.latest_within(accumulation, step).is_some() {
            let plan = ResetPlan::draw(self.gaussians.count(), self.limits.reset_share, self.stream);
            self.branch(gradients).0.reset_opacity(&plan, config.reset)?;
        }
        Ok(())
    }

    /// The pruning rule, and whether every view was shown since the last call.
    fn prune_rule(&mut self) -> (PruneRule, bool) {
        let config = &self.config.densify;
        // A Gaussian is unused if no view showed it since the last call; that a round ended meanwhile stands for all of them
        // (METHOD §4.10).
        let round_ended = self.sampler.as_mut().is_some_and(|sampler| std::mem::take(&mut sampler.round_ended));
        let late = self.position.step > self.config.train.stages.deforming() / 2;
        let masked = self.gaussians.mask_logits.is_some();
        let sized = |most: f64| (most > 0.0 && self.position.step > config.reset_interval.0).then_some(most);
        let rule = PruneRule {
            min_opacity: config.min_opacity,
            min_foreground: ((config.prune_unused || config.relocate > 0.0) && masked && round_ended && late)
                .then_some(config.min_opacity * UNUSED_SHARE),
            max_radius: sized(config.max_radius),
            max_scale: sized(config.max_scale * self.extent),
        };
        (rule, round_ended)
    }

    /// Resets the foreground statistics after every view was shown.
    fn begin_round(&mut self, round_ended: bool) {
        if round_ended {
            let statistics = &mut self.state.statistics;
            statistics.foreground = statistics.foreground.zeros_like();
        }
    }

    /// Gradient threshold for cloning and splitting (METHOD §4.8).
    fn threshold(&self) -> f64 {
        match self.position.stage {
            Stage::Geometry => self.limits.geometry_threshold,
            _ => self.limits.threshold,
        }
    }
}
