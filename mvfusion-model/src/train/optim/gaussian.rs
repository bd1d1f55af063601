//! Adam for Gaussians, whose rows are added, removed and reordered during training.

use std::collections::BTreeMap;

use burn::tensor::{Gradients, Tensor};
use mvfusion_render::optim::{AdamMoments, AdamRule, AdamStep, Stepped, adam_steps};

use super::GaussianRates;
use crate::config::OptimConfig;
use crate::model::gaussians::{Attribute, Gaussians};
use crate::model::rows::{PerGaussian, RowMap};

/// Moments of a branch's attributes; they are created at an attribute's first step.
#[derive(Clone, Debug, Default)]
pub struct GaussianOptimiser {
    /// First and second moments, without autodiff, with one row per Gaussian.
    pub moments: BTreeMap<Attribute, AdamMoments<2>>,
}

/// The gradients of a branch's attributes, without autodiff. Attributes without influence on the loss are absent.
#[derive(Clone, Debug, Default)]
pub struct GaussianGradients(BTreeMap<Attribute, Tensor<2>>);

impl FromIterator<(Attribute, Tensor<2>)> for GaussianGradients {
    fn from_iter<I: IntoIterator<Item = (Attribute, Tensor<2>)>>(gradients: I) -> Self {
        Self(gradients.into_iter().collect())
    }
}

impl GaussianGradients {
    /// Extracts a branch's gradients from those of a backward pass.
    pub fn take(gaussians: &Gaussians, gradients: &mut Gradients) -> Self {
        let of = |attribute: Attribute| {
            let gradient = gaussians.attribute(attribute)?.val().grad_remove(gradients)?;
            Some((attribute, gradient))
        };
        Self(Attribute::ALL.into_iter().filter_map(of).collect())
    }

    /// The gradient of an attribute.
    pub fn of(&self, attribute: Attribute) -> Option<&Tensor<2>> {
        self.0.get(&attribute)
    }

    /// The sum of two gradients.
    pub fn plus(mut self, other: Self) -> Self {
        for (attribute, gradient) in other.0 {
            let sum = match self.0.remove(&attribute) {
                Some(own) => own + gradient,
                None => gradient,
            };
            self.0.insert(attribute, sum);
        }
        self
    }

    /// The gradients of the Gaussians that stay; new ones have none.
    pub fn keep(&mut self, map: &RowMap) {
        self.0.values_mut().for_each(|gradient| *gradient = map.keep(gradient));
    }

    /// Drops the gradient of an attribute whose values were replaced after the backward pass.
    pub fn forget(&mut self, attribute: Attribute) {
        self.0.remove(&attribute);
    }
}

impl PerGaussian for GaussianGradients {
    /// After a row change, the current step updates no attribute (METHOD §4.1).
    fn follow(&mut self, _map: &RowMap) {
        self.0.clear();
    }
}

impl PerGaussian for GaussianOptimiser {
    /// New Gaussians start without moments.
    fn follow(&mut self, map: &RowMap) {
        for AdamMoments { first, second, steps: _ } in self.moments.values_mut() {
            *first = map.keep(first);
            *second = map.keep(second);
        }
    }
}

impl GaussianOptimiser {
    /// One Adam step for every attribute that has a gradient.
    pub fn step(
        &mut self,
        gaussians: &mut Gaussians,
        gradients: GaussianGradients,
        rates: &GaussianRates,
        config: &OptimConfig,
    ) {
        let take = |(attribute, gradient): (Attribute, Tensor<2>)| {
            let value = gaussians.take(attribute)?;
            let moments = self.moments.remove(&attribute).unwrap_or_else(|| fresh(&value));
            Some((attribute, AdamStep { value, gradient, moments, rule: rule(rates.of(attribute), config) }))
        };
        let (attributes, steps): (Vec<Attribute>, Vec<_>) = gradients.0.into_iter().filter_map(take).unzip();
        for (attribute, Stepped { value, moments }) in attributes.into_iter().zip(adam_steps(steps)) {
            gaussians.replace(attribute, value);
            self.moments.insert(attribute, moments);
        }
    }

    /// Sets the moments of an attribute to zero; its step count stays (METHOD §4.11).
    pub fn reset(&mut self, attribute: Attribute) {
        if let Some(moments) = self.moments.get_mut(&attribute) {
            moments.first = moments.first.zeros_like();
            moments.second = moments.second.zeros_like();
        }
    }
}

/// Moments of a tensor before its first step.
pub(super) fn fresh<const D: usize>(values: &Tensor<D>) -> AdamMoments<D> {
    AdamMoments { first: values.zeros_like(), second: values.zeros_like(), steps: 0 }
}

/// Adam's constants with the learning rate of a group.
pub(super) fn rule(learning_rate: f64, config: &OptimConfig) -> AdamRule {
    AdamRule { learning_rate, beta1: config.beta1, beta2: config.beta2, epsilon: config.epsilon }
}
