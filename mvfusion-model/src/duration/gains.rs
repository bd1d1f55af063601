//! The share of the Gaussians that a round of densification adds at the beginning of a run.

use std::time::Instant;

use super::probe::{Ground, Part, counts};
use crate::ModelError;
use crate::config::{Config, Interval, Steps, StillRule};
use crate::train::{Stage, Trainer};

/// Steps from one round to the next.
const ROUND: usize = 20;

/// Rounds of the first and of the second stage. The first round of deformation sees the steps in which the mask finds its
/// place, so the last one counts.
const ROUNDS: [usize; 2] = [1, 2];

/// Pixels of an image. The gradients are relative to the image, and hardly depend on its size.
const PIXELS: f64 = 1.5e4;

/// Width of the networks. They must be able to deform, but not in detail.
const WIDTH: usize = 32;

/// Share of the Gaussians that a round adds in each stage: dynamic, static.
pub(super) type Gains = [[f64; 2]; 3];

impl Ground<'_> {
    /// Trains all initial Gaussians on small images with narrow networks, at most until `end`. Stages that are not
    /// reached by then add nothing.
    pub fn gains(&self, end: Instant) -> Result<Gains, ModelError> {
        let view = &self.sample.scene.train[0].camera;
        let pixels = (PIXELS / (view.width * view.height) as f64).min(1.0);
        let scene = self.sample.with_pixels(pixels)?;
        let mut copy = self.copy(Part { pixels, gaussians: [1.0; 2] }, ROUND * ROUNDS[1])?;
        simplify(&mut copy);
        self.densify(&mut copy);
        let mut trainer = Trainer::new(copy, &scene, self.device)?;
        let mut gains = Gains::default();
        while let Some(position) = trainer.position().filter(|_| Instant::now() < end) {
            let before = counts(&trainer);
            trainer.step()?;
            if position.step.is_multiple_of(ROUND) {
                let after = counts(&trainer);
                let share = |branch: usize| (after[branch] / before[branch].max(1.0) - 1.0).max(0.0);
                // Before the births in photos, no dynamic Gaussians are added.
                let waits = position.stage == Stage::Geometry && self.config.has_births(&self.sample.scene);
                gains[position.stage as usize] = [if waits { 0.0 } else { share(0) }, share(1)];
            }
        }
        if self.config.train.stages.deformation.0 > 0 {
            gains[2] = gains[1];
        }
        Ok(gains)
    }

    /// Lets rows be added as in the run, but early.
    fn densify(&self, copy: &mut Config) {
        let (most, densify) = (&self.config.densify, &mut copy.densify);
        (densify.from, densify.interval) = (Steps(0), Interval(ROUND));
        densify.dynamic.max_gaussians = most.dynamic.max_gaussians;
        densify.static_.max_gaussians = most.static_.max_gaussians;
    }
}

/// Makes the networks narrow, shortens the first stage, and leaves out the last one, which grows like the second.
fn simplify(config: &mut Config) {
    let (stages, width) = (&mut config.train.stages, &mut config.model.width);
    stages.geometry = stages.geometry.min(Steps(ROUND * ROUNDS[0]));
    if stages.deformation.0 > 0 {
        stages.refinement = Steps(0);
        // Motion is measured for the last stage alone.
        (config.motion.still, config.loss.still_opacity) = (StillRule::Keep, 0.0);
        config.densify.motion_power = 0.0;
    }
    *width = WIDTH.min(*width);
}
