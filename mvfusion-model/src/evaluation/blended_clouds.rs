//! Renders the Gaussians of both branches, given as values, blended like those of a model; and measures what each of
//! them contributes to a render.

use burn::tensor::{DType, Device, Tensor};
use image::RgbImage;
use mvfusion_data::{Camera, GaussianCloud};

use super::metrics::quantise;
use crate::initial::{Masking, gaussians_of};
use crate::model::RenderContext;
use crate::model::composition::{Blending, BranchRenders};
use crate::model::gaussians::RawGaussians;
use crate::{ModelError, tensors};

/// An 8-bit image of the branches at one time. With a static branch and masks of the dynamic one, it is blended as in
/// an evaluation (METHOD §1.3); otherwise it shows the dynamic Gaussians. Lifetimes are ignored.
///
/// # Errors
/// If the splat op rejects the Gaussians, or the device fails to return the image.
pub fn blended_picture(
    static_: Option<&GaussianCloud>,
    dynamic: &GaussianCloud,
    camera: &Camera,
    context: &RenderContext,
    device: &Device,
) -> Result<RgbImage, ModelError> {
    let splat = |cloud: &GaussianCloud| {
        let gaussians = raw(cloud, device);
        let settings = context.splat_settings(cloud.sh_degree, false);
        let features = gaussians.mask_features();
        Ok::<_, ModelError>(gaussians.splat(features, None, camera, &settings, context.background)?.main())
    };
    let dynamic = splat(dynamic)?;
    let colour = dynamic.colour.unsqueeze_dim(0);
    let composed = match (static_, dynamic.features) {
        (Some(static_), Some(mask)) => {
            let static_ = splat(static_)?.colour.unsqueeze_dim(0);
            BranchRenders { dynamic: colour, static_, mask: mask.unsqueeze_dim(0) }
                .compose(Blending::Evaluation)
                .composed
        }
        _ => colour,
    };
    quantise(composed)
}

/// What each Gaussian contributes to a render of its branch: the sum of its blending weights (alpha times transmittance)
/// over all pixels. At one half, it has half a pixel.
///
/// # Errors
/// If the splat op rejects the Gaussians, or the device fails to return values.
pub fn contributions(
    cloud: &GaussianCloud,
    camera: &Camera,
    context: &RenderContext,
    device: &Device,
) -> Result<Vec<f32>, ModelError> {
    // Colours do not matter.
    let gaussians = raw(&cloud.clone().at_degree(0), &device.clone().autodiff());
    // The gradient of a sum over pixels with respect to a feature is the sum of the weights.
    let like = gaussians.means.clone();
    let features: Tensor<2> = Tensor::ones([cloud.len(), 1], (&like.device().inner(), DType::F32));
    let features = features.autodiff().require_grad();
    let settings = context.splat_settings(0, false);
    let picture = gaussians.splat(Some(features.clone()), None, camera, &settings, context.background)?.main();
    // Proof: a feature was splatted, and its gradient requested.
    let gradients = picture.features.expect("a feature").sum().backward();
    tensors::read(features.grad(&gradients).expect("a gradient"))
}

/// The tensors of a cloud, on a device with or without autodiff.
fn raw(cloud: &GaussianCloud, device: &Device) -> RawGaussians {
    let masking = match cloud.mask_logits {
        Some(_) => Masking::Blended { dynamic_logit: 0.0 },
        None => Masking::Absent,
    };
    gaussians_of(cloud, masking, cloud.sh_degree, device, DType::F32).canonical()
}

#[cfg(test)]
mod tests {
    use mvfusion_data::{BuiltinOptions, builtin};

    use super::*;
    use crate::config::{Config, TrainConfig};
    use crate::device;
    use crate::evaluation::{Layer, LayerRenderer};
    use crate::train::Trainer;

    /// A render in single precision, in sums of another order.
    const ROUNDING: f32 = 1e-3;

    #[test]
    #[cfg(feature = "flex")]
    fn the_branches_of_a_model_as_values_look_like_the_model_and_their_weights_sum_to_alpha() {
        let scene = builtin::builtin(&BuiltinOptions { width: 32, height: 24, frames: 3, ..Default::default() });
        let train = TrainConfig { scale: 0.0005, ..TrainConfig::default() };
        let config = Config { train, ..Config::default() }.scaled();
        let mut trainer = Trainer::new(config, &scene, &device::flex()).expect("trainer");
        while trainer.step().expect("step").is_some() {}
        let (model, context) = (trainer.state().model.plain(), trainer.render_context());
        let level = trainer.final_level();
        let camera = scene.test[0].camera;
        let layers = [Layer::Composed, Layer::Dynamic];
        let renderer = LayerRenderer::new(&model, level, context, &layers, context.motion.weights).expect("renderer");
        let rendered = renderer.render(&camera, 0.4).expect("rendered");
        let wanted = renderer.picture(&rendered[0]).expect("read");

        let dynamic =
            model.dynamic_at(0.4, level, context).to_cloud().expect("read").zero_above(model.dynamic.sh_degree);
        let static_ = model.static_.as_ref().expect("a static branch").to_cloud().expect("read");
        let found = blended_picture(Some(&static_), &dynamic, &camera, context, &device::flex()).expect("rendered");
        let off = found.as_raw().iter().zip(wanted.as_raw()).map(|(a, b)| a.abs_diff(*b)).max();
        assert!(off <= Some(1), "{off:?} levels");

        let weights = contributions(&static_, &camera, context, &device::flex()).expect("measured");
        assert!(weights.len() == static_.len() && weights.iter().all(|&weight| weight >= 0.0));
        let settings = context.splat_settings(0, false);
        let alpha = model.static_.as_ref().expect("static").canonical();
        let alpha = alpha.splat(None, None, &camera, &settings, context.background).expect("rendered").main().alpha;
        let (total, sum) = (alpha.sum().into_scalar::<f32>(), weights.iter().sum::<f32>());
        assert!(total > 0.0 && (sum / total - 1.0).abs() < ROUNDING, "weights sum to {sum}, alphas to {total}");
    }
}
