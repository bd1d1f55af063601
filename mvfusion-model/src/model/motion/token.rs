//! Temporal tokens: the state of one Gaussian at one time (METHOD A13, A17, A18).

use burn::tensor::{Tensor, TensorData};

use crate::model::network::DeformationNetwork;
use crate::tensors;

/// Values of a token besides feature and intensity: displacement, log-scale and quaternion offsets (A13).
pub const GEOMETRY_WIDTH: usize = 10;

/// Width `T` of the tokens for features of `feature_width`.
pub(super) fn token_width(feature_width: usize) -> usize {
    feature_width + GEOMETRY_WIDTH + 1
}

/// Computes tokens `z = [h, geometry(h), e]` of width `H + 11`; with gradients if network and centres have them.
#[derive(Clone, Debug)]
pub(super) struct TokenMaker<'a> {
    /// The network, without autodiff unless gradients are wanted.
    pub network: &'a DeformationNetwork,
    /// The scene's extent; displacements are divided by it.
    pub extent: f64,
    /// Gaussians per chunk, each at all times.
    pub chunk: usize,
}

impl TokenMaker<'_> {
    /// The tokens `[N, K, H + 11]` of canonical centres `[N, 3]` at `K` times, with their local intensities `[N, K]`.
    pub fn at(&self, means: &Tensor<2>, times: &[f64], local: Tensor<2>) -> Tensor<3> {
        let count = means.dims()[0];
        let keys = times.len();
        let times: Tensor<2> = tensors::from_data_like(TensorData::new(times.to_vec(), [keys, 1]), means);
        let step = self.chunk.max(1);
        let chunks: Vec<Tensor<3>> = (0..count)
            .step_by(step)
            .map(|first| {
                let length = step.min(count - first);
                // One Gaussian at all times, then the next: the order of attention, and close together in the planes.
                let points = means.clone().narrow(0, first, length).repeat(&[1, keys]).reshape([length * keys, 3]);
                let feature = self.network.feature(points, times.clone().repeat(&[length, 1]));
                let local = local.clone().narrow(0, first, length).reshape([length * keys, 1]);
                let geometry = self.geometry(feature.clone());
                Tensor::cat(vec![feature, geometry, local], 1).reshape([length as i32, keys as i32, -1])
            })
            .collect();
        Tensor::cat(chunks, 0)
    }

    /// The part of the token between feature and intensity: displacement over the extent, log-scale and quaternion
    /// offsets, `[N, 10]`.
    pub fn geometry(&self, feature: Tensor<2>) -> Tensor<2> {
        let mut units = vec![1.0; GEOMETRY_WIDTH];
        units[..3].fill(self.extent);
        let units: Tensor<2> = tensors::from_data_like(TensorData::new(units, [1, GEOMETRY_WIDTH]), &feature);
        self.network.heads.geometry(feature) / units
    }
}
