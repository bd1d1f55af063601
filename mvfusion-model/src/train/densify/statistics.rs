//! Statistics of each Gaussian since rows were last added.

use burn::tensor::Tensor;

use crate::model::rows::{PerGaussian, RowMap};

/// Sums over the views of many steps, `[N, 1]` each, on the device and without autodiff.
#[derive(Clone, Debug)]
pub struct DensifyStatistics {
    /// Sum of the norms of the screen-space gradients.
    pub gradients: Tensor<2>,
    /// Number of steps in which the Gaussian was visible.
    pub seen: Tensor<2>,
    /// Highest foreground probability while visible (dynamic branch; METHOD §4.7).
    pub foreground: Tensor<2>,
    /// Largest radius on the screen since rows were last added, in pixels.
    pub radii: Tensor<2>,
}

impl DensifyStatistics {
    /// Names of the fields in files.
    pub(in crate::train) const NAMES: [&'static str; 4] = ["gradients", "seen", "foreground", "radii"];

    /// The fields with their names.
    pub(in crate::train) fn named(&self) -> impl Iterator<Item = (&'static str, &Tensor<2>)> {
        let Self { gradients, seen, foreground, radii } = self;
        Self::NAMES.into_iter().zip([gradients, seen, foreground, radii])
    }

    /// The statistics whose fields are read by their names.
    pub(in crate::train) fn from_named<E>(read: impl Fn(&str) -> Result<Tensor<2>, E>) -> Result<Self, E> {
        let [gradients, seen, foreground, radii] = Self::NAMES;
        Ok(Self { gradients: read(gradients)?, seen: read(seen)?, foreground: read(foreground)?, radii: read(radii)? })
    }

    /// Empty statistics of the Gaussians with these centres `[N, 3]`.
    pub fn new(means: &Tensor<2>) -> Self {
        let zeros = Tensor::zeros([means.dims()[0], 1], (&means.device().inner(), means.dtype()));
        Self { gradients: zeros.clone(), seen: zeros.clone(), foreground: zeros.clone(), radii: zeros }
    }

    /// Adds one step: the gradient of the main loss with respect to the projected centres, summed over the batch
    /// (`[N, 2]`, NDC), and 1 for Gaussians visible in any view, 0 for the others (`[N, 1]`).
    pub fn record(&mut self, gradient: Tensor<2>, visible: Tensor<2>) {
        let norm = gradient.powf_scalar(2.0).sum_dim(1).sqrt();
        self.gradients = self.gradients.clone() + norm * visible.clone();
        self.seen = self.seen.clone() + visible;
    }

    /// Adds the foreground probabilities `[N, 1]` of the visible Gaussians.
    pub fn record_foreground(&mut self, probability: Tensor<2>, visible: Tensor<2>) {
        self.foreground = self.foreground.clone().max_pair(probability * visible);
    }

    /// Adds the largest radii `[N, 1]` of a batch.
    pub fn record_radii(&mut self, radii: Tensor<2>) {
        self.radii = self.radii.clone().max_pair(radii);
    }

    /// Mean norm of the gradient per visible step; 0 if never visible.
    pub fn mean_gradients(&self) -> Tensor<2> {
        // The sum is 0 if never visible, so any divisor works.
        self.gradients.clone() / self.seen.clone().clamp_min(1.0)
    }

    /// Resets gradients and radii after rows were added; foreground probabilities stay.
    pub fn restart_gradients(&mut self) {
        let zeros = self.foreground.zeros_like();
        (self.gradients, self.seen, self.radii) = (zeros.clone(), zeros.clone(), zeros);
    }
}

impl PerGaussian for DensifyStatistics {
    /// A new Gaussian inherits only its parent's foreground probability.
    fn follow(&mut self, map: &RowMap) {
        let Self { gradients, seen, foreground, radii } = self;
        for values in [gradients, seen, radii] {
            *values = map.keep(values);
        }
        *foreground = map.inherit(foreground);
    }
}
