//! The gradients and visibility of a branch.

use burn::tensor::{Gradients, Tensor};

use super::Visibility;
use crate::model::gaussians::Gaussians;
use crate::model::rows::{PerGaussian, RowMap};
use crate::train::optim::GaussianGradients;

/// Gradients of a branch from one step, or summed over several, and its visibility. Without autodiff.
#[derive(Clone, Debug)]
pub struct BranchGradients {
    /// The visible Gaussians.
    pub visibility: Visibility,
    /// Gradient of the main loss with respect to the projected centres, NDC, summed over all views: `[N, 2]`.
    pub screen: Option<Tensor<2>>,
    /// Gradients of the attributes.
    pub attributes: GaussianGradients,
}

impl BranchGradients {
    /// Extracts a branch's part from the gradients of a step. `probe` is that of the renders, if they had one.
    pub fn take(
        gaussians: &Gaussians,
        visibility: Visibility,
        probe: Option<Tensor<2>>,
        gradients: &mut Gradients,
    ) -> Self {
        Self {
            visibility,
            screen: probe.and_then(|probe| probe.grad_remove(gradients)),
            attributes: GaussianGradients::take(gaussians, gradients),
        }
    }

    /// Accumulates a later step. Gradients are summed, a Gaussian is visible if it was in either step, and radii are
    /// those of the later step (METHOD §4.3).
    pub fn and(self, later: Self) -> Self {
        let both =
            |a: Option<Tensor<2>>, b: Option<Tensor<2>>, join: fn(Tensor<2>, Tensor<2>) -> Tensor<2>| match (a, b) {
                (Some(a), Some(b)) => Some(join(a, b)),
                (a, b) => a.or(b),
            };
        Self {
            visibility: Visibility {
                visible: self.visibility.visible.max_pair(later.visibility.visible),
                foreground: both(self.visibility.foreground, later.visibility.foreground, Tensor::max_pair),
                radii: later.visibility.radii,
            },
            screen: both(self.screen, later.screen, |a, b| a + b),
            attributes: self.attributes.plus(later.attributes),
        }
    }
}

impl PerGaussian for BranchGradients {
    /// Sums of Gaussians that stay are kept; new Gaussians count as never visible.
    fn follow(&mut self, map: &RowMap) {
        let Self { visibility: Visibility { visible, radii, foreground }, screen, attributes } = self;
        for values in [visible, radii].into_iter().chain(foreground).chain(screen) {
            *values = map.keep(values);
        }
        attributes.keep(map);
    }
}
