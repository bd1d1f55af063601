//! The time that a training run will take on this machine, predicted from a few of its steps.
//!
//! Nothing is assumed about the machine. Smaller copies of the run are trained for a few steps of each stage: copies
//! with a share of the pixels and of the Gaussians, twice as large each time while the time allows, then the largest
//! again with fewer Gaussians of either branch. The time of a step is linear in the pixels and in the Gaussians of each
//! branch, so four copies determine a stage. The largest share is 1 for small scenes.
//!
//! The Gaussians of a run are unknown before it. Some steps on small images with narrow networks show which share of
//! them the first rounds of densification add. This share is assumed to fall with the number of rounds
//! (`growth.rs`). docs/performance.md, "Predict your hours", compares runs with their predictions.
//!
//! Not predicted: pruning, measurements of motion, the cost of births, T-LPIPS, checkpoints, and the writing of images.

mod fit;
mod gains;
mod growth;
mod probe;
mod sample;

use std::time::{Duration, Instant};

use burn::tensor::Device;
use mvfusion_data::{Capture, Scene};
use serde::Serialize;
use tracing::subscriber::{NoSubscriber, with_default};

use crate::ModelError;
use crate::config::Config;
use crate::evaluation::{Evaluator, Split, evaluate};
use crate::initial::SceneMotion;
use crate::train::Stage;
use fit::{Measured, Probed, StepCost};
use gains::Gains;
use growth::Beginning;
use probe::{Ground, Part, Probe, StageProbe, median};
use sample::{Sample, reduced_with_truth};

/// Share of the smallest copy.
const SMALL: f64 = 1.0 / 16.0;

/// Gaussians of a branch in the copy with fewer of them, as a fraction.
const FEWER: f64 = 0.25;

/// Fractions of the budget after which growth and copies end.
const GROWTH_ENDS: f64 = 0.4;
const COPIES_END: f64 = 0.95;

/// Pixels of the evaluated view.
const EVALUATED: f64 = 6e4;

/// The predicted time of a run, in seconds.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct RunTime {
    /// The whole run.
    pub seconds: f64,
    /// Before the first step: decoding, detecting motion, creating the model.
    pub start: f64,
    /// The stages that have steps.
    pub stages: Vec<StageTime>,
    /// Rendering and scoring the held-out views, and the training views with `eval.training_views`.
    pub evaluation: f64,
    /// Share of the run's pixels and initial Gaussians in the largest measured copy.
    pub measured_share: f64,
}

/// The predicted time of a stage.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct StageTime {
    /// The stage.
    pub stage: Stage,
    /// Its steps.
    pub steps: usize,
    /// Mean seconds of a step.
    pub seconds_per_step: f64,
    /// Expected dynamic Gaussians, mean over the steps.
    pub dynamic: usize,
    /// Expected static Gaussians, mean over the steps.
    #[serde(rename = "static")]
    pub static_: usize,
}

impl StageTime {
    /// Seconds of the stage.
    pub fn seconds(&self) -> f64 {
        self.steps as f64 * self.seconds_per_step
    }
}

impl RunTime {
    /// Predicts the time of a run by training for at most about `budget`. `config` is the scaled configuration for
    /// `scene`, and `evaluator` scores as the run will. `None` if the budget does not suffice for the smallest copy.
    ///
    /// # Errors
    /// If the run could not be trained: an image cannot be read, or the device fails.
    pub fn predict(
        config: &Config,
        scene: &Scene,
        device: &Device,
        evaluator: &Evaluator,
        budget: Duration,
    ) -> Result<Option<Self>, ModelError> {
        // What the copies would warn of is a result of their size.
        with_default(NoSubscriber::default(), || {
            let started = Instant::now();
            let sample = Sample::of(scene)?;
            let ground = Ground { config, sample: &sample, device, deadline: started + budget };
            let gains = ground.gains(started + budget.mul_f64(GROWTH_ENDS))?;
            let Some(copies) = Copies::probe(&ground, started + budget.mul_f64(COPIES_END))? else { return Ok(None) };
            let stages = copies.stages(config, scene, &gains);
            let start = copies.start(config, &sample);
            let evaluation = copies.evaluation(config, scene, evaluator)?;
            let training: f64 = stages.iter().map(StageTime::seconds).sum();
            let seconds = start + training + evaluation;
            Ok(Some(Self { seconds, start, stages, evaluation, measured_share: copies.share }))
        })
    }
}

