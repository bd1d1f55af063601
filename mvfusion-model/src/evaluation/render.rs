//! One view in all its layers, without autodiff.

use burn::tensor::Tensor;
use image::RgbImage;
use mvfusion_data::View;

use super::metrics::quantise;
use crate::ModelError;
use crate::composition::{Blending, Composition, Layers};
use crate::model::{BranchPictures, Model, Movement, Surroundings};
use crate::tensors;

/// The layers of a view as 8-bit pictures.
#[derive(Clone, Debug)]
pub struct ViewPictures {
    /// What the whole model shows: the branches blended, or the only one.
    pub composed: RgbImage,
    /// What it is blended from, in a model of two branches.
    pub branches: Option<BranchLayers>,
    /// Motion intensity of the dynamic branch, on a scale of its own; absent until motion was measured.
    pub motion: Option<RgbImage>,
    /// The composed picture in full precision: `[1, 3, H, W]`.
    pub composed_tensor: Tensor<4>,
}

/// What a view is blended from.
#[derive(Clone, Debug)]
pub struct BranchLayers {
    /// The static branch alone, without brightness control.
    pub static_: RgbImage,
    /// The dynamic branch alone.
    pub dynamic: RgbImage,
    /// The share of the dynamic branch.
    pub mask: RgbImage,
    /// The static branch in full precision: `[1, 3, H, W]`.
    pub static_tensor: Tensor<4>,
}

/// Quantile of the motion intensity that is shown as white.
const BRIGHTEST_QUANTILE: f64 = 0.98;

/// Renders a view of a model without autodiff (see [`Model::plain`]).
///
/// # Errors
/// If the device fails or an op refuses its input.
pub fn render_view(
    model: &Model,
    view: &View,
    movement: Movement,
    surroundings: &Surroundings,
) -> Result<ViewPictures, ModelError> {
    let pictures = model.render(&view.camera, view.time, movement, None, surroundings)?;
    let (composed, branches) = match compose(&pictures) {
        Some(blend) => (blend.composed.clone(), Some(BranchLayers::of(blend)?)),
        None => (pictures.dynamic.main().colour.unsqueeze_dim(0).clamp(0.0, 1.0), None),
    };
    Ok(ViewPictures {
        composed: quantise(composed.clone())?,
        branches,
        motion: motion_picture(model, view, movement, surroundings)?,
        composed_tensor: composed,
    })
}

/// Blends the branches, if there are two.
fn compose(pictures: &BranchPictures) -> Option<Composition> {
    let (dynamic, static_) = (pictures.dynamic.main(), pictures.static_.as_ref()?.main());
    let batch = |layer: Tensor<3>| -> Tensor<4> { layer.unsqueeze_dim(0) };
    let layers =
        Layers { dynamic: batch(dynamic.colour), static_: batch(static_.colour), mask: batch(dynamic.features?) };
    Some(layers.compose(Blending::Evaluation))
}

impl BranchLayers {
    fn of(blend: Composition) -> Result<Self, ModelError> {
        Ok(Self {
            static_: quantise(blend.static_.clone())?,
            dynamic: quantise(blend.dynamic)?,
            mask: quantise(blend.mask)?,
            static_tensor: blend.static_.clamp(0.0, 1.0),
        })
    }
}

/// The motion intensity of the dynamic Gaussians, splatted, as a heat map.
fn motion_picture(
    model: &Model,
    view: &View,
    movement: Movement,
    surroundings: &Surroundings,
) -> Result<Option<RgbImage>, ModelError> {
    let Some(cache) = &model.motion else { return Ok(None) };
    let mut sorted: Vec<f64> = tensors::read(cache.intensity.clone())?;
    sorted.sort_by(f64::total_cmp);
    let brightest = sorted[((sorted.len() - 1) as f64 * BRIGHTEST_QUANTILE) as usize].max(f64::MIN_POSITIVE);
    // Intensities are variances, spread over decades; the root shows the faint ones as well.
    let scaled = (cache.intensity.clone() / brightest).clamp(0.0, 1.0).sqrt();

    let moved = model.dynamic_at(view.time, movement, surroundings);
    let settings = surroundings.splat_settings(model.dynamic.sh_degree, false);
    let picture = moved.splat(Some(scaled), None, &view.camera, &settings, surroundings.background)?;
    // Proof: the op gives back as many features as it was given, and it was given one.
    let intensity = picture.main().features.expect("one feature was splatted");
    let [_, height, width] = intensity.dims();
    let values: Vec<f32> = tensors::read(intensity)?;
    let pixel = |x: u32, y: u32| heat(values[y as usize * width + x as usize]);
    Ok(Some(RgbImage::from_fn(width as u32, height as u32, pixel)))
}

/// Black, red, yellow, white.
fn heat(value: f32) -> image::Rgb<u8> {
    let level = |offset: f32| ((3.0 * value - offset).clamp(0.0, 1.0) * 255.0).round() as u8;
    image::Rgb([level(0.0), level(1.0), level(2.0)])
}
