//! Temporal tokens: the state of one Gaussian at one time (METHOD A13, A17, A18).

use burn::tensor::{Tensor, TensorData};

use crate::config::{MotionConfig, Temporal, TokenOffset};
use crate::model::network::DeformationNetwork;
use crate::tensors::{self, some_rows};

/// Values of a token besides feature and intensity: displacement, log-scale and quaternion offsets (A13).
pub const GEOMETRY_WIDTH: usize = 10;

/// Width `T` of the tokens for features of `feature_width`.
pub(crate) fn token_width(feature_width: usize, config: &MotionConfig) -> usize {
    let distances = if config.temporal == Temporal::Spatial { 3 } else { 1 };
    let offset = match config.token_offset {
        TokenOffset::Absent => 0,
        TokenOffset::Signed => distances,
        TokenOffset::Sines => distances * (1 + 2 * config.octaves),
    };
    feature_width + GEOMETRY_WIDTH + 1 + offset
}

/// Computes tokens `z = [h, geometry(h), e]` of width `H + 11`; with gradients if network and centres have them.
#[derive(Clone, Debug)]
pub(super) struct TokenMaker<'a> {
    /// The network, without autodiff unless gradients are wanted.
    pub network: &'a DeformationNetwork,
    /// The scene's extent; displacements are divided by it.
    pub extent: f64,
    /// Gaussians per chunk, each with all its tokens.
    pub chunk: usize,
}

impl TokenMaker<'_> {
    /// The tokens `[N, K, H + 11]` of canonical centres `[N, 3]` at `K` times, `[N, K]` or `[1, K]`, with their local
    /// intensities `[N, K]`.
    pub fn at(&self, means: &Tensor<2>, times: &Tensor<2>, local: Tensor<2>) -> Tensor<3> {
        let [rows, keys] = times.dims();
        // One Gaussian at all times, then the next: the order of attention, and close together in the planes.
        let tokens = |first, length| {
            let points = some_rows(means, first, length).repeat(&[1, keys]).reshape([length * keys, 3]);
            let times = if rows == 1 { times.clone().repeat(&[length, 1]) } else { some_rows(times, first, length) };
            (points, times.reshape([length * keys, 1]))
        };
        self.in_chunks(tokens, local)
    }

    /// The tokens `[N, K, H + 11]` of the centres `[N, 3 K]` of others at the same time, `[N, 1]` or `[1, 1]`, with their
    /// local intensities `[N, K]`.
    pub fn of_others(&self, means: &Tensor<2>, times: &Tensor<2>, local: Tensor<2>) -> Tensor<3> {
        let keys = local.dims()[1];
        let tokens = |first, length| {
            let points = some_rows(means, first, length).reshape([length * keys, 3]);
            let times = match times.dims()[0] {
                1 => times.clone(),
                _ => some_rows(times, first, length).repeat(&[1, keys]).reshape([length * keys, 1]),
            };
            (points, times)
        };
        self.in_chunks(tokens, local)
    }

    /// The tokens of the points and times that `tokens` names for a range of Gaussians.
    fn in_chunks(&self, tokens: impl Fn(usize, usize) -> (Tensor<2>, Tensor<2>), local: Tensor<2>) -> Tensor<3> {
        let [count, keys] = local.dims();
        let step = tensors::rows_at_once(self.chunk, &local);
        let chunks: Vec<Tensor<3>> = (0..count)
            .step_by(step)
            .map(|first| {
                let length = step.min(count - first);
                let (points, times) = tokens(first, length);
                let feature = self.network.feature(points, times);
                let local = some_rows(&local, first, length).reshape([length * keys, 1]);
                let geometry = self.geometry(feature.clone());
                Tensor::cat(vec![feature, geometry, local], 1).reshape([length as i32, keys as i32, -1])
            })
            .collect();
        // A single chunk is not copied.
        <[Tensor<3>; 1]>::try_from(chunks).map_or_else(|chunks| Tensor::cat(chunks, 0), |[chunk]| chunk)
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
