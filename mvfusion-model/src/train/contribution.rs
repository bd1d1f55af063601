//! What steps have to say about a branch before its optimiser moves.

use burn::tensor::{Gradients, Tensor};

use super::step::Sighting;
use crate::densify::Branch;
use crate::optim::GaussianGradients;

/// What one step, or several in a row, saw of a branch and want to change in it. Without autodiff.
#[derive(Clone, Debug)]
pub struct Contribution {
    /// What was seen.
    pub(super) sighting: Sighting,
    /// Gradient of the main loss with respect to the projected centres, NDC, summed over all views: `[N, 2]`.
    pub(super) screen: Option<Tensor<2>>,
    /// Gradients of the attributes.
    pub(super) gradients: GaussianGradients,
}

impl Contribution {
    /// Takes a branch's part out of the gradients of a step.
    pub(super) fn take(branch: &Branch, sighting: Sighting, probe: Tensor<2>, gradients: &mut Gradients) -> Self {
        Self {
            sighting,
            screen: probe.grad_remove(gradients),
            gradients: GaussianGradients::take(&branch.gaussians, gradients),
        }
    }

    /// This and what a later step adds: gradients are summed, a Gaussian counts as seen if either saw it, radii are those
    /// of the later step (METHOD §4.3).
    pub(super) fn and(self, later: Self) -> Self {
        let both =
            |a: Option<Tensor<2>>, b: Option<Tensor<2>>, join: fn(Tensor<2>, Tensor<2>) -> Tensor<2>| match (a, b) {
                (Some(a), Some(b)) => Some(join(a, b)),
                (a, b) => a.or(b),
            };
        Self {
            sighting: Sighting {
                visible: self.sighting.visible.max_pair(later.sighting.visible),
                foreground: both(self.sighting.foreground, later.sighting.foreground, Tensor::max_pair),
                radii: later.sighting.radii,
            },
            screen: both(self.screen, later.screen, |a, b| a + b),
            gradients: self.gradients.plus(later.gradients),
        }
    }
}
