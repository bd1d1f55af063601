//! What the motion-aware modules contribute to a trained model.
//!
//! The output of a module is split into three parts whose mean squares add up: its mean over all Gaussians and times,
//! which a bias of the next layer could be; what differs between Gaussians but not over time, which the base
//! deformation could learn as well; and what changes over time. Only Gaussians that are alive count.

use std::collections::BTreeMap;

use burn::tensor::Tensor;
use serde::{Deserialize, Serialize};

use crate::ModelError;
use crate::model::alive::AliveRows;
use crate::model::motion::{ModuleProbe, MotionModule, Substitute, Substitutes, TemporalModule};
use crate::model::{Model, RenderContext};
use crate::tensors;

/// Figures of the motion-aware modules of a model, over at most `motion.samples` of its training times.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct RefinementFigures {
    /// Of MVG.
    #[serde(skip_serializing_if = "Option::is_none", default)]
    pub mvg: Option<ModuleFigures>,
    /// Of MFTA.
    #[serde(skip_serializing_if = "Option::is_none", default)]
    pub mfta: Option<ModuleFigures>,
    /// Of MFTA's attention, if it is one.
    #[serde(skip_serializing_if = "Option::is_none", default)]
    pub attention: Option<AttentionFigures>,
}

/// Figures of the output of a module.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct ModuleFigures {
    /// Root mean square of the output over that of the base feature, to which it is added.
    pub norm: f64,
    /// Share of the mean square in the mean over all Gaussians and times.
    pub constant: f64,
    /// Share of the mean square in the differences between the Gaussians' means over time.
    pub over_gaussians: f64,
    /// Share of the mean square in the changes over time.
    pub over_time: f64,
    /// Mean share of the hidden units of the module's MLP that are positive. Earlier versions did not count them.
    #[serde(skip_serializing_if = "Option::is_none", default)]
    pub active: Option<f64>,
    /// Share of the Gaussians, over all times, of which no hidden unit is positive. With ReLUs, their output is the last
    /// layer's bias.
    #[serde(skip_serializing_if = "Option::is_none", default)]
    pub silent: Option<f64>,
}

/// Figures of an attention.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct AttentionFigures {
    /// Mean entropy over Gaussians, heads and times, in nats.
    pub entropy: f64,
    /// Entropy of uniform weights: the logarithm of the number of tokens.
    pub uniform_entropy: f64,
}

/// What stands in for a module's output.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Replacement {
    /// Its mean over all Gaussians and times.
    Constant,
    /// Each Gaussian's own mean over time.
    Mean,
    /// The output of another Gaussian at the same time, drawn at random.
    Shuffled,
}

impl Replacement {
    /// All replacements.
    pub const ALL: [Self; 3] = [Self::Constant, Self::Mean, Self::Shuffled];

    /// Name in files and on the command line.
    pub fn name(self) -> &'static str {
        match self {
            Self::Constant => "constant",
            Self::Mean => "mean",
            Self::Shuffled => "shuffled",
        }
    }
}

/// The outputs of a model's motion-aware modules over its training times.
#[derive(Debug)]
pub struct RefinementSurvey {
    figures: RefinementFigures,
    /// For each module, the mean over all Gaussians and times, `[1, H]`, and over times, `[N, H]`.
    means: BTreeMap<MotionModule, [Tensor<2>; 2]>,
}

impl RefinementSurvey {
    /// Evaluates the modules of a model without autodiff at `motion.samples` training times; `None` if the model has no
    /// such module, or motion was not measured.
    ///
    /// # Errors
    /// If the device fails to return values.
    pub fn of(model: &Model, context: &RenderContext) -> Result<Option<Self>, ModelError> {
        let mut base = 0.0;
        let mut sums: BTreeMap<MotionModule, Sums> = BTreeMap::new();
        let mut entropies = Vec::new();
        let times = context.timeline.sample_indices(context.motion.samples);
        for time in times.into_iter().map(|index| context.timeline.times()[index]) {
            let alive = AliveRows::of(&model.dynamic, time)?;
            let Some(probe) = model.probe((alive.as_ref(), time), context) else { return Ok(None) };
            base += sum_of_squares(&probe.base)?;
            for (module, found) in probe.modules {
                let sums = sums.entry(module).or_insert_with(|| Sums::new(model.dynamic.count(), &found.output));
                sums.add(found, alive.as_ref())?;
            }
            if let Some(entropy) = probe.entropy {
                entropies.extend(tensors::read::<1, f64>(entropy)?);
            }
        }
        if sums.is_empty() {
            return Ok(None);
        }
        let mut figures = RefinementFigures { mvg: None, mfta: None, attention: None };
        let mut means = BTreeMap::new();
        for (module, sums) in sums {
            let (of_module, own) = sums.finish(base)?;
            match module {
                MotionModule::Mvg => figures.mvg = Some(of_module),
                MotionModule::Mfta => figures.mfta = Some(of_module),
            }
            means.insert(module, own);
        }
        let count = entropies.len() as f64;
        figures.attention = attention_keys(model, context).filter(|_| count > 0.0).map(|keys| AttentionFigures {
            entropy: entropies.iter().sum::<f64>() / count,
            uniform_entropy: (keys as f64).ln(),
        });
        Ok(Some(Self { figures, means }))
    }

    /// The figures.
    pub fn figures(&self) -> RefinementFigures {
        self.figures
    }

    /// The substitutes that replace a module's output; `None` if the model does not have the module.
    pub fn substitutes(&self, module: MotionModule, replacement: Replacement) -> Option<Substitutes> {
        let [of_all, of_each] = self.means.get(&module)?;
        let substitute = match replacement {
            Replacement::Constant => Substitute::fixed(of_all.clone()),
            Replacement::Mean => Substitute::fixed(of_each.clone()),
            Replacement::Shuffled => Substitute::Shuffled,
        };
        Some(Substitutes::of(module, substitute))
    }
}

