//! Quantises Gaussians, keyframe by keyframe.

use super::{Keyframes, Quantity, Track, UniformQuantizer};
use crate::{GaussianCloud, rest_width, sigmoid, unit_quaternion};

/// Weight of a transparent Gaussian's colours, so that one that is always transparent has a mean.
const LEAST_WEIGHT: f32 = 1e-6;

/// Collects the Gaussians of a branch at ascending times. All clouds have the same Gaussians in the same order.
#[derive(Clone, Debug)]
pub struct KeyframesBuilder {
    keyframes: Keyframes,
    /// The last quaternion of each Gaussian, normalised.
    last: Vec<[f64; 4]>,
    /// Sums of the higher colour coefficients times weights, and of the weights.
    sh_rest: Vec<f32>,
    weights: Vec<f32>,
}

impl KeyframesBuilder {
    /// A builder for Gaussians like those of `cloud`; whether they have masks is taken from it. `position_step` is the
    /// step of centres in world units.
    pub fn new(cloud: &GaussianCloud, position_step: f64) -> Self {
        let (count, sh_degree) = (cloud.len(), cloud.sh_degree);
        let has = |quantity: &Quantity| !quantity.is_mask() || cloud.mask_logits.is_some();
        let track = |quantity: Quantity| Track {
            quantity,
            quantizer: UniformQuantizer::of(quantity, position_step),
            columns: vec![Vec::new(); quantity.columns(sh_degree)],
        };
        let tracks = Quantity::ALL.into_iter().filter(has).map(track).collect();
        Self {
            keyframes: Keyframes { count, sh_degree, times: Vec::new(), tracks },
            last: vec![[1.0, 0.0, 0.0, 0.0]; count],
            sh_rest: vec![0.0; count * rest_width(sh_degree)],
            weights: vec![0.0; count],
        }
    }

    /// Adds the Gaussians at a time.
    ///
    /// # Panics
    /// If their number or degree is not that of the first ones.
    pub fn push(&mut self, time: f64, cloud: &GaussianCloud) {
        let Keyframes { count, sh_degree, .. } = self.keyframes;
        assert_eq!((cloud.len(), cloud.sh_degree), (count, sh_degree), "the Gaussians of all keyframes are the same");
        self.keyframes.times.push(time);
        for index in 0..count {
            self.last[index] = nearer(unit_quaternion(cloud.quaternions[index]), self.last[index]);
        }
        let last = &self.last;
        // Static, brightness, dynamic.
        let mask = |index: usize, channel: usize| {
            cloud.mask_logits.as_ref().map_or(0.0, |masks| sigmoid(masks[index][channel]))
        };
        for track in self.keyframes.tracks.iter_mut().filter(|track| track.quantity.moves()) {
            let (quantity, quantizer) = (track.quantity, track.quantizer);
            for (column, values) in track.columns.iter_mut().enumerate() {
                let value = |index: usize| match quantity {
                    Quantity::Mean => f64::from(cloud.means[index][column]),
                    Quantity::LogScale => f64::from(cloud.log_scales[index][column]),
                    Quantity::Rotation => last[index][column],
                    Quantity::Opacity => sigmoid(cloud.opacity_logits[index]),
                    Quantity::Mask => mask(index, 2 * column),
                    Quantity::Brightness => mask(index, 1),
                    Quantity::ShDc => f64::from(cloud.sh_dc[index][column]),
                    Quantity::ShRest => 0.0,
                };
                values.extend((0..count).map(|index| quantizer.quantise(value(index))));
            }
        }
        self.add_sh_rest(cloud);
    }

    fn add_sh_rest(&mut self, cloud: &GaussianCloud) {
        let width = rest_width(cloud.sh_degree);
        for index in 0..cloud.len() {
            let weight = sigmoid(cloud.opacity_logits[index]) as f32 + LEAST_WEIGHT;
            self.weights[index] += weight;
            let sums = &mut self.sh_rest[index * width..(index + 1) * width];
            sums.iter_mut().zip(cloud.rest(index)).for_each(|(sum, &value)| *sum += weight * value);
        }
    }

    /// The keyframes that were added.
    pub fn finish(self) -> Keyframes {
        let Self { mut keyframes, sh_rest, weights, .. } = self;
        let width = rest_width(keyframes.sh_degree);
        for track in keyframes.tracks.iter_mut().filter(|track| track.quantity == Quantity::ShRest) {
            let quantizer = track.quantizer;
            for (column, values) in track.columns.iter_mut().enumerate() {
                let mean = |(index, weight): (usize, &f32)| sh_rest[index * width + column] / weight;
                *values = weights.iter().enumerate().map(|row| quantizer.quantise(f64::from(mean(row)))).collect();
            }
        }
        keyframes
    }
}

/// The quaternion or its negative, which is the same rotation: the one on the side of `other`.
fn nearer(quaternion: [f64; 4], other: [f64; 4]) -> [f64; 4] {
    let product: f64 = quaternion.iter().zip(other).map(|(a, b)| a * b).sum();
    if product < 0.0 { quaternion.map(|part| -part) } else { quaternion }
}
