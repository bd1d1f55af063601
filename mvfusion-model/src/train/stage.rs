//! The position of a run in its three stages.

use serde::{Deserialize, Serialize};

use crate::ModelError;
use crate::config::{BadStepRule, DensifyConfig, StageConfig, Steps};
use crate::model::DeformationLevel;

/// The three stages (paper, training strategy).
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Stage {
    /// Both branches without deformation.
    Geometry,
    /// With base deformation.
    Deformation,
    /// With motion-aware refinement.
    Refinement,
}

impl Stage {
    /// The stages in their order.
    pub const ALL: [Self; 3] = [Self::Geometry, Self::Deformation, Self::Refinement];

    /// Name for people and files.
    pub fn name(self) -> &'static str {
        match self {
            Self::Geometry => "geometry",
            Self::Deformation => "deformation",
            Self::Refinement => "refinement",
        }
    }

    /// The stage of the last of `completed` steps; before any step, the first stage.
    pub(super) fn of_last(completed: usize, stages: &StageConfig) -> Self {
        let last = completed.min(stages.total()).saturating_sub(1);
        Position::after(last, stages).map_or(Self::Geometry, |position| position.stage)
    }

    /// The deformation level of this stage.
    pub fn level(self, deformation: bool) -> DeformationLevel {
        match self {
            _ if !deformation => DeformationLevel::Still,
            Self::Geometry => DeformationLevel::Still,
            Self::Deformation => DeformationLevel::Base,
            Self::Refinement => DeformationLevel::Refined,
        }
    }
}

/// The position of a step in a run.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Position {
    /// Step within the run, from 1.
    pub run_step: usize,
    /// The stage.
    pub stage: Stage,
    /// Step within the stage, from 1.
    pub stage_step: usize,
    /// Steps of the stage.
    pub stage_length: usize,
    /// Step of the schedules' counter, from 1. The first stage has its own counter; the other two share one, unless
    /// configured otherwise (A1).
    pub step: usize,
}

impl Position {
    /// The step after `completed` steps, or `None` at the end of the run.
    pub fn after(completed: usize, stages: &StageConfig) -> Option<Self> {
        let mut before = 0;
        for (stage, length) in stages.lengths() {
            if completed < before + length {
                let stage_step = completed - before + 1;
                let step = match stage {
                    Stage::Refinement if !stages.refinement_restarts => stage_step + stages.deformation.0,
                    _ => stage_step,
                };
                return Some(Self { run_step: completed + 1, stage, stage_step, stage_length: length, step });
            }
            before += length;
        }
        None
    }

    /// Whether moments, statistics and schedules restart at this step.
    pub fn restarts(&self) -> bool {
        self.step == 1
    }

    /// Whether statistics are recorded and Gaussians added or removed at this step. Later, nobody reads them.
    pub fn densifies(&self, config: &DensifyConfig) -> bool {
        self.step < config.until.0
    }

    /// The error for a non-finite value at this step, which showed `views`.
    pub(super) fn not_finite(&self, what: String, views: String, rule: BadStepRule) -> ModelError {
        let Self { run_step, stage_step, stage, .. } = *self;
        ModelError::NotFinite { what, run_step, step: stage_step, stage: stage.name(), views, rule }
    }

    /// Whether this is the stage's last step.
    pub fn ends_stage(&self) -> bool {
        self.stage_step == self.stage_length
    }
}

impl StageConfig {
    /// Stages with these numbers of steps: geometry, deformation, refinement.
    pub fn of([geometry, deformation, refinement]: [usize; 3]) -> Self {
        let [geometry, deformation, refinement] = [geometry, deformation, refinement].map(Steps);
        Self { geometry, deformation, refinement, ..Self::default() }
    }

    /// The stages in their order, each with its steps.
    pub fn lengths(&self) -> [(Stage, usize); 3] {
        [
            (Stage::Geometry, self.geometry.0),
            (Stage::Deformation, self.deformation.0),
            (Stage::Refinement, self.refinement.0),
        ]
    }

    /// Steps of the whole run.
    pub fn total(&self) -> usize {
        self.geometry.0 + self.deforming()
    }

    /// Steps of the counter that the last two stages share.
    pub fn deforming(&self) -> usize {
        self.deformation.0 + self.refinement.0
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const STAGES: StageConfig =
        StageConfig { geometry: Steps(2), deformation: Steps(3), refinement: Steps(4), refinement_restarts: false };

    fn at(completed: usize) -> (Stage, usize, usize) {
        let position = Position::after(completed, &STAGES).expect("within the run");
        (position.stage, position.stage_step, position.step)
    }

    #[test]
    fn the_last_two_stages_share_a_counter() {
        assert_eq!(at(0), (Stage::Geometry, 1, 1));
        assert_eq!(at(1), (Stage::Geometry, 2, 2));
        assert_eq!(at(2), (Stage::Deformation, 1, 1));
        assert_eq!(at(5), (Stage::Refinement, 1, 4));
        assert_eq!(at(8), (Stage::Refinement, 4, 7));
        assert_eq!(Position::after(9, &STAGES), None);
    }

    #[test]
    fn a_model_is_of_the_stage_of_its_last_step() {
        let of_last = |completed| Stage::of_last(completed, &STAGES);
        assert_eq!([0, 1, 2].map(of_last), [Stage::Geometry; 3]);
        assert_eq!([3, 5].map(of_last), [Stage::Deformation; 2]);
        assert_eq!([6, 9, 99].map(of_last), [Stage::Refinement; 3]);
        assert_eq!(Stage::of_last(7, &StageConfig::of([2, 3, 0])), Stage::Deformation);
        assert_eq!(Stage::of_last(0, &StageConfig::of([0, 0, 0])), Stage::Geometry);
    }

    #[test]
    fn the_last_stage_may_start_again() {
        let stages = StageConfig { refinement_restarts: true, ..STAGES };
        let position = Position::after(5, &stages).expect("within the run");
        assert_eq!((position.stage, position.step), (Stage::Refinement, 1));
        assert!(position.restarts());
    }

    #[test]
    fn only_a_run_that_stops_is_advised_to_skip() {
        let position = Position::after(2, &STAGES).expect("within the run");
        let said = |rule| position.not_finite("the loss".to_owned(), "cam01".to_owned(), rule).to_string();
        let place = "the loss is not finite at step 3 (step 1 of stage deformation), which showed cam01. Lower the";
        assert!([BadStepRule::Stop, BadStepRule::Skip].into_iter().all(|rule| said(rule).starts_with(place)));
        assert!(said(BadStepRule::Stop).contains("`train.on_bad_step = \"skip\"`"));
        assert!(said(BadStepRule::Skip).ends_with("Lower the learning rates."));
    }

    #[test]
    fn a_stage_of_no_steps_is_skipped() {
        let stages = StageConfig { deformation: Steps(0), ..STAGES };
        let position = Position::after(2, &stages).expect("within the run");
        assert_eq!((position.stage, position.step), (Stage::Refinement, 1));
        assert!(position.restarts());
    }
}