/// Number of tokens that a query of MFTA attends to; `None` without attention.
fn attention_keys(model: &Model, context: &RenderContext) -> Option<usize> {
    let frames = model.refinement.rules.frames.len();
    match model.refinement.temporal.as_ref()? {
        TemporalModule::Attention(_) => Some(frames + usize::from(context.motion.include_self)),
        TemporalModule::SelfAttention(_) => Some(frames + 1),
        TemporalModule::Spatial(_) => Some(model.motion.as_ref()?.near.as_ref()?.neighbours()),
        TemporalModule::Average(_) | TemporalModule::Convolution(_) => None,
    }
}

/// Sums of a module's outputs.
struct Sums {
    /// Over the times at which each Gaussian is alive: `[N, H]`.
    outputs: Tensor<2>,
    /// Number of these times: `[N, 1]`.
    times: Tensor<2>,
    squares: f64,
    /// Sums over Gaussians and times: the share of positive hidden units, and how often there is none.
    positive: f64,
    none_positive: f64,
}

impl Sums {
    fn new(count: usize, like: &Tensor<2>) -> Self {
        let zeros = |columns| Tensor::zeros([count, columns], (&like.device(), like.dtype()));
        Self { outputs: zeros(like.dims()[1]), times: zeros(1), squares: 0.0, positive: 0.0, none_positive: 0.0 }
    }

    /// Adds what the module computes at a time for the Gaussians that are alive.
    fn add(&mut self, found: ModuleProbe, alive: Option<&AliveRows>) -> Result<(), ModelError> {
        let among_all = |values: Tensor<2>| match alive {
            Some(alive) => alive.among_all(values),
            None => values,
        };
        let ModuleProbe { output, hidden } = found;
        let ones = Tensor::ones([output.dims()[0], 1], (&output.device(), output.dtype()));
        self.times = self.times.clone() + among_all(ones);
        self.squares += sum_of_squares(&output)?;
        self.outputs = self.outputs.clone() + among_all(output);

        let shares = hidden.greater_elem(0.0).float().mean_dim(1);
        let none = shares.clone().equal_elem(0.0).float();
        let sums: Vec<f64> = tensors::read(Tensor::cat(vec![shares.sum(), none.sum()], 0))?;
        self.positive += sums[0];
        self.none_positive += sums[1];
        Ok(())
    }

    /// The figures for a base feature with this sum of squares, and the means over everything and over times.
    fn finish(self, base: f64) -> Result<(ModuleFigures, [Tensor<2>; 2]), ModelError> {
        let total: Vec<f64> = tensors::read(self.times.clone().sum())?;
        let of_all = self.outputs.clone().sum_dim(0) / total[0].max(1.0);
        // A Gaussian that was alive at none of the times has the mean of all.
        let never = self.times.clone().equal_elem(0.0).float();
        let of_each = self.outputs / self.times.clone().clamp_min(1.0) + never * of_all.clone();
        let constant = total[0] * sum_of_squares(&of_all)?;
        let apart = (of_each.clone() - of_all.clone()).square().sum_dim(1) * self.times;
        let apart: Vec<f64> = tensors::read(apart.sum())?;
        let share = |part: f64| if self.squares > 0.0 { part / self.squares } else { 0.0 };
        let [constant, over_gaussians] = [constant, apart[0]].map(share);
        let figures = ModuleFigures {
            norm: if base > 0.0 { (self.squares / base).sqrt() } else { 0.0 },
            constant,
            over_gaussians,
            // What remains, but for rounding.
            over_time: if self.squares > 0.0 { (1.0 - constant - over_gaussians).max(0.0) } else { 0.0 },
            active: Some(self.positive / total[0].max(1.0)),
            silent: Some(self.none_positive / total[0].max(1.0)),
        };
        Ok((figures, [of_all, of_each]))
    }
}

fn sum_of_squares(values: &Tensor<2>) -> Result<f64, ModelError> {
    let sum: Vec<f64> = tensors::read(values.clone().square().sum())?;
    Ok(sum[0])
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::test_support::{for_each_device, values};

    #[test]
    fn the_parts_of_an_output_add_up() {
        for_each_device(|device| {
            let moment = |rows: [[f32; 1]; 2]| Tensor::<2>::from_data(rows, &device);
            // The first Gaussian has 5 and 7, the second 1 and 3: mean 4, Gaussians 2 apart from it, times 1.
            let outputs = [moment([[5.0], [1.0]]), moment([[7.0], [3.0]])];
            let mut sums = Sums::new(2, &outputs[0]);
            // One unit of the first Gaussian is positive once.
            for (output, first) in outputs.into_iter().zip([1.0, 0.0]) {
                let hidden = Tensor::<2>::from_data([[first, -1.0], [-1.0, -2.0f32]], &device);
                sums.add(ModuleProbe { output, hidden }, None).expect("the device answers");
            }
            let (figures, [of_all, of_each]) = sums.finish(21.0).expect("the device answers");
            let squares = 25.0 + 49.0 + 1.0 + 9.0;
            let expected = [64.0 / squares, 16.0 / squares, 4.0 / squares, 2.0];
            let found = [figures.constant, figures.over_gaussians, figures.over_time, figures.norm];
            assert!(found.iter().zip(expected).all(|(a, b)| (a - b).abs() < 1e-6), "{found:?}, not {expected:?}");
            assert_eq!((figures.active, figures.silent), (Some(0.125), Some(0.75)));
            assert_eq!((values(of_all), values(of_each)), (vec![4.0], vec![6.0, 2.0]));
        });
    }
}
