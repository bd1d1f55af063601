//! A few steps of every stage of a smaller copy of a run.

use std::time::Instant;

use burn::tensor::Device;
use mvfusion_data::Scene;

use super::sample::Sample;
use crate::ModelError;
use crate::config::{Branches, Config, Interval, LEAST_MOTION_DURATION, StageConfig, Steps};
use crate::initial::initial_counts;
use crate::train::Trainer;

/// Steps of a stage. The last one is not timed, because it may also do what ends a stage.
const STEPS: usize = 7;

/// First steps of the run, and of a stage, that are not timed. In these, kernels are compiled, memory is found, and the
/// colours reach their last degree.
const WARM_UP: [usize; 2] = [3, 1];

/// A step that is never reached.
const NEVER: usize = 1_000_000;

/// What is probed, and until when.
pub(super) struct Ground<'a> {
    /// The configuration of the run, scaled.
    pub config: &'a Config,
    /// The sampled moments of the scene.
    pub sample: &'a Sample,
    /// The device.
    pub device: &'a Device,
    /// When a probe is given up.
    pub deadline: Instant,
}

/// The part of a run that a probe copies.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Part {
    /// Share of the pixels.
    pub pixels: f64,
    /// Share of the initial Gaussians: dynamic, static.
    pub gaussians: [f64; 2],
}

impl Part {
    /// The same share of pixels and Gaussians.
    pub fn even(share: f64) -> Self {
        Self { pixels: share, gaussians: [share; 2] }
    }

    /// The same with fewer Gaussians of a branch.
    pub fn with_fewer(mut self, branch: usize, factor: f64) -> Self {
        self.gaussians[branch] *= factor;
        self
    }
}

/// What a stage of a probe showed.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub(super) struct StageProbe {
    /// Median seconds of a step.
    pub seconds: f64,
    /// Gaussians: dynamic, static.
    pub counts: [f64; 2],
}

/// What a probe showed.
pub(super) struct Probe {
    /// The three stages; empty where the run has no steps.
    pub stages: [StageProbe; 3],
    /// Seconds that it took to create the trainer.
    pub start: f64,
    /// Seconds of the whole probe.
    pub seconds: f64,
    /// The trainer after the last step.
    pub trainer: Trainer,
    /// The scene that it saw.
    pub scene: Scene,
}