/// The measured copies of a run.
struct Copies {
    /// The smallest copy.
    small: [StageProbe; 3],
    /// The largest copy.
    copy: Probe,
    /// Its share.
    share: f64,
    /// The largest with fewer dynamic and with fewer static Gaussians.
    fewer: [[StageProbe; 3]; 2],
}

impl Copies {
    /// Trains the copies, as large as the time until `end` allows.
    fn probe(ground: &Ground<'_>, end: Instant) -> Result<Option<Self>, ModelError> {
        let (mut small, mut share) = (None, SMALL);
        let Some(mut copy) = ground.probe(Part::even(share))? else { return Ok(None) };
        // The next copy takes at most twice as long, and so do the two with fewer Gaussians.
        while share < 1.0 && Instant::now() + Duration::from_secs_f64(3.0 * 2.0 * copy.seconds) < end {
            share *= 2.0;
            let Some(next) = ground.probe(Part::even(share))? else { return Ok(None) };
            let before = std::mem::replace(&mut copy, next);
            small.get_or_insert(before.stages);
        }
        let small = small.unwrap_or(copy.stages);
        let fewer = |branch| ground.probe(Part::even(share).with_fewer(branch, FEWER));
        let (Some(dynamic), Some(static_)) = (fewer(0)?, fewer(1)?) else { return Ok(None) };
        Ok(Some(Self { small, copy, share, fewer: [dynamic.stages, static_.stages] }))
    }

    /// The stages of the whole run.
    fn stages(&self, config: &Config, scene: &Scene, gains: &Gains) -> Vec<StageTime> {
        let (densify, stages) = (&config.densify, &config.train.stages);
        let is_born = scene.capture == Capture::Video && SceneMotion::finds_births(config);
        let births = if is_born { densify.births as f64 } else { 0.0 };
        let branch = |index: usize, births: f64, most: usize| {
            let counts = self.copy.stages.map(|stage| stage.counts[index] / self.share);
            let gains = gains.map(|stage| stage[index]);
            Beginning { counts, gains, births, most: most as f64 }.means(densify, stages)
        };
        let dynamic = branch(0, births, densify.dynamic.max_gaussians);
        let static_ = branch(1, 0.0, densify.static_.max_gaussians);
        let costs = self.costs();
        let time = |(index, (stage, steps)): (usize, (Stage, usize))| StageTime {
            stage,
            steps,
            seconds_per_step: costs[index].at([dynamic[index], static_[index]]),
            dynamic: dynamic[index].round() as usize,
            static_: static_[index].round() as usize,
        };
        stages.lengths().into_iter().enumerate().filter(|(_, (_, steps))| *steps > 0).map(time).collect()
    }

    /// The cost of a step of each stage. A static Gaussian does the same in all of them, so the median of its cost holds
    /// for all: it is small, and the noise of a long step would hide it.
    fn costs(&self) -> [StepCost; 3] {
        let probed = std::array::from_fn::<_, 3, _>(|stage| {
            let measured = |stages: &[StageProbe; 3]| {
                let StageProbe { counts, seconds } = stages[stage];
                Measured { counts, seconds }
            };
            Probed {
                copy: measured(&self.copy.stages),
                share: self.share,
                small: (measured(&self.small), SMALL),
                fewer: [measured(&self.fewer[0]), measured(&self.fewer[1])],
            }
        });
        let of_static = probed.iter().filter(|probed| probed.copy.seconds > 0.0).map(|probed| probed.slope(1));
        let of_static = median(of_static.collect());
        probed.map(|probed| StepCost::fit(&probed, [probed.slope(0), of_static]))
    }

