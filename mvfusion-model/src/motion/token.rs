//! Temporal tokens: what one Gaussian does at one time (METHOD A13, A17, A18).

use burn::tensor::{Tensor, activation::relu};

use crate::network::DeformationNetwork;
use crate::tensors;

/// Numbers of a token beside feature and intensity: displacement, log-scale and quaternion offsets (A13).
pub const GEOMETRY_WIDTH: usize = 10;

/// Makes tokens `z = [h, geometry(h), e]`, each `[N, H + 11]`; with gradient if network and centres have it.
#[derive(Clone, Debug)]
pub(super) struct Tokens<'a> {
    /// The network, without autodiff unless gradients are wanted.
    pub network: &'a DeformationNetwork,
    /// The scene's extent; displacements are divided by it.
    pub extent: f64,
    /// Gaussians handled at once.
    pub chunk: usize,
}

impl Tokens<'_> {
    /// The tokens of canonical centres `[N, 3]` at a time, with the local intensities `[N, 1]` of that time.
    pub fn at(&self, means: &Tensor<2>, time: f64, local: Tensor<2>) -> Tensor<2> {
        let count = means.dims()[0];
        let step = self.chunk.max(1);
        let chunks: Vec<Tensor<2>> = (0..count)
            .step_by(step)
            .map(|first| {
                let length = step.min(count - first);
                let part = means.clone().narrow(0, first, length);
                let feature = self.network.feature(part, tensors::scalar_like(means, time));
                let rest = self.tail(feature.clone(), local.clone().narrow(0, first, length));
                Tensor::cat(vec![feature, rest], 1)
            })
            .collect();
        Tensor::cat(chunks, 0)
    }

    /// The part of the token after the feature `[N, H]`: geometry and intensity, `[N, 11]`.
    pub fn tail(&self, feature: Tensor<2>, local: Tensor<2>) -> Tensor<2> {
        let rectified = relu(feature);
        let heads = &self.network.heads;
        let displacement = heads.means.forward(rectified.clone()) / self.extent;
        let log_scales = heads.log_scales.forward(rectified.clone());
        Tensor::cat(vec![displacement, log_scales, heads.quaternions.forward(rectified), local], 1)
    }
}