impl Ground<'_> {
    /// Takes a few timed steps in every stage. `None` if that would take too long.
    pub fn probe(&self, part: Part) -> Result<Option<Probe>, ModelError> {
        let started = Instant::now();
        let scene = self.sample.with_pixels(part.pixels)?;
        let mut trainer = Trainer::new(self.copy(part, STEPS)?, &scene, self.device)?;
        let start = started.elapsed().as_secs_f64();
        let mut stages = [StageProbe::default(); 3];
        let mut times = Vec::new();
        while let Some(position) = trainer.position() {
            if Instant::now() > self.deadline {
                return Ok(None);
            }
            let stage = &mut stages[position.stage as usize];
            stage.counts = counts(&trainer);
            let seconds = timed_step(&mut trainer, self.device)?;
            if position.ends_stage() {
                stage.seconds = median(std::mem::take(&mut times));
            } else if position.run_step > WARM_UP[0] && position.stage_step > WARM_UP[1] {
                times.push(seconds);
            }
        }
        Ok(Some(Probe { stages, start, seconds: started.elapsed().as_secs_f64(), trainer, scene }))
    }

    /// The configuration of a copy with `steps` steps in every stage, in which no row is added or removed and the colours
    /// have their last degree.
    pub fn copy(&self, part: Part, steps: usize) -> Result<Config, ModelError> {
        let mut copy = self.config.clone();
        let (init, densify, train) = (&mut copy.init, &mut copy.densify, &mut copy.train);
        let [dynamic, static_] = initial_counts(&self.sample.scene, self.config)?;
        // Those that are born in photos need room.
        let born = if self.config.has_births(&self.sample.scene) { init.photo_points } else { 0 };
        let of = |share: f64, count: usize| (share * count as f64).ceil() as usize;
        let most = |share: f64, count: usize| of(share, count).max(1);
        let [dynamic_share, static_share] = part.gaussians;
        let (share, most) = match self.config.model.branches {
            Branches::Both => (part.gaussians, [most(dynamic_share, dynamic + born), most(static_share, static_)]),
            // A single branch starts from the points of both.
            Branches::Dynamic => ([dynamic_share; 2], [most(dynamic_share, dynamic); 2]),
        };
        for (branch, points) in [
            (0, &mut init.dynamic_points),
            (0, &mut init.dynamic_from_cloud),
            (0, &mut init.motion_points),
            (0, &mut init.photo_points),
            (1, &mut init.static_points),
            (1, &mut init.sky_points),
        ] {
            *points = of(share[branch], *points).min(most[branch]);
        }
        // Files of Gaussians are read in full, and refused where they do not fit.
        if init.dynamic_ply.is_none() {
            densify.dynamic.max_gaussians = most[0];
        }
        if init.static_ply.is_none() {
            densify.static_.max_gaussians = most[1];
        }
        // With fewer moments, as many Gaussians are present at each of them.
        init.motion_duration = (init.motion_duration * self.sample.share).max(LEAST_MOTION_DURATION);
        let few = |stage: Steps| Steps(if stage.0 == 0 { 0 } else { steps });
        train.stages = StageConfig {
            geometry: few(train.stages.geometry),
            deformation: few(train.stages.deformation),
            refinement: few(train.stages.refinement),
            ..train.stages
        };
        (train.log_interval, train.dynamic_sh_interval, train.static_sh_interval) = (NEVER, Interval(1), Interval(1));
        (densify.from, densify.until, densify.prune_from) = (Steps(NEVER), Steps(NEVER), Steps(NEVER));
        densify.reset_interval = Interval(NEVER);
        if densify.births_interval.0 > 0 {
            densify.births_interval = Interval(NEVER);
        }
        Ok(copy)
    }
}

/// Gaussians of the branches: dynamic, static.
pub(super) fn counts(trainer: &Trainer) -> [f64; 2] {
    let model = &trainer.state().model;
    [model.dynamic.count(), model.static_.as_ref().map_or(0, |branch| branch.count())].map(|count| count as f64)
}

/// Seconds of a step until the device has done it.
fn timed_step(trainer: &mut Trainer, device: &Device) -> Result<f64, ModelError> {
    let sync = || device.sync().map_err(|error| ModelError::Device(error.to_string()));
    sync()?;
    let started = Instant::now();
    trainer.step()?;
    sync()?;
    Ok(started.elapsed().as_secs_f64())
}

/// The median; 0 of nothing.
pub(super) fn median(mut numbers: Vec<f64>) -> f64 {
    numbers.sort_by(f64::total_cmp);
    numbers.get(numbers.len() / 2).copied().unwrap_or(0.0)
}

#[cfg(all(test, feature = "flex"))]
mod tests {
    use mvfusion_data::{BuiltinOptions, builtin};

    use super::*;

    #[test]
    fn the_configuration_of_a_copy_is_valid_however_few_moments_are_sampled() {
        let scene = builtin::builtin(&BuiltinOptions { width: 16, height: 12, frames: 2, ..Default::default() });
        let mut config = Config::default();
        (config.init.motion_duration, config.init.motion_points) = (0.05, 100);
        let mut sample = Sample::of(&scene).expect("in memory");
        let device = crate::device::flex();
        for (share, duration) in [(0.5, 0.025), (0.004, LEAST_MOTION_DURATION)] {
            sample.share = share;
            let ground = Ground { config: &config, sample: &sample, device: &device, deadline: Instant::now() };
            let copy = ground.copy(Part::even(0.1), STEPS).expect("no files are needed");
            assert_eq!(copy.init.motion_duration, duration);
            copy.check().expect("the copy can be trained");
        }
    }
}
