//! Renders the layers of a model, without autodiff.

use burn::tensor::{Tensor, TensorData};
use image::RgbImage;
use mvfusion_data::Camera;
use mvfusion_render::splat::SplatPlanes;

use super::layer::Layer;
use super::metrics::quantise;
use super::tone::{DepthRange, depth_picture, heat_picture};
use crate::config::FusionWeights;
use crate::model::alive::AliveRows;
use crate::model::composition::{Blending, BranchRenders, Composition};
use crate::model::mask::MaskChannel;
use crate::model::motion::{AttributeSpread, Lifetimes, Trajectories};
use crate::model::{DeformationLevel, Model, RenderContext};
use crate::{ModelError, tensors};

/// Quantile over the dynamic Gaussians that is white in a motion layer.
const BRIGHTEST_QUANTILE: f64 = 0.98;
/// Features of a motion layer: the displayed value and the actual value.
const HEAT_CHANNELS: usize = 2;
/// Alpha below which there is no depth: less than 8 bits resolve.
const LEAST_ALPHA: f64 = 0.5 / 255.0;

/// Renders some layers of a model (see [`Model::plain`]).
#[derive(Clone, Debug)]
pub struct LayerRenderer<'a> {
    model: &'a Model,
    level: DeformationLevel,
    context: &'a RenderContext,
    layers: Vec<Layer>,
    heats: Vec<Heat>,
    depths: Option<DepthRange>,
}

/// A value per dynamic Gaussian that a layer shows.
#[derive(Clone, Debug)]
struct Heat {
    layer: Layer,
    /// The value relative to the brightest: its root in `[0, 1]`, and itself: `[N, 2]`.
    features: Tensor<2>,
    brightest: f64,
}

/// A rendered layer, on the device.
#[derive(Clone, Debug)]
pub struct RenderedLayer {
    /// The layer.
    pub layer: Layer,
    /// Its channels in full precision, `[C, H, W]`. Colours of the static branch may exceed 1. Motion layers have the
    /// units of the motion statistics.
    pub values: Tensor<3>,
    /// The values of the heat map, `[1, H, W]`; only in motion layers.
    heat: Option<Tensor<3>>,
}

impl<'a> LayerRenderer<'a> {
    /// A renderer of `layers`. If one of them is a motion layer, the trajectories are measured first. `weights` are the
    /// weights of the motion intensity.
    ///
    /// # Errors
    /// If the model does not have one of the layers, or the device fails.
    pub fn new(
        model: &'a Model,
        level: DeformationLevel,
        context: &'a RenderContext,
        layers: &[Layer],
        weights: FusionWeights,
    ) -> Result<Self, ModelError> {
        for &layer in layers {
            if let Some(reason) = layer.lacking(model, level) {
                return Err(ModelError::Layer { layer: layer.name(), reason });
            }
        }
        let heats = match layers.iter().any(|layer| layer.is_motion()) {
            true => measured(model, context, layers, weights)?,
            false => Vec::new(),
        };
        Ok(Self { model, level, context, layers: layers.to_vec(), heats, depths: None })
    }

    /// A renderer of those `layers` that the model has. The motion intensity is from the last measurement in training,
    /// if any.
    pub(super) fn as_trained(
        model: &'a Model,
        level: DeformationLevel,
        context: &'a RenderContext,
        layers: &[Layer],
    ) -> Result<Self, ModelError> {
        let known = |layer: Layer| match layer {
            Layer::Motion => model.motion.is_some(),
            _ => layer.lacking(model, level).is_none(),
        };
        let layers: Vec<Layer> = layers.iter().copied().filter(|&layer| known(layer)).collect();
        let heats = match &model.motion {
            Some(cache) if layers.contains(&Layer::Motion) => {
                vec![Heat::new(Layer::Motion, tensors::read(cache.intensity.clone())?, &cache.intensity)]
            }
            _ => Vec::new(),
        };
        Ok(Self { model, level, context, layers, heats, depths: None })
    }

    /// Derives one scale of depth images from these cameras and moments. Otherwise, each image has its own scale.
    ///
    /// # Errors
    /// Same as [`LayerRenderer::render`].
    pub fn with_depths_of(
        mut self,
        frames: impl IntoIterator<Item = (Camera, Option<f64>)>,
    ) -> Result<Self, ModelError> {
        let only_depth = Self { layers: vec![Layer::Depth], heats: Vec::new(), ..self.clone() };
        for (camera, time) in frames {
            for layer in only_depth.render(&camera, time)? {
                let found = DepthRange::of(&tensors::read::<3, f32>(layer.values)?);
                self.depths = match (self.depths, found) {
                    (Some(a), Some(b)) => Some(a.and(b)),
                    (a, b) => a.or(b),
                };
            }
        }
        Ok(self)
    }

