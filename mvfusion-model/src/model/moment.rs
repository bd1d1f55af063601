//! The dynamic Gaussians of a moment, deformed once and rendered from any number of cameras.

use burn::tensor::Tensor;

use super::alive::AliveRows;
use super::gaussians::RawGaussians;
use super::{DeformationLevel, Model, RenderContext};
use crate::ModelError;

/// The dynamic Gaussians that are alive at a moment, deformed.
#[derive(Clone, Debug)]
pub struct Moment {
    gaussians: RawGaussians,
    alive: Option<AliveRows>,
}

impl Model {
    /// The dynamic Gaussians at a time in `[0, 1]`, for
    /// [`LayerRenderer::render_moment`](crate::evaluation::LayerRenderer::render_moment). This is the part of a render
    /// that does not depend on the camera: all networks.
    ///
    /// # Errors
    /// If the device fails to return values.
    pub fn moment(&self, time: f64, level: DeformationLevel, context: &RenderContext) -> Result<Moment, ModelError> {
        let alive = AliveRows::of(&self.dynamic, time)?;
        Ok(Moment { gaussians: self.rows_at((alive.as_ref(), time), level, context), alive })
    }
}

impl Moment {
    /// The Gaussians that are alive: one row each.
    pub fn gaussians(&self) -> &RawGaussians {
        &self.gaussians
    }

    /// The rows of `features` (one row per Gaussian of the model) whose Gaussians are alive.
    pub(crate) fn among_alive(&self, features: Tensor<2>) -> Tensor<2> {
        match &self.alive {
            Some(alive) => features.select(0, alive.rows().clone()),
            None => features,
        }
    }

    /// The memory that it takes, in bytes.
    pub fn bytes(&self) -> usize {
        let RawGaussians { means, sh, opacity_logits, log_scales, quaternions, mask_logits } = &self.gaussians;
        let matrices = [means, opacity_logits, log_scales, quaternions].into_iter().chain(mask_logits);
        let values = matrices.map(|tensor| tensor.shape().num_elements()).sum::<usize>() + sh.shape().num_elements();
        values * size_of::<f32>()
    }
}

#[cfg(all(test, feature = "flex"))]
mod tests {
    use burn::tensor::{Tensor, TensorData};
    use mvfusion_data::{BuiltinOptions, builtin};

    use super::*;
    use crate::config::{Config, ModelConfig, TrainConfig};
    use crate::evaluation::{Layer, LayerRenderer, RenderedLayer};
    use crate::train::Trainer;
    use crate::{device, tensors};

    /// Sums over other numbers of rows are rounded differently.
    const ROUNDING: f32 = 1e-4;

    /// A short life around one of two times.
    fn with_lifetimes(model: &mut Model) {
        let means = model.dynamic.means.val();
        let count = model.dynamic.count();
        let column = |value: fn(usize) -> f32| -> Tensor<2> {
            let values: Vec<f32> = (0..count).map(value).collect();
            tensors::from_data_like(TensorData::new(values, [count, 1]), &means)
        };
        let (centres, durations) = (column(|row| if row % 3 == 0 { 0.9 } else { 0.4 }), column(|_| -3.0));
        let dynamic = &mut model.dynamic;
        dynamic.time_centres = dynamic.time_centres.take().map(|old| old.map(|_| centres));
        dynamic.log_durations = dynamic.log_durations.take().map(|old| old.map(|_| durations));
    }

    #[test]
    fn a_moment_renders_like_all_gaussians_though_it_holds_only_those_that_are_alive() {
        let scene = builtin::builtin(&BuiltinOptions { width: 32, height: 24, frames: 3, ..Default::default() });
        let train = TrainConfig { scale: 0.0005, ..TrainConfig::default() };
        let model = ModelConfig { lifetime: true, ..ModelConfig::default() };
        let config = Config { train, model, ..Config::default() }.scaled();
        let mut trainer = Trainer::new(config, &scene, &device::flex()).expect("trainer");
        while trainer.step().expect("step").is_some() {}
        let (mut model, context) = (trainer.state().model.plain(), trainer.render_context());
        with_lifetimes(&mut model);
        let (level, layers) = (trainer.final_level(), [Layer::Composed, Layer::Mask, Layer::Depth, Layer::Motion]);
        let renderer = LayerRenderer::new(&model, level, context, &layers, context.motion.weights).expect("renderer");
        let moment = model.moment(0.4, level, context).expect("moment");
        let (alive, count) = (moment.gaussians().means.dims()[0], model.dynamic.count());
        assert!(moment.bytes() > 0 && alive > 0 && alive < count, "{alive} of {count}");
        let all = Moment { gaussians: model.dynamic_at(0.4, level, context), alive: None };
        for view in &scene.test[..2] {
            let values = |rendered: Vec<RenderedLayer>| {
                rendered.iter().map(|layer| layer.pixels().expect("pixels")).collect::<Vec<_>>()
            };
            let kept = values(renderer.render_moment(&view.camera, &moment).expect("rendered"));
            let whole = values(renderer.render_moment(&view.camera, &all).expect("rendered"));
            for ((layer, kept), whole) in layers.iter().zip(&kept).zip(&whole) {
                let largest = whole.iter().fold(0.0f32, |largest, value| largest.max(value.abs()));
                let off = kept.iter().zip(whole).fold(0.0f32, |off, (kept, whole)| off.max((kept - whole).abs()));
                assert!(largest > 0.0 && off <= ROUNDING * largest, "{}, {layer}: {off} of {largest}", view.name);
            }
            let fresh = values(renderer.render(&view.camera, 0.4).expect("rendered"));
            assert!(fresh == kept, "{}", view.name);
        }
    }
}
