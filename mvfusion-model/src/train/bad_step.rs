//! Steps with a number that is not finite: which one, and what becomes of them.

use burn::module::{Module, ModuleVisitor, Param};
use burn::tensor::{Gradients, Tensor};
use serde::{Deserialize, Serialize};

use super::finite::Findings;
use super::parameters::Sink;
use super::rendered::PlainRenders;
use super::{BranchGradients, Losses, Position, RenderedBatch, StepGradients, Trainer};
use crate::ModelError;
use crate::config::BadStepRule;
use crate::model::Model;
use crate::model::gaussians::Attribute;
use crate::parameter_path::ParameterPath;
use crate::train::optim::Rates;

/// Number of skipped steps in a row after which training ends: the numbers no longer recover.
pub const MOST_BAD_STEPS: usize = 10;

/// Counts of the steps that were skipped because a number was not finite.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct BadSteps {
    /// Skipped steps of the whole run.
    pub total: usize,
    /// Skipped steps since the last one that was not.
    pub in_a_row: usize,
}

impl Trainer {
    /// The error for a loss that is not finite, with the parameter or render at fault.
    pub(super) fn bad_loss(
        &self,
        renders: PlainRenders,
        shown: &[usize],
        position: &Position,
    ) -> Result<ModelError, ModelError> {
        let found = self.findings(renders).first_bad()?.unwrap_or_else(|| "the loss".to_owned());
        self.not_finite(found, shown, position)
    }

    /// Rejects a non-finite parameter. A Gaussian with a non-finite centre is culled, so the loss may still be finite.
    ///
    /// # Errors
    /// [`ModelError::NotFinite`] with the parameter.
    pub(super) fn check_parameters(&self, position: &Position) -> Result<(), ModelError> {
        match Findings::of_parameters(&self.state.model).first_bad()? {
            Some(parameter) => {
                let rule = self.config.train.on_bad_step;
                Err(position.not_finite(parameter, self.photos.describe(&self.shown), rule))
            }
            None => Ok(()),
        }
    }

    /// Computes the gradients of a step and learns from them. `train.on_bad_step` says what becomes of a loss or
    /// gradient that is not finite.
    ///
    /// # Errors
    /// [`ModelError::NotFinite`] or [`ModelError::BadSteps`] by that rule, and if the device fails to return values.
    pub fn learn(
        &mut self,
        rendered: RenderedBatch,
        losses: Losses,
        rates: &Rates,
        position: &Position,
    ) -> Result<(), ModelError> {
        let gradients = match self.config.train.on_bad_step {
            BadStepRule::Stop => Some(self.backward(rendered, losses, position)?),
            BadStepRule::Skip => self.finite_gradients(rendered, losses, position)?,
        };
        gradients.map_or(Ok(()), |gradients| self.update(gradients, rates, position))
    }

    /// The gradients of a step, or `None` if its loss, or one of them, is not finite: then nothing changes but the
    /// counts. If that step ends a round of accumulation, the gradients of the round are dropped, so that the next one
    /// has its own steps alone. Waits for the device once.
    ///
    /// # Errors
    /// [`ModelError::BadSteps`] after [`MOST_BAD_STEPS`] such steps in a row.
    fn finite_gradients(
        &mut self,
        rendered: RenderedBatch,
        Losses { total, .. }: Losses,
        position: &Position,
    ) -> Result<Option<StepGradients>, ModelError> {
        let mut findings = self.findings(rendered.plain());
        findings.take("the loss".to_owned(), total.clone().inner());
        let shown = rendered.shown.clone();
        let gradients = self.gradients(rendered, total, position);
        gradients.add_to(&mut findings, &self.state.model);
        match findings.first_bad()? {
            Some(found) => {
                let error = self.not_finite(found, &shown, position)?;
                self.skip(error, position).map(|()| None)
            }
            None => {
                self.state.bad_steps.in_a_row = 0;
                Ok(Some(gradients))
            }
        }
    }

