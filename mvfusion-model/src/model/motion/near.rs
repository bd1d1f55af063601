//! The nearest other Gaussians of each one, for attention in space.

use burn::tensor::{Int, Tensor};
use glam::Vec3;

use super::cache::at_knots;
use crate::initial::nearest_others;
use crate::model::rows::{PerGaussian, RowMap};
use crate::timeline::Between;
use crate::{ModelError, tensors};

/// What MFTA reads of the `K` nearest other Gaussians of each one, as last measured. Without gradient.
#[derive(Clone, Debug)]
pub struct Near {
    /// Their canonical centres: `[N, 3 K]`.
    pub means: Tensor<2>,
    /// Their normalised local variances at the knots, one Gaussian after the other: `[N, K knots]`.
    pub local: Tensor<2>,
}

impl Near {
    /// The `neighbours` nearest others of canonical centres `[N, 3]`, which have local variances `[N, knots]`.
    ///
    /// # Errors
    /// If the device fails to return values.
    pub fn of(means: &Tensor<2>, local: &Tensor<2>, neighbours: usize) -> Result<Self, ModelError> {
        let centres: Vec<f32> = tensors::read(means.clone())?;
        let centres: Vec<Vec3> = centres.chunks_exact(3).map(Vec3::from_slice).collect();
        let rows = tensors::rows_like(&nearest_others(&centres, neighbours), means);
        let [count, knots] = local.dims();
        Ok(Self {
            means: means.clone().select(0, rows.clone()).reshape([count, 3 * neighbours]),
            local: local.clone().select(0, rows).reshape([count, neighbours * knots]),
        })
    }

    /// Number of neighbours.
    pub fn neighbours(&self) -> usize {
        self.means.dims()[1] / 3
    }

    /// Their local intensities at a time between knots: `[N, K]`.
    pub(super) fn local_at(&self, place: Between) -> Tensor<2> {
        let [count, columns] = self.local.dims();
        let neighbours = self.neighbours();
        let local = self.local.clone().reshape([count, neighbours, columns / neighbours]);
        at_knots(place, |index| local.clone().narrow(2, index, 1).squeeze_dim::<2>(2))
    }

    /// Their positions relative to centres `[N, 3]`, in mean distances of the neighbours: `[N, K, 3]`.
    pub(super) fn distances(&self, means: Tensor<2>) -> Tensor<3> {
        let (count, neighbours) = (means.dims()[0], self.neighbours());
        let apart = self.means.clone().reshape([count, neighbours, 3]) - means.unsqueeze_dim(1);
        let mean = apart.clone().square().sum_dim(2).sqrt().mean_dim(1);
        // Gaussians that coincide are at distance 0 in any unit.
        apart / mean.clamp_min(f32::MIN_POSITIVE)
    }

    /// The rows of several, one after the other.
    pub(super) fn joined(parts: &[&Self]) -> Self {
        let cat = |of: fn(&Self) -> &Tensor<2>| Tensor::cat(parts.iter().map(|part| of(part).clone()).collect(), 0);
        Self { means: cat(|near| &near.means), local: cat(|near| &near.local) }
    }

    /// The rows of the given Gaussians, in that order.
    pub(super) fn select(self, rows: &Tensor<1, Int>) -> Self {
        Self { means: self.means.select(0, rows.clone()), local: self.local.select(0, rows.clone()) }
    }
}

impl PerGaussian for Near {
    /// A new Gaussian has the neighbours of its parent. Without a parent, its neighbours are at the origin until it is
    /// measured.
    fn follow(&mut self, map: &RowMap) {
        let Self { means, local } = self;
        *means = map.inherit(means);
        *local = map.inherit(local);
    }
}

#[cfg(test)]
mod tests {
    use burn::tensor::{DType, Device, TensorData};

    use super::*;
    use crate::test_support::{for_each_device, values};
    use crate::timeline::between;

    fn matrix(values: &[f64], columns: usize, device: &Device) -> Tensor<2> {
        let data = TensorData::new(values.to_vec(), [values.len() / columns, columns]);
        Tensor::from_data(data, (device, DType::F32))
    }

    #[test]
    fn each_gaussian_knows_its_nearest_others() {
        for_each_device(|device| {
            let means = matrix(&[0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 3.0, 0.0, 0.0, 7.0, 0.0, 0.0], 3, &device);
            let local = matrix(&[0.0, 10.0, 1.0, 11.0, 2.0, 12.0, 3.0, 13.0], 2, &device);
            let near = Near::of(&means, &local, 2).expect("the device answers");
            assert_eq!(near.neighbours(), 2);
            let found = values(near.local_at(between(&[0.0, 1.0], 0.5)));
            assert_eq!(found, [6.0, 7.0, 5.0, 7.0, 6.0, 5.0, 7.0, 6.0]);
            let distances = values(near.distances(means).narrow(2, 0, 1).squeeze_dim::<2>(2));
            assert_eq!(distances[..4], [0.5, 1.5, -2.0 / 3.0, 4.0 / 3.0].map(|d: f64| f64::from(d as f32)));
        });
    }
}
