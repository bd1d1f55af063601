//! What motion layers show: a value per dynamic Gaussian.

use burn::tensor::{Tensor, TensorData};

use super::layer::Layer;
use super::tone::heat_picture;
use crate::config::FusionWeights;
use crate::model::motion::{AttributeSpread, Lifetimes, Trajectories};
use crate::model::{Model, RenderContext};
use crate::{ModelError, tensors};

/// Quantile over the dynamic Gaussians that is white in a motion layer.
const BRIGHTEST_QUANTILE: f64 = 0.98;
/// Features of a motion layer: the displayed value and the actual value.
pub(super) const HEAT_CHANNELS: usize = 2;

/// A value per dynamic Gaussian that a layer shows.
#[derive(Clone, Debug)]
pub(super) struct Heat {
    pub(super) layer: Layer,
    /// The value relative to the brightest: its root in `[0, 1]`, and itself: `[N, 2]`.
    pub(super) features: Tensor<2>,
    pub(super) brightest: f64,
}

/// The motion of a model's dynamic Gaussians, measured once for any number of renders in motion layers.
#[derive(Clone, Debug, Default)]
pub struct MotionLayers {
    pub(super) heats: Vec<Heat>,
}

impl MotionLayers {
    /// Measures the trajectories of a model for all motion layers. `weights` are the weights of the motion intensity.
    ///
    /// # Errors
    /// If the device fails.
    pub fn measure(model: &Model, context: &RenderContext, weights: FusionWeights) -> Result<Self, ModelError> {
        let lifetimes = Lifetimes::of(&model.dynamic, &context.motion)?;
        let trajectories = Trajectories {
            network: &model.network,
            timeline: &context.timeline,
            config: &context.motion,
            extent: context.extent,
            lifetimes: lifetimes.as_ref(),
        };
        let means = model.dynamic.means.val();
        let spreads = trajectories.measure(&means)?.spreads();
        let heat = |layer: Layer| {
            let number: fn(&AttributeSpread, FusionWeights) -> f64 = match layer {
                Layer::Motion => |spread, weights| spread.fused(weights),
                Layer::PositionVariance => |spread, _| spread.position,
                Layer::RotationVariance => |spread, _| spread.rotation,
                Layer::ScaleVariance => |spread, _| spread.scale,
                _ => return None,
            };
            Some(Heat::new(layer, spreads.iter().map(|spread| number(spread, weights)).collect(), &means))
        };
        Ok(Self { heats: Layer::ALL.into_iter().filter_map(heat).collect() })
    }

    /// The motion intensity of the last measurement in training; nothing before that.
    ///
    /// # Errors
    /// If the device fails.
    pub fn as_trained(model: &Model) -> Result<Self, ModelError> {
        let Some(cache) = &model.motion else { return Ok(Self::default()) };
        let intensity = cache.intensity.clone();
        Ok(Self { heats: vec![Heat::new(Layer::Motion, tensors::read(intensity)?, &cache.intensity)] })
    }

    /// The values of a motion layer.
    pub(super) fn heat(&self, layer: Layer) -> Result<&Heat, ModelError> {
        self.heats
            .iter()
            .find(|heat| heat.layer == layer)
            .ok_or(ModelError::Layer { layer: layer.name(), reason: "it has not been measured yet in this training" })
    }
}

impl Heat {
    /// The features of one value per Gaussian; `like` determines device and dtype.
    fn new(layer: Layer, numbers: Vec<f64>, like: &Tensor<2>) -> Self {
        let mut sorted = numbers.clone();
        sorted.sort_by(f64::total_cmp);
        let place = (sorted.len().saturating_sub(1) as f64 * BRIGHTEST_QUANTILE) as usize;
        // If hardly anything moves, the quantile is zero, and the maximum replaces it.
        let is_scale = |number: &&f64| **number >= f64::from(f32::MIN_POSITIVE);
        let brightest = sorted.get(place).filter(is_scale).or(sorted.last().filter(is_scale)).copied().unwrap_or(1.0);
        // Variances span decades; the root also makes small ones visible.
        let shares = numbers.iter().map(|number| number / brightest);
        let features: Vec<f64> = shares.flat_map(|share| [share.clamp(0.0, 1.0).sqrt(), share]).collect();
        let data = TensorData::new(features, [numbers.len(), HEAT_CHANNELS]);
        Self { layer, features: tensors::from_data_like(data, like), brightest }
    }
}

/// The colours of the heat maps, `count` of them from the lowest to the highest value, for a legend.
pub fn heat_colours(count: usize) -> Vec<[u8; 3]> {
    let last = count.saturating_sub(1).max(1) as f32;
    let ramp: Vec<f32> = (0..count).map(|index| index as f32 / last).collect();
    heat_picture(&ramp, count.max(1)).pixels().map(|pixel| pixel.0).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::test_support::{for_each_device, values};

    /// Tolerance for rounding in single precision.
    const ROUNDING: f64 = 1e-5;

    #[test]
    fn what_a_gaussian_shows_as_heat_is_its_share_of_the_brightest_and_its_root() {
        for_each_device(|device| {
            let like = Tensor::<2>::zeros([1, 1], &device);
            let numbers: Vec<f64> = (0..=100).map(|i| 1e-8 * f64::from(i)).collect();
            let heat = Heat::new(Layer::Motion, numbers, &like);
            assert!((heat.brightest - 98e-8).abs() < 1e-15);
            let features = values(heat.features);
            let of = |row: usize| [features[HEAT_CHANNELS * row], features[HEAT_CHANNELS * row + 1]];
            let expected = [(0, [0.0, 0.0]), (49, [0.5f64.sqrt(), 0.5]), (100, [1.0, 100.0 / 98.0])];
            for (row, [root, share]) in expected {
                assert!((of(row)[0] - root).abs() < ROUNDING && (of(row)[1] - share).abs() < ROUNDING, "{row}");
            }
            let still = Heat::new(Layer::Motion, vec![0.0; 4], &like);
            assert!(values(still.features).iter().all(|&feature| feature == 0.0), "nothing moves");
        });
    }

    #[test]
    fn a_legend_goes_from_the_darkest_to_the_brightest_colour() {
        let colours = heat_colours(16);
        assert_eq!((colours.len(), heat_colours(0).len()), (16, 0));
        let sum = |colour: [u8; 3]| colour.map(u32::from).iter().sum::<u32>();
        assert!(colours.is_sorted_by_key(|&colour| sum(colour)) && sum(colours[15]) > sum(colours[0]));
    }

    #[test]
    fn a_layer_that_was_not_measured_is_told() {
        let error = MotionLayers::default().heat(Layer::Motion).expect_err("refused").to_string();
        assert!(error.contains("`motion`") && error.contains("not been measured"), "{error}");
    }
}
