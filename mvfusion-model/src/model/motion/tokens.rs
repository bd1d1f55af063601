//! The tokens that MFTA combines: the current one, and those around it in time or in space.

use burn::tensor::Tensor;

use super::encoder::sinusoidal;
use super::token::GEOMETRY_WIDTH;
use crate::config::TokenOffset;

/// The tokens of `N` Gaussians at one time.
#[derive(Clone, Debug)]
pub struct Tokens {
    /// Current token: `[N, T]`.
    pub centre: Tensor<2>,
    /// Tokens around it: `[N, K, T]`. Those of frames are in time order, as many before as after the current one.
    pub around: Tensor<3>,
    /// Tokens that values are projected from, `[N, K, T]`; those of `around` if absent.
    pub values: Option<Tensor<3>>,
}

impl Tokens {
    /// Tokens whose values are projected from the same tokens as their keys.
    pub fn new(centre: Tensor<2>, around: Tensor<3>) -> Self {
        Self { centre, around, values: None }
    }

    /// All tokens, the current one in the middle: `[N, K + 1, T]`.
    pub fn in_time_order(self) -> Tensor<3> {
        let half = self.around.dims()[1] / 2;
        let before = self.around.clone().narrow(1, 0, half);
        let after = self.around.narrow(1, half, half);
        Tensor::cat(vec![before, self.centre.unsqueeze_dim(1), after], 1)
    }

    /// Every token changed in the same way.
    pub(super) fn map(self, change: impl Fn(Tensor<2>) -> Tensor<2>) -> Self {
        let rows = |tokens: Tensor<3>| {
            let [count, keys, width] = tokens.dims();
            change(tokens.reshape([count * keys, width])).reshape([count as i32, keys as i32, -1])
        };
        Self { centre: change(self.centre), around: rows(self.around), values: self.values.map(rows) }
    }

    /// The tokens with their signed distances from the current one, `[N or 1, K, D]`, which is at distance 0.
    pub(super) fn at_distances(self, distances: Tensor<3>, offset: TokenOffset, octaves: usize) -> Self {
        let code = |distances: Tensor<2>| match offset {
            TokenOffset::Absent | TokenOffset::Signed => distances,
            TokenOffset::Sines => sinusoidal(distances, octaves),
        };
        if offset == TokenOffset::Absent {
            return self;
        }
        let count = self.centre.dims()[0];
        let [rows, keys, axes] = distances.dims();
        let zeros = Tensor::zeros([1, axes], (&distances.device(), distances.dtype()));
        let current = code(zeros).repeat(&[count, 1]);
        let codes = code(distances.reshape([rows * keys, axes])).reshape([rows as i32, keys as i32, -1]);
        let codes: Tensor<3> = if rows == count { codes } else { codes.repeat(&[count, 1, 1]) };
        let with = |tokens: Tensor<3>| Tensor::cat(vec![tokens, codes.clone()], 2);
        Self {
            centre: Tensor::cat(vec![self.centre, current], 1),
            around: with(self.around),
            values: self.values.map(with),
        }
    }

    /// The tokens with values that have, instead of a neighbour's geometry, its difference from the current `geometry`
    /// `[N, 10]` over its signed distance in time, `[N or 1, K, 1]`. A neighbour at distance 0, beyond the ends of the
    /// video, has no difference. Before [`Tokens::at_distances`].
    pub(super) fn with_velocities(self, geometry: Tensor<2>, distances: Tensor<3>) -> Self {
        let width = self.around.dims()[2];
        let first = width - GEOMETRY_WIDTH - 1;
        let inverse = distances.clone().recip().mask_fill(distances.equal_elem(0.0), 0.0);
        let part = |first, length| self.around.clone().narrow(2, first, length);
        let velocity = (part(first, GEOMETRY_WIDTH) - geometry.unsqueeze_dim(1)) * inverse;
        let values = Tensor::cat(vec![part(0, first), velocity, part(width - 1, 1)], 2);
        Self { values: Some(values), ..self }
    }
}

#[cfg(test)]
mod tests {
    use burn::tensor::{DType, Device, TensorData};

    use super::*;
    use crate::test_support::{for_each_device, values};

    /// Feature width of the tokens.
    const FEATURE: usize = 2;

    /// Tokens of two Gaussians before and after, whose geometry changes by 3 a frame, with numbers in the other columns.
    fn tokens(device: &Device) -> (Tokens, Tensor<2>) {
        let token = |frame: f64| [vec![frame; FEATURE], vec![5.0 + 3.0 * frame; GEOMETRY_WIDTH], vec![9.0]].concat();
        let width = FEATURE + GEOMETRY_WIDTH + 1;
        let data = |values: Vec<f64>| TensorData::new(values, [2, 2, width]);
        let around = Tensor::from_data(data([token(-1.0), token(1.0)].concat().repeat(2)), (device, DType::F32));
        let centre = Tensor::from_data(TensorData::new(token(0.0).repeat(2), [2, width]), (device, DType::F32));
        let geometry = centre.clone().narrow(1, FEATURE, GEOMETRY_WIDTH);
        (Tokens::new(centre, around), geometry)
    }

    #[test]
    fn velocities_are_the_same_before_and_after_a_uniform_motion() {
        for_each_device(|device| {
            let (tokens, geometry) = tokens(&device);
            let found = |distances: [f32; 2]| {
                let distances = Tensor::<1>::from_floats(distances, &device).reshape([1, 2, 1]);
                let tokens = tokens.clone().with_velocities(geometry.clone(), distances);
                let geometry = tokens.values.expect("they have values").narrow(2, FEATURE, GEOMETRY_WIDTH);
                values(geometry.slice([0..1, 0..2, 0..1]).reshape([1, 2]))
            };
            assert_eq!(found([-1.0, 1.0]), [3.0, 3.0]);
            // Beyond the end, the neighbour is the current frame.
            assert_eq!(found([-1.0, 0.0]), [3.0, 0.0]);
        });
    }

    #[test]
    fn a_distance_tells_before_from_after() {
        for_each_device(|device| {
            let distances = || Tensor::<3>::from_data([[[-1.0f32], [1.0]]], &device);
            let (plain, _) = tokens(&device);
            let width = plain.centre.dims()[1];
            for (offset, octaves, columns) in [(TokenOffset::Signed, 2, 1), (TokenOffset::Sines, 2, 5)] {
                let found = plain.clone().at_distances(distances(), offset, octaves);
                assert_eq!((found.centre.dims(), found.around.dims()), ([2, width + columns], [2, 2, width + columns]));
                let code = found.around.slice([1..2, 0..2, width..width + 1]).reshape([1, 2]);
                assert_eq!(values(code), [-1.0, 1.0]);
                assert_eq!(values(found.centre.narrow(1, width, 1)), [0.0, 0.0]);
            }
            let same = plain.clone().at_distances(distances(), TokenOffset::Absent, 2);
            assert_eq!(same.around.dims(), plain.around.dims());
        });
    }
}
