//! One view in the layers that an evaluation scores and shows.

use burn::tensor::Tensor;
use image::RgbImage;
use mvfusion_data::View;

use super::layer::Layer;
use super::layers::LayerRenderer;
use crate::ModelError;
use crate::model::{DeformationLevel, Model, RenderContext};

/// The layers of a view as 8-bit pictures.
#[derive(Clone, Debug)]
pub struct ViewPictures {
    /// What the whole model shows: the branches blended, or the only one.
    pub composed: RgbImage,
    /// What it is blended from, in a model of two branches.
    pub branches: Option<BranchImages>,
    /// Motion intensity of the dynamic branch, on a scale of its own; absent until motion was measured.
    pub motion: Option<RgbImage>,
    /// The composed picture in full precision: `[1, 3, H, W]`.
    pub composed_tensor: Tensor<4>,
}

/// What a view is blended from.
#[derive(Clone, Debug)]
pub struct BranchImages {
    /// The static branch alone, without brightness control.
    pub static_: RgbImage,
    /// The dynamic branch alone.
    pub dynamic: RgbImage,
    /// The share of the dynamic branch.
    pub mask: RgbImage,
    /// What the static branch adds to the composed picture, under the brightness control and times its share, and what
    /// the dynamic one adds: `[1, 3, H, W]` each.
    masked: [Tensor<4>; 2],
    /// The static branch in full precision: `[1, 3, H, W]`.
    pub static_tensor: Tensor<4>,
}

impl BranchImages {
    /// What the static branch adds to the composed picture, and what the dynamic one adds. Read from the device when it
    /// is asked for: no score needs it.
    ///
    /// # Errors
    /// If the device cannot hand its numbers back.
    pub fn masked(&self) -> Result<[RgbImage; 2], ModelError> {
        let [static_, dynamic] = self.masked.clone();
        Ok([super::metrics::quantise(static_)?, super::metrics::quantise(dynamic)?])
    }
}

/// What renders the views of a model without autodiff (see [`Model::plain`]) for [`render_view`].
///
/// # Errors
/// If the device fails.
pub(super) fn view_renderer<'a>(
    model: &'a Model,
    level: DeformationLevel,
    context: &'a RenderContext,
) -> Result<LayerRenderer<'a>, ModelError> {
    let mut wanted = vec![
        Layer::Composed,
        Layer::Static,
        Layer::Dynamic,
        Layer::Mask,
        Layer::MaskedStatic,
        Layer::MaskedDynamic,
        Layer::Motion,
    ];
    if model.static_.is_none() {
        // It would be the composed picture again.
        wanted.retain(|&layer| layer != Layer::Dynamic);
    }
    LayerRenderer::as_trained(model, level, context, &wanted)
}

/// Renders a view by what [`view_renderer`] made, at a moment or without one (see [`LayerRenderer::render`]).
///
/// # Errors
/// If the device fails or an op refuses its input.
pub(super) fn render_view(
    renderer: &LayerRenderer<'_>,
    view: &View,
    moment: Option<f64>,
) -> Result<ViewPictures, ModelError> {
    let rendered = renderer.render(&view.camera, moment)?;
    let of = |layer: Layer| rendered.iter().find(|rendered| rendered.layer == layer);
    let picture = |layer: Layer| of(layer).map(|rendered| renderer.picture(rendered)).transpose();
    let tensor = |layer: Layer| of(layer).map(|rendered| rendered.values.clone().unsqueeze_dim::<4>(0));

    let alone = (picture(Layer::Static)?, picture(Layer::Dynamic)?, picture(Layer::Mask)?);
    let tensors = (tensor(Layer::Static), tensor(Layer::MaskedStatic), tensor(Layer::MaskedDynamic));
    let branches = match (alone, tensors) {
        ((Some(static_), Some(dynamic), Some(mask)), (Some(values), Some(masked_static), Some(masked_dynamic))) => {
            let static_tensor = values.clamp(0.0, 1.0);
            Some(BranchImages { static_, dynamic, mask, masked: [masked_static, masked_dynamic], static_tensor })
        }
        _ => None,
    };
    // Proof: every model can be shown composed, and `view_renderer` asks for it.
    let composed_tensor = tensor(Layer::Composed).expect("composed");
    let composed = super::metrics::quantise(composed_tensor.clone())?;
    Ok(ViewPictures { composed, branches, motion: picture(Layer::Motion)?, composed_tensor })
}
