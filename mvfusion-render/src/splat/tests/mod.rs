//! Tests of the op through Burn, on every CPU device of this build.

mod gradients;
mod hostile;
mod pictures;

use burn::tensor::{DType, Device, Int, Tensor, TensorData};
use glam::{DMat3, DVec3};
use mvfusion_data::Camera;

use super::*;
use crate::test_support::random;

/// The values of a scene, for tensors of any precision.
#[derive(Clone)]
pub(super) struct Scene {
    pub count: usize,
    pub means: Vec<f64>,
    pub quaternions: Vec<f64>,
    pub log_scales: Vec<f64>,
    pub opacity_logits: Vec<f64>,
    /// Degree 2 and a surplus row, as in METHOD's storage.
    pub sh: Vec<f64>,
    pub features: Vec<f64>,
    pub background: Vec<f64>,
}

/// Rows of coefficients of a [`Scene`].
pub(super) const SH_ROWS: usize = 10;
/// Features of a [`Scene`].
pub(super) const FEATURES: usize = 2;

impl Scene {
    /// Gaussians in front of [`camera`], well beyond the near plane and in or around the image.
    pub fn random(seed: u64, count: usize) -> Self {
        let scaled = |salt: u64, len: usize, low: f64, high: f64| -> Vec<f64> {
            random(seed * 100 + salt, len).into_iter().map(|u| low + (high - low) * u).collect()
        };
        let mut means = scaled(1, 3 * count, -1.2, 1.2);
        means.chunks_mut(3).for_each(|mean| mean[2] += 3.0);
        Self {
            count,
            means,
            quaternions: scaled(2, 4 * count, -1.0, 1.0),
            log_scales: scaled(3, 3 * count, -3.0, -1.2),
            opacity_logits: scaled(4, count, -2.0, 2.0),
            sh: scaled(5, 3 * SH_ROWS * count, -0.4, 0.4),
            features: scaled(6, FEATURES * count, 0.0, 1.0),
            background: scaled(7, 3 + FEATURES, 0.1, 0.9),
        }
    }

    /// The scene as tensors.
    pub fn inputs(&self, device: &Device, dtype: DType) -> SplatInputs {
        let n = self.count;
        SplatInputs {
            means: tensor(&self.means, [n, 3], device, dtype),
            quaternions: tensor(&self.quaternions, [n, 4], device, dtype),
            log_scales: tensor(&self.log_scales, [n, 3], device, dtype),
            opacity_logits: tensor(&self.opacity_logits, [n], device, dtype),
            sh: tensor(&self.sh, [n, SH_ROWS, 3], device, dtype),
            features: Some(tensor(&self.features, [n, FEATURES], device, dtype)),
            background: tensor(&self.background, [3 + FEATURES], device, dtype),
        }
    }
}

pub(super) fn tensor<const D: usize>(values: &[f64], shape: [usize; D], device: &Device, dtype: DType) -> Tensor<D> {
    Tensor::from_data(TensorData::new(values.to_vec(), shape).convert_dtype(dtype), (device, dtype))
}

/// A camera near the origin that looks along +z. Neither side is a multiple of the tile's.
pub(super) fn camera() -> Camera {
    let turn = DMat3::from_axis_angle(DVec3::new(0.3, 1.0, 0.2).normalize(), 0.1);
    Camera { cx: 20.3, cy: 13.1, ..Camera::centred(37, 29, 34.0, turn, DVec3::new(-0.2, 0.1, 0.05)) }
}

pub(super) fn settings(rules: SplatRules) -> SplatSettings {
    SplatSettings { rules, sh_degree: 2, statistic: Statistic::ColourAndDepth }
}

pub(super) fn indices(tensor: Tensor<1, Int>) -> Vec<i64> {
    tensor.into_data().iter::<i64>().collect()
}

/// All rule sets under test.
pub(super) fn rule_sets() -> [SplatRules; 3] {
    let antialiased = SplatRules { antialias: Antialias::Compensated, alpha_clamp: 0.999, ..SplatRules::gsplat() };
    [SplatRules::inria(), SplatRules::gsplat(), antialiased]
}