    fn skip(&mut self, error: ModelError, position: &Position) -> Result<(), ModelError> {
        if let Some(state) = &mut self.state.static_
            && position.step.is_multiple_of(self.config.train.accumulation)
        {
            state.pending = None;
        }
        let counts = &mut self.state.bad_steps;
        (counts.total, counts.in_a_row) = (counts.total + 1, counts.in_a_row + 1);
        if counts.in_a_row >= MOST_BAD_STEPS {
            return Err(ModelError::BadSteps { in_a_row: counts.in_a_row, last: Box::new(error) });
        }
        tracing::warn!("the step is skipped: {error}");
        Ok(())
    }

    fn findings(&self, renders: PlainRenders) -> Findings {
        renders.findings(|view| self.photos.describe(&[view]))
    }

    /// The error for a step in which `found` is not finite. A parameter that is not finite either is the cause.
    fn not_finite(&self, found: String, shown: &[usize], position: &Position) -> Result<ModelError, ModelError> {
        let parameter = Findings::of_parameters(&self.state.model).first_bad()?;
        let rule = self.config.train.on_bad_step;
        Ok(position.not_finite(parameter.unwrap_or(found), self.photos.describe(shown), rule))
    }
}

impl StepGradients {
    /// Adds the findings for all gradients.
    fn add_to(&self, findings: &mut Findings, model: &Model) {
        let branches = std::iter::once(&self.dynamic).chain(&self.static_);
        for ((name, _), BranchGradients { attributes, .. }) in model.branches().zip(branches) {
            for attribute in Attribute::ALL {
                if let Some(gradient) = attributes.of(attribute) {
                    findings.take(format!("the gradient of {name}.{attribute}"), gradient.clone());
                }
            }
        }
        let mut walk = GradientWalk { findings, gradients: &self.modules, path: ParameterPath::new("network") };
        model.network.visit(&mut walk);
        walk.path = ParameterPath::new("refinement");
        model.refinement.visit(&mut walk);
        walk.path = ParameterPath::new("exposures");
        model.exposures.visit(&mut walk);
    }
}

/// The iteration over the gradients of a module.
struct GradientWalk<'a> {
    findings: &'a mut Findings,
    gradients: &'a Gradients,
    path: ParameterPath,
}

impl ModuleVisitor for GradientWalk<'_> {
    fn enter_module(&mut self, name: &str, container_type: &str) {
        self.path.enter(name, container_type);
    }

    fn exit_module(&mut self, _name: &str, container_type: &str) {
        self.path.exit(container_type);
    }

    fn visit_float<const D: usize>(&mut self, param: &Param<Tensor<D>>) {
        if let Some(gradient) = param.val().grad(self.gradients) {
            self.findings.take(format!("the gradient of {}", self.path.name()), gradient);
        }
    }
}

#[cfg(all(test, feature = "flex"))]
mod tests {
    use mvfusion_data::BuiltinOptions;
    use mvfusion_data::builtin::builtin;

    use super::*;
    use crate::config::{BadStepRule, Config, ModelConfig, StageConfig, TrainConfig};
    use crate::device;

    #[test]
    fn a_skipped_step_that_ends_a_round_of_accumulation_drops_the_gradients_of_the_round() {
        let mut scene = builtin(&BuiltinOptions { width: 24, height: 16, frames: 3, ..BuiltinOptions::default() });
        scene.points.positions.truncate(12);
        scene.points.colours.truncate(12);
        let stages = StageConfig::of([1, 3, 0]);
        let train = TrainConfig { stages, batch_size: 1, accumulation: 3, ..TrainConfig::default() };
        let model = ModelConfig { width: 4, ..ModelConfig::default() };
        let mut config = Config { train, model, ..Config::default() };
        config.init.dynamic_points = 10;
        let mut trainer = Trainer::new(config, &scene, &device::flex()).expect("the run can start");
        let is_pending =
            |trainer: &Trainer| trainer.state.static_.as_ref().is_some_and(|state| state.pending.is_some());
        (0..2).for_each(|_| assert!(trainer.step().expect("a step succeeds").is_some()));
        assert!(is_pending(&trainer));
        for (ends_round, keeps) in [(false, true), (true, false)] {
            let position = trainer.position().expect("a step is left");
            assert_eq!(position.step.is_multiple_of(3), ends_round);
            let error = position.not_finite("the loss".to_owned(), String::new(), BadStepRule::Skip);
            trainer.skip(error, &position).expect("two are skipped");
            trainer.state.completed += 1;
            assert_eq!(is_pending(&trainer), keeps);
        }
    }
}