    /// The layers, in the requested order.
    pub fn layers(&self) -> &[Layer] {
        &self.layers
    }

    /// Renders a moment in `[0, 1]`. Without a moment, the static branch fills the whole image at brightness 1, and
    /// layers of the dynamic branch, its share and its motion are black.
    ///
    /// # Errors
    /// If the splat op rejects its input, or there is neither a moment nor a static branch.
    pub fn render(&self, camera: &Camera, time: impl Into<Option<f64>>) -> Result<Vec<RenderedLayer>, ModelError> {
        let seen = match time.into() {
            Some(time) => self.at(camera, time)?,
            None => self.without_moment(camera)?,
        };
        let rendered = |&layer: &Layer| match self.heats.iter().position(|heat| heat.layer == layer) {
            Some(place) => {
                let [shown, share] = seen.heat(place);
                RenderedLayer { layer, values: share * self.heats[place].brightest, heat: Some(shown) }
            }
            None => RenderedLayer { layer, values: seen.layer(layer), heat: None },
        };
        Ok(self.layers.iter().map(rendered).collect())
    }

    /// Both branches at a time.
    fn at(&self, camera: &Camera, time: f64) -> Result<Seen, ModelError> {
        let alive = AliveRows::of(&self.model.dynamic, time)?;
        let moved = self.model.rows_at(alive.as_ref(), time, self.level, self.context);
        let of_rows = |features: Tensor<2>| match &alive {
            Some(alive) => features.select(0, alive.rows().clone()),
            None => features,
        };
        let masks = moved.mask_features();
        let first_heat = if masks.is_some() { MaskChannel::ALL.len() } else { 0 };
        let features: Vec<_> =
            masks.into_iter().chain(self.heats.iter().map(|heat| of_rows(heat.features.clone()))).collect();
        let features = (!features.is_empty()).then(|| Tensor::cat(features, 1));
        let settings = self.context.splat_settings(self.model.dynamic.sh_degree, false);
        let dynamic = moved.splat(features, None, camera, &settings, self.context.behind)?;
        let static_ = self.model.static_picture(camera, self.context)?;
        Ok(Seen::new(dynamic.main(), static_.map(|picture| picture.main()), first_heat))
    }

    /// Only the static branch.
    fn without_moment(&self, camera: &Camera) -> Result<Seen, ModelError> {
        let static_ = self.model.static_picture(camera, self.context)?.ok_or(ModelError::Layer {
            layer: Layer::Static.name(),
            reason: "without a moment only the static branch can be shown, and the model has none",
        })?;
        Ok(Seen::of_static(static_.main(), self.heats.len()))
    }

    /// A layer in 8 bits. Colours, mask and alpha are unchanged. Depths become grey by their inverse (near is white).
    /// Motion becomes a heat map of the root, from black through red and yellow to white, which is the 98 % quantile of
    /// the dynamic Gaussians.
    ///
    /// # Errors
    /// If the device fails to return the values.
    pub fn picture(&self, rendered: &RenderedLayer) -> Result<RgbImage, ModelError> {
        let [_, _, width] = rendered.values.dims();
        if let Some(heat) = &rendered.heat {
            return Ok(heat_picture(&tensors::read::<3, f32>(heat.clone())?, width));
        }
        if rendered.layer != Layer::Depth {
            return quantise(rendered.values.clone().unsqueeze_dim(0));
        }
        let depths = rendered.pixels()?;
        let nothing = DepthRange { near: 1.0, far: 1.0 };
        let range = self.depths.or_else(|| DepthRange::of(&depths)).unwrap_or(nothing);
        Ok(depth_picture(&depths, width, range))
    }
}

impl RenderedLayer {
    /// The values, channel by channel, row by row.
    ///
    /// # Errors
    /// If the device fails to return the values.
    pub fn pixels(&self) -> Result<Vec<f32>, ModelError> {
        tensors::read(self.values.clone())
    }

    /// Width and height.
    pub fn size(&self) -> (usize, usize) {
        let [_, height, width] = self.values.dims();
        (width, height)
    }
}

