//! Renders the layers of a model, without autodiff.

use burn::tensor::Tensor;
use image::RgbImage;
use mvfusion_data::Camera;
use mvfusion_render::splat::SplatPlanes;

use super::heat::{HEAT_CHANNELS, Heat, MotionLayers};
use super::layer::Layer;
use super::metrics::quantise;
use super::tone::{DepthRange, depth_picture, heat_picture};
use crate::config::FusionWeights;
use crate::model::composition::{Blending, BranchRenders, Composition};
use crate::model::mask::MaskChannel;
use crate::model::{DeformationLevel, Model, Moment, RenderContext};
use crate::{ModelError, tensors};

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

/// What the brightness of an 8-bit image of a layer means.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum LayerScale {
    /// The depths that are white and black.
    Depth(DepthRange),
    /// The value that is white in a heat map. Brightness is the root of the share of it.
    Heat(f64),
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
        check(model, level, layers)?;
        let motion = match layers.iter().any(|layer| layer.is_motion()) {
            true => MotionLayers::measure(model, context, weights)?,
            false => MotionLayers::default(),
        };
        Self::with_motion(model, level, context, layers, &motion)
    }

    /// The same with `motion` that was measured before.
    ///
    /// # Errors
    /// If the model does not have one of the layers, or `motion` lacks a motion layer.
    pub fn with_motion(
        model: &'a Model,
        level: DeformationLevel,
        context: &'a RenderContext,
        layers: &[Layer],
        motion: &MotionLayers,
    ) -> Result<Self, ModelError> {
        check(model, level, layers)?;
        let heats = layers.iter().filter(|layer| layer.is_motion()).map(|&layer| motion.heat(layer).cloned());
        let heats = heats.collect::<Result<_, _>>()?;
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
        let heats = match layers.contains(&Layer::Motion) {
            true => MotionLayers::as_trained(model)?.heats,
            false => Vec::new(),
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

    /// One scale of all depth images; `None` for a scale of each.
    pub fn with_depths(self, depths: Option<DepthRange>) -> Self {
        Self { depths, ..self }
    }

    /// The scale of all depth images, if they have one.
    pub fn depths(&self) -> Option<DepthRange> {
        self.depths
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
        match time.into() {
            Some(time) => self.render_moment(camera, &self.model.moment(time, self.level, self.context)?),
            None => Ok(self.shown(&self.without_moment(camera)?)),
        }
    }

    /// Renders the Gaussians of a moment that was prepared before ([`Model::moment`]), without the networks.
    ///
    /// # Errors
    /// If the splat op rejects its input.
    pub fn render_moment(&self, camera: &Camera, moment: &Moment) -> Result<Vec<RenderedLayer>, ModelError> {
        Ok(self.shown(&self.at(camera, moment)?))
    }

    /// The layers of a render.
    fn shown(&self, seen: &Seen) -> Vec<RenderedLayer> {
        let rendered = |&layer: &Layer| match self.heats.iter().position(|heat| heat.layer == layer) {
            Some(place) => {
                let [shown, share] = seen.heat(place);
                RenderedLayer { layer, values: share * self.heats[place].brightest, heat: Some(shown) }
            }
            None => RenderedLayer { layer, values: seen.layer(layer), heat: None },
        };
        self.layers.iter().map(rendered).collect()
    }

    /// Both branches at a moment.
    fn at(&self, camera: &Camera, moment: &Moment) -> Result<Seen, ModelError> {
        let masks = moment.gaussians().mask_features();
        let first_heat = if masks.is_some() { MaskChannel::ALL.len() } else { 0 };
        let heats = self.heats.iter().map(|heat| moment.among_alive(heat.features.clone()));
        let features: Vec<_> = masks.into_iter().chain(heats).collect();
        let features = (!features.is_empty()).then(|| Tensor::cat(features, 1));
        let settings = self.context.splat_settings(self.model.dynamic.sh_degree, false);
        let moved = moment.gaussians().clone();
        let dynamic = moved.splat(features, None, camera, &settings, self.context.background)?;
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
    /// Motion becomes a heat map of the root, from black to pale yellow, which is the 98 % quantile of the dynamic
    /// Gaussians.
    ///
    /// # Errors
    /// If the device fails to return the values.
    pub fn picture(&self, rendered: &RenderedLayer) -> Result<RgbImage, ModelError> {
        Ok(self.picture_with_scale(rendered)?.0)
    }

    /// The same with the meaning of its brightness, which depth and motion layers have.
    ///
    /// # Errors
    /// If the device fails to return the values.
    pub fn picture_with_scale(&self, rendered: &RenderedLayer) -> Result<(RgbImage, Option<LayerScale>), ModelError> {
        let [_, _, width] = rendered.values.dims();
        if let Some(heat) = &rendered.heat {
            let white = self.heats.iter().find(|heat| heat.layer == rendered.layer).map(|heat| heat.brightest);
            return Ok((heat_picture(&tensors::read::<3, f32>(heat.clone())?, width), white.map(LayerScale::Heat)));
        }
        if rendered.layer != Layer::Depth {
            return Ok((quantise(rendered.values.clone().unsqueeze_dim(0))?, None));
        }
        let depths = rendered.pixels()?;
        let range = self.depths.or_else(|| DepthRange::of(&depths));
        let nothing = DepthRange { near: 1.0, far: 1.0 };
        Ok((depth_picture(&depths, width, range.unwrap_or(nothing)), range.map(LayerScale::Depth)))
    }
}

/// Checks that the model has these layers.
fn check(model: &Model, level: DeformationLevel, layers: &[Layer]) -> Result<(), ModelError> {
    let lacking =
        |&layer: &Layer| Some(ModelError::Layer { layer: layer.name(), reason: layer.lacking(model, level)? });
    layers.iter().find_map(lacking).map_or(Ok(()), Err)
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
    use burn::tensor::{Device, TensorData};

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
}