    /// Seconds before the first step. Images are decoded once for training, and once to detect motion.
    fn start(&self, config: &Config, sample: &Sample) -> f64 {
        let created = self.copy.start / self.share;
        let decoded = sample.seconds / sample.share;
        match SceneMotion::reads_film(config) {
            true => created / sample.share + 2.0 * decoded,
            false => created + decoded,
        }
    }

    /// Seconds of the evaluation of all held-out views, and of the training views if they are scored, from one that is
    /// reduced.
    fn evaluation(&self, config: &Config, scene: &Scene, evaluator: &Evaluator) -> Result<f64, ModelError> {
        let Some(view) = scene.test.first() else { return Ok(0.0) };
        let share = (EVALUATED / (view.camera.width * view.camera.height) as f64).min(1.0);
        let view = reduced_with_truth(view, share)?;
        let one = Scene { test: vec![view], ..self.copy.scene.clone() };
        let trainer = &self.copy.trainer;
        let model = trainer.state().model.plain();
        let started = Instant::now();
        evaluate(&model, &one, Split::Test, trainer.final_level(), trainer.render_context(), evaluator, |_, _, _| {
            Ok::<_, ModelError>(())
        })?;
        let of_training = if config.eval.training_views { scene.train.len() } else { 0 };
        Ok(started.elapsed().as_secs_f64() / share * (scene.test.len() + of_training) as f64)
    }
}

#[cfg(all(test, feature = "flex"))]
mod tests {
    use mvfusion_data::{BuiltinOptions, builtin};

    use super::*;
    use crate::config::{Branches, StageConfig};
    use crate::evaluation::Protocol;

    fn predicted(change: impl Fn(&mut Config), budget: Duration) -> Option<RunTime> {
        let scene = builtin::builtin(&BuiltinOptions { width: 32, height: 24, frames: 3, ..Default::default() });
        let mut config = Config::default();
        config.train.stages = StageConfig::of([50, 0, 2000]);
        (config.model.width, config.model.grid.resolution) = (8, [4; 4]);
        (config.init.dynamic_points, config.init.static_points) = (60, 40);
        change(&mut config);
        let evaluator = Evaluator::without_lpips(Protocol::Mvfusion);
        RunTime::predict(&config, &scene, &crate::device::flex(), &evaluator, budget).expect("it can be trained")
    }

    #[test]
    fn a_run_is_predicted_by_its_stages_with_one_branch_or_two() {
        for branches in [Branches::Both, Branches::Dynamic] {
            let time = predicted(|config| config.model.branches = branches, Duration::from_secs(600));
            let RunTime { seconds, start, stages, evaluation, measured_share } = time.expect("there is time");
            let names: Vec<Stage> = stages.iter().map(|stage| stage.stage).collect();
            assert_eq!(names, [Stage::Geometry, Stage::Refinement]);
            assert!(stages.iter().all(|stage| (stage.static_ > 0) == (branches == Branches::Both)), "{stages:?}");
            let training: f64 = stages.iter().map(StageTime::seconds).sum();
            assert!(training > 0.0 && (seconds - start - training - evaluation).abs() < 1e-9 * seconds);
            assert_eq!(measured_share, 1.0);
        }
    }

    #[test]
    fn a_run_that_needs_measured_motion_is_predicted_too() {
        let steered = |config: &mut Config| {
            config.train.stages = StageConfig::of([50, 50, 100]);
            (config.densify.motion_power, config.loss.still_opacity) = (0.5, 0.01);
        };
        assert!(predicted(steered, Duration::from_secs(600)).is_some());
    }

    #[test]
    fn without_time_there_is_no_prediction() {
        assert_eq!(predicted(|_| {}, Duration::ZERO), None);
    }
}
