//! The backward half of a step: statistics, changes of rows, optimiser steps (METHOD §4.1, order inside an iteration).

use burn::tensor::Gradients;
use mvfusion_render::profile::{Part, measure};

use super::step::Forward;
use super::turn::{BranchTurn, Moving};
use super::{Contribution, Position, Stage, Trainer};
use crate::ModelError;
use crate::motion::{MotionCache, Trajectories};
use crate::optim::Rates;

impl Trainer {
    /// Learns from a forward pass.
    pub(super) fn learn(&mut self, forward: Forward, position: &Position) -> Result<(), ModelError> {
        let accumulation = match position.stage {
            Stage::Geometry => 1,
            _ => self.config.train.accumulation,
        };
        let Forward { probes, dynamic, static_, total, loss: _, rendered: _ } = forward;
        let mut gradients = measure(Part::BackwardRest, || (total / accumulation as f64).backward());
        let rates = Rates::at(position.step, self.surroundings.extent, &self.config.optim);
        let rates = rates.with_frame(self.surroundings.timeline.spacing());

        let model = &self.state.model;
        let moved = Contribution::take(&model.dynamic, dynamic, probes.dynamic, &mut gradients);
        let still = model.static_.as_ref().zip(static_);
        let still = still.map(|(branch, seen)| Contribution::take(branch, seen, probes.static_, &mut gradients));

        self.dynamic_turn(position, &rates).learn(moved)?;
        if let Some(still) = still {
            // The background learns from several steps at once, the foreground from each (METHOD §4.3).
            let sum = match self.state.pending.take() {
                Some(earlier) => earlier.and(still),
                None => still,
            };
            if !position.step.is_multiple_of(accumulation) {
                self.state.pending = Some(sum);
            } else if let Some(turn) = self.static_turn(position, &rates) {
                turn.learn(sum)?;
            }
        }
        measure(Part::Optimiser, || self.step_networks(&mut gradients, &rates));
        Ok(())
    }

    fn dynamic_turn<'a>(&'a mut self, position: &'a Position, rates: &'a Rates) -> BranchTurn<'a> {
        // What is there before has nothing to show, and would take the room of those that are to be born.
        let waits_for_births = position.stage == Stage::Geometry && self.has_births;
        let state = &mut self.state;
        BranchTurn {
            branch: &mut state.model.dynamic,
            census: &mut state.census[0],
            limits: &self.config.densify.dynamic,
            rates: &rates.dynamic,
            moving: Some(Moving { cache: &mut state.model.motion, sampler: &mut state.sampler }),
            waits: waits_for_births,
            config: &self.config,
            position,
            extent: self.surroundings.extent,
            stream: &mut state.streams.densify,
        }
    }

    fn static_turn<'a>(&'a mut self, position: &'a Position, rates: &'a Rates) -> Option<BranchTurn<'a>> {
        let state = &mut self.state;
        Some(BranchTurn {
            branch: state.model.static_.as_mut()?,
            census: &mut state.census[1],
            limits: &self.config.densify.static_,
            rates: &rates.static_,
            moving: None,
            waits: false,
            config: &self.config,
            position,
            extent: self.surroundings.extent,
            stream: &mut state.streams.densify,
        })
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
        let exposures = model.exposures.take();
        model.exposures =
            exposures.map(|exposures| optimiser.step("exposures", exposures, gradients, rates.exposure, config));
    }

    /// Measures the trajectories of all dynamic Gaussians and fills the motion cache.
    pub(super) fn refresh_motion(&mut self) -> Result<(), ModelError> {
        measure(Part::Refresh, || self.measure_motion())
    }

    fn measure_motion(&mut self) -> Result<(), ModelError> {
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
}
