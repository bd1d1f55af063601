//! The backward half of a step: gradients, row changes, optimiser steps (METHOD §4.1, order inside an iteration).

use burn::tensor::{Gradients, Tensor};
use mvfusion_data::Lifetime;
use mvfusion_render::profile::{Part, measure};

use super::turn::BranchTurn;
use super::{BranchGradients, Losses, Position, RenderedBatch, Stage, Trainer};
use crate::ModelError;
use crate::model::motion::{Lifetimes, MotionCache, Trajectories};
use crate::model::network::DeformationNetwork;
use crate::model::{Model, RenderContext};
use crate::tensors::Reading;
use crate::train::optim::Rates;

/// The gradients of a step.
pub struct StepGradients {
    /// Gradients of the dynamic branch.
    pub dynamic: BranchGradients,
    /// Gradients of the static branch, if there is one.
    pub static_: Option<BranchGradients>,
    /// Gradients of network, refinement and exposures.
    pub modules: Gradients,
}

impl Trainer {
    /// The gradients of a loss with respect to all parameters, for a program that changes them before
    /// [`Trainer::update`]; [`Trainer::learn`] does both. With gradient accumulation, the loss is divided by the
    /// number of steps. Waits for the loss: on wgpu after the launch of the backward pass, on CUDA before it.
    ///
    /// # Errors
    /// [`ModelError::NotFinite`] for a loss that is not finite, with the parameter or render at fault.
    pub fn backward(
        &self,
        rendered: RenderedBatch,
        losses: Losses,
        position: &Position,
    ) -> Result<StepGradients, ModelError> {
        let loss = Reading::start(losses.total.clone().inner());
        let (shown, renders) = (rendered.shown.clone(), rendered.plain());
        let gradients = self.gradients(rendered, losses.total, position);
        match loss.wait()?.is_finite() {
            true => Ok(gradients),
            false => Err(self.bad_loss(renders, &shown, position)?),
        }
    }

    /// [`Trainer::backward`] without the check.
    pub(super) fn gradients(&self, rendered: RenderedBatch, loss: Tensor<1>, position: &Position) -> StepGradients {
        let RenderedBatch { views, probes, batch: _, shown: _ } = rendered;
        let (dynamic, static_) = (views.dynamic_visibility(), views.static_visibility());
        let mut gradients = measure(Part::BackwardRest, || (loss / self.accumulation(position) as f64).backward());
        let model = &self.state.model;
        let (dynamic_probe, static_probe) = probes.map(|probes| (probes.dynamic, probes.static_)).unzip();
        let dynamic = BranchGradients::take(&model.dynamic, dynamic, dynamic_probe, &mut gradients);
        let static_ = model.static_.as_ref().zip(static_);
        let static_ = static_.map(|(still, seen)| BranchGradients::take(still, seen, static_probe, &mut gradients));
        StepGradients { dynamic, static_, modules: gradients }
    }

    /// The learning rates of a step (METHOD §4.5).
    pub fn rates(&self, position: &Position) -> Rates {
        let rates = Rates::at(position.step, self.context.extent, &self.config.optim);
        rates.with_frame(self.context.timeline.spacing())
    }

    /// Learns from the gradients of a step: statistics, row changes when due, and Adam steps.
    ///
    /// # Errors
    /// If the device fails to return values.
    pub fn update(&mut self, gradients: StepGradients, rates: &Rates, position: &Position) -> Result<(), ModelError> {
        let accumulation = self.accumulation(position);
        let StepGradients { dynamic, static_, mut modules } = gradients;
        self.update_dynamic(dynamic, rates, position)?;
        if let (Some(gradients), Some(state)) = (static_, &mut self.state.static_) {
            // The static branch accumulates the gradients of several steps, the dynamic branch learns at each step
            // (METHOD §4.3).
            let sum = match state.pending.take() {
                Some(earlier) => earlier.and(gradients),
                None => gradients,
            };
            match position.step.is_multiple_of(accumulation) {
                true => self.update_static(sum, rates, position)?,
                false => state.pending = Some(sum),
            }
        }
        measure(Part::Optimiser, || self.step_networks(&mut modules, rates));
        Ok(())
    }

    /// Number of accumulated steps of the static branch.
    fn accumulation(&self, position: &Position) -> usize {
        match position.stage {
            Stage::Geometry => 1,
            _ => self.config.train.accumulation,
        }
    }

    /// Whether opacities may be reset in a step (METHOD §4.11). Births in photos compare them with what the static branch
    /// has learned, so no reset comes right before.
    fn may_reset(&self, position: &Position) -> bool {
        let ends_geometry = position.stage == Stage::Geometry && position.ends_stage();
        !ends_geometry || (self.config.densify.reset_at_stage_end && !self.has_births)
    }