/// The motion layers, from newly measured trajectories.
fn measured(
    model: &Model,
    context: &RenderContext,
    layers: &[Layer],
    weights: FusionWeights,
) -> Result<Vec<Heat>, ModelError> {
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
    let heat = |&layer: &Layer| {
        let number: fn(&AttributeSpread, FusionWeights) -> f64 = match layer {
            Layer::Motion => |spread, weights| spread.fused(weights),
            Layer::PositionVariance => |spread, _| spread.position,
            Layer::RotationVariance => |spread, _| spread.rotation,
            Layer::ScaleVariance => |spread, _| spread.scale,
            _ => return None,
        };
        Some(Heat::new(layer, spreads.iter().map(|spread| number(spread, weights)).collect(), &means))
    };
    Ok(layers.iter().filter_map(heat).collect())
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

/// The renders of the branches, blended if there are two.
struct Seen {
    dynamic: SplatPlanes,
    static_: Option<SplatPlanes>,
    blend: Option<Composition>,
    first_heat: usize,
}

impl Seen {
    fn new(dynamic: SplatPlanes, static_: Option<SplatPlanes>, first_heat: usize) -> Self {
        let blend = match (&static_, &dynamic.features) {
            (Some(static_), Some(features)) if first_heat > 0 => {
                let layers = BranchRenders {
                    dynamic: dynamic.colour.clone().unsqueeze_dim(0),
                    static_: static_.colour.clone().unsqueeze_dim(0),
                    mask: features.clone().narrow(0, 0, MaskChannel::ALL.len()).unsqueeze_dim(0),
                };
                Some(layers.compose(Blending::Evaluation))
            }
            _ => None,
        };
        Self { dynamic, static_, blend, first_heat }
    }

    /// The renders without a dynamic branch. Its features are black, including those of `heats` motion layers.
    fn of_static(static_: SplatPlanes, heats: usize) -> Self {
        let nothing = static_.alpha.zeros_like();
        let dynamic = SplatPlanes {
            colour: static_.colour.zeros_like(),
            features: Some(nothing.clone().repeat_dim(0, MaskChannel::ALL.len() + HEAT_CHANNELS * heats)),
            alpha: nothing.clone(),
            depth: nothing,
        };
        let blend = Some(Composition::of_static(static_.colour.clone().unsqueeze_dim(0)));
        Self { dynamic, static_: Some(static_), blend, first_heat: MaskChannel::ALL.len() }
    }

    /// A layer that is not a motion layer.
    fn layer(&self, layer: Layer) -> Tensor<3> {
        let single = || self.dynamic.colour.clone().clamp(0.0, 1.0);
        match (layer, &self.blend) {
            (Layer::Depth, _) => self.depth(),
            (Layer::Alpha, _) => self.blended(|branch| branch.alpha.clone()),
            // A model with one branch has only this layer.
            (_, None) => single(),
            (Layer::Static, Some(blend)) => blend.static_.clone().squeeze_dim(0),
            (Layer::Dynamic, Some(blend)) => blend.dynamic.clone().squeeze_dim(0),
            (Layer::Mask, Some(blend)) => blend.mask.clone().squeeze_dim(0),
            (Layer::MaskedStatic, Some(blend)) => (blend.static_mask.clone() * blend.lit.clone()).squeeze_dim(0),
            (Layer::MaskedDynamic, Some(blend)) => (blend.mask.clone() * blend.dynamic.clone()).squeeze_dim(0),
            (_, Some(blend)) => blend.composed.clone().squeeze_dim(0),
        }
    }

    /// A plane of both branches, `[1, H, W]`, blended like the colours.
    fn blended(&self, plane: impl Fn(&SplatPlanes) -> Tensor<3>) -> Tensor<3> {
        match (&self.static_, &self.blend) {
            (Some(static_), Some(blend)) => {
                let share = |mask: &Tensor<4>| -> Tensor<3> { mask.clone().squeeze_dim(0) };
                plane(&self.dynamic) * share(&blend.mask) + plane(static_) * share(&blend.static_mask)
            }
            _ => plane(&self.dynamic),
        }
    }

    fn depth(&self) -> Tensor<3> {
        let alpha = self.blended(|branch| branch.alpha.clone());
        let sum = self.blended(|branch| branch.depth.clone());
        let nothing = alpha.clone().lower_elem(LEAST_ALPHA);
        (sum / alpha.clamp_min(LEAST_ALPHA)).mask_fill(nothing, 0.0)
    }

    /// The two planes of a motion layer, `[1, H, W]`: the displayed and the actual value.
    fn heat(&self, place: usize) -> [Tensor<3>; HEAT_CHANNELS] {
        // Proof: the features of a motion layer were splatted.
        let features = self.dynamic.features.as_ref().expect("features were splatted");
        let first = self.first_heat + HEAT_CHANNELS * place;
        [first, first + 1].map(|channel| features.clone().narrow(0, channel, 1))
    }
}

#[cfg(test)]
mod tests {
    use burn::tensor::Device;

    use super::*;
    use crate::test_support::{for_each_device, values};

    /// Tolerance for rounding in single precision.
    const ROUNDING: f64 = 1e-5;

    /// A row of pixels.
    fn row<const W: usize>(numbers: [f32; W], device: &Device) -> Tensor<3> {
        Tensor::from_data(TensorData::new(numbers.to_vec(), [1, 1, W]), device)
    }

    /// A branch with these alphas and depths; `features` are the probabilities of the mask channels.
    fn branch(alpha: [f32; 3], depth: [f32; 3], features: Option<[f32; 3]>, device: &Device) -> SplatPlanes {
        let sum: [f32; 3] = std::array::from_fn(|i| alpha[i] * depth[i]);
        let features = features.map(|levels| Tensor::cat(levels.map(|level| row([level; 3], device)).to_vec(), 0));
        let colour = row([0.5; 3], device).repeat_dim(0, 3);
        SplatPlanes { colour, features, alpha: row(alpha, device), depth: row(sum, device) }
    }

    fn assert_close(found: Tensor<3>, expected: [f64; 3]) {
        let found = values(found);
        assert!(found.iter().zip(expected).all(|(a, b)| (a - b).abs() < ROUNDING), "{found:?} {expected:?}");
    }

    #[test]
    fn depth_is_that_of_what_is_there_however_thin_and_nothing_where_nothing_is() {
        for_each_device(|device| {
            let seen = Seen::new(branch([1.0, 0.5, 0.0001], [3.0, 2.0, 7.0], None, &device), None, 0);
            assert_close(seen.layer(Layer::Depth), [3.0, 2.0, 0.0]);
            assert_close(seen.layer(Layer::Alpha), [1.0, 0.5, 0.0001]);
        });
    }

    #[test]
    fn depths_of_both_branches_are_blended_by_share_and_weight() {
        for_each_device(|device| {
            // The dynamic branch has a quarter of each pixel.
            let dynamic = branch([1.0, 0.5, 0.0], [2.0; 3], Some([0.75, 0.5, 0.25]), &device);
            let static_ = branch([1.0; 3], [4.0; 3], None, &device);
            let seen = Seen::new(dynamic, Some(static_), MaskChannel::ALL.len());
            assert_close(seen.layer(Layer::Mask), [0.25; 3]);
            assert_close(seen.layer(Layer::Alpha), [1.0, 0.875, 0.75]);
            // (0.25 a 2 + 0.75 4) / (0.25 a + 0.75) for the alphas 1, 0.5 and 0.
            assert_close(seen.layer(Layer::Depth), [3.5, 3.25 / 0.875, 4.0]);
        });
    }

    #[test]
    fn without_a_moment_the_static_branch_has_the_whole_picture() {
        for_each_device(|device| {
            let bright = row([0.25, 1.5, 0.5], &device).repeat_dim(0, 3);
            let static_ = SplatPlanes { colour: bright, ..branch([1.0, 0.5, 0.0], [3.0, 2.0, 0.0], None, &device) };
            let seen = Seen::of_static(static_, 1);
            let red = |layer: Layer| seen.layer(layer).narrow(0, 0, 1);
            assert_eq!(values(red(Layer::Composed)), [0.25, 1.0, 0.5]);
            assert_eq!(values(red(Layer::MaskedStatic)), [0.25, 1.0, 0.5]);
            assert_eq!(values(red(Layer::Static)), [0.25, 1.5, 0.5], "as it is, without a clamp");
            for layer in [Layer::Dynamic, Layer::Mask, Layer::MaskedDynamic] {
                assert_eq!(values(red(layer)), [0.0; 3], "{layer}");
            }
            assert_close(seen.layer(Layer::Depth), [3.0, 2.0, 0.0]);
            assert_close(seen.layer(Layer::Alpha), [1.0, 0.5, 0.0]);
            assert!(seen.heat(0).into_iter().all(|plane| values(plane) == [0.0; 3]));
        });
    }

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
}
