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
        Ok(Moment { gaussians: self.rows_at(alive.as_ref(), time, level, context), alive })
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
    use mvfusion_data::{BuiltinOptions, builtin};

    use crate::config::{Config, TrainConfig};
    use crate::device;
    use crate::evaluation::{Layer, LayerRenderer};
    use crate::train::Trainer;

    #[test]
    fn a_moment_renders_like_its_time_from_every_camera() {
        let scene = builtin::builtin(&BuiltinOptions { width: 32, height: 24, frames: 3, ..Default::default() });
        let train = TrainConfig { scale: 0.0005, ..TrainConfig::default() };
        let config = Config { train, ..Config::default() }.scaled();
        let mut trainer = Trainer::new(config, &scene, &device::flex()).expect("trainer");
        while trainer.step().expect("step").is_some() {}
        let (model, context) = (trainer.state().model.plain(), trainer.render_context());
        let (level, layers) = (trainer.final_level(), [Layer::Composed, Layer::Mask, Layer::Depth]);
        let weights = context.motion.weights;
        let renderer = LayerRenderer::new(&model, level, context, &layers, weights).expect("renderer");
        let moment = model.moment(0.4, level, context).expect("moment");
        assert!(moment.bytes() > 0);
        for view in &scene.test[..2] {
            let values = |rendered: Vec<crate::evaluation::RenderedLayer>| {
                rendered.iter().map(|layer| layer.pixels().expect("pixels")).collect::<Vec<_>>()
            };
            let fresh = values(renderer.render(&view.camera, 0.4).expect("rendered"));
            let kept = values(renderer.render_moment(&view.camera, &moment).expect("rendered"));
            assert!(fresh == kept, "{}", view.name);
        }
    }
}