    fn update_dynamic(
        &mut self,
        gradients: BranchGradients,
        rates: &Rates,
        position: &Position,
    ) -> Result<(), ModelError> {
        // Dynamic Gaussians before the births show nothing, and new ones would take the room of the births.
        let waits_for_births = position.stage == Stage::Geometry && self.has_births;
        let may_reset = self.may_reset(position);
        let state = &mut self.state;
        let turn = BranchTurn {
            gaussians: &mut state.model.dynamic,
            state: &mut state.dynamic,
            motion: state.model.motion.as_mut(),
            sampler: Some(&mut state.sampler),
            limits: &self.config.densify.dynamic,
            rates: &rates.dynamic,
            waits: waits_for_births,
            may_reset,
            accumulation: 1,
            config: &self.config,
            position,
            extent: self.context.extent,
            stream: &mut state.streams.densify,
        };
        turn.learn(gradients)
    }

    fn update_static(
        &mut self,
        gradients: BranchGradients,
        rates: &Rates,
        position: &Position,
    ) -> Result<(), ModelError> {
        let (accumulation, may_reset) = (self.accumulation(position), self.may_reset(position));
        let state = &mut self.state;
        let (Some(gaussians), Some(branch)) = (&mut state.model.static_, &mut state.static_) else { return Ok(()) };
        let turn = BranchTurn {
            gaussians,
            state: branch,
            motion: None,
            sampler: None,
            limits: &self.config.densify.static_,
            rates: &rates.static_,
            waits: false,
            may_reset,
            accumulation,
            config: &self.config,
            position,
            extent: self.context.extent,
            stream: &mut state.streams.densify,
        };
        turn.learn(gradients)
    }

    fn step_networks(&mut self, gradients: &mut Gradients, rates: &Rates) {
        let config = &self.config.optim;
        let optimiser = &mut self.state.optimiser;
        let model = &mut self.state.model;
        let network = &mut model.network;
        optimiser.step_in_place("grid", &mut network.grid, gradients, rates.grid, config);
        optimiser.step_in_place("trunk", &mut network.trunk, gradients, rates.deformation, config);
        optimiser.step_in_place("heads", &mut network.heads, gradients, rates.deformation, config);
        if let Some(masks) = &mut network.masks {
            optimiser.step_in_place("masks", masks, gradients, rates.mask_heads, config);
        }
        optimiser.step_in_place("refinement", &mut model.refinement, gradients, rates.motion, config);
        if let Some(exposures) = &mut model.exposures {
            optimiser.step_in_place("exposures", exposures, gradients, rates.exposure, config);
        }
    }

    /// Measures the trajectories of all dynamic Gaussians and fills the motion cache.
    pub(super) fn refresh_motion(&mut self) -> Result<(), ModelError> {
        measure(Part::Refresh, || self.measure_motion())
    }

    fn measure_motion(&mut self) -> Result<(), ModelError> {
        let model = self.state.model.plain();
        let lifetimes = Lifetimes::of(&model.dynamic, &self.config.motion)?;
        let means = model.dynamic.means.val();
        let statistics = self.trajectories(&model.network, lifetimes.as_ref()).measure(&means)?;
        let cache = MotionCache::new(statistics, &mut self.state.normalisers, &self.config.motion, &means)?;
        self.state.model.motion = Some(cache);
        self.state.refreshes += 1;
        Ok(())
    }

    /// The descriptors of Gaussians that `model`, which is without autodiff, does not have yet, for canonical centres
    /// `[M, 3]`; `None` until motion was measured, or if another run measured it at another number of knots.
    pub(super) fn descriptors_of_further(
        &self,
        model: &Model,
        means: &Tensor<2>,
        lifetimes: &[Lifetime],
    ) -> Result<Option<MotionCache>, ModelError> {
        let Some(known) = &model.motion else { return Ok(None) };
        let (config, normalisers) = (&self.config.motion, &self.state.normalisers);
        let lifetimes = Lifetimes::of_further(lifetimes, config);
        let statistics = self.trajectories(&model.network, lifetimes.as_ref()).measure(means)?;
        if statistics.knot_times.len() != known.knot_times.len() {
            return Ok(None);
        }
        known.of_further(statistics, normalisers, config, [&model.dynamic.means.val(), means]).map(Some)
    }

    fn trajectories<'a>(
        &'a self,
        network: &'a DeformationNetwork,
        lifetimes: Option<&'a Lifetimes>,
    ) -> Trajectories<'a> {
        let RenderContext { timeline, extent, .. } = &self.context;
        Trajectories { network, timeline, config: &self.config.motion, extent: *extent, lifetimes }
    }
}
