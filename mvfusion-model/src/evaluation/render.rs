//! The layers of one view for an evaluation.

use burn::tensor::Tensor;
use image::RgbImage;
use mvfusion_data::View;

use super::layer::Layer;
use super::layers::LayerRenderer;
use super::tone::{DepthRange, depth_picture};
use crate::model::{DeformationLevel, Model, RenderContext};
use crate::{ModelError, tensors};

/// The layers of a view as 8-bit images.
#[derive(Clone, Debug)]
pub struct ViewPictures {
    /// The whole model: both branches blended, or the only one.
    pub composed: RgbImage,
    /// The images of the branches, in a model with two branches.
    pub branches: Option<BranchImages>,
    /// Motion intensity of the dynamic branch, on its own scale; absent until motion was measured.
    pub motion: Option<RgbImage>,
    /// The composed render in full precision: `[1, 3, H, W]`.
    pub composed_tensor: Tensor<4>,
    /// Depth of the composed render ([`Layer::Depth`]): `[1, H, W]`.
    depth: Tensor<3>,
}

impl ViewPictures {
    /// The depth of the composed render as a grey image, and its scale: the given one, or its own. It is read from the
    /// device on request, because no metric needs it.
    ///
    /// # Errors
    /// If the device fails to return values.
    pub fn depth(&self, range: Option<DepthRange>) -> Result<(RgbImage, DepthRange), ModelError> {
        let [_, _, width] = self.depth.dims();
        let depths: Vec<f32> = tensors::read(self.depth.clone())?;
        let nothing = DepthRange { near: 1.0, far: 1.0 };
        let range = range.or_else(|| DepthRange::of(&depths)).unwrap_or(nothing);
        Ok((depth_picture(&depths, width, range), range))
    }
}

/// The images of the branches of a view.
#[derive(Clone, Debug)]
pub struct BranchImages {
    /// Only the static branch, without brightness control.
    pub static_: RgbImage,
    /// Only the dynamic branch.
    pub dynamic: RgbImage,
    /// The share of the dynamic branch.
    pub mask: RgbImage,
    /// The contributions of the static branch (with brightness control, times its share) and of the dynamic branch to
    /// the composed render: `[1, 3, H, W]` each.
    masked: [Tensor<4>; 2],
    /// The static branch in full precision: `[1, 3, H, W]`.
    pub static_tensor: Tensor<4>,
}

impl BranchImages {
    /// The contributions of the static and of the dynamic branch to the composed render. They are read from the device
    /// on request, because no metric needs them.
    ///
    /// # Errors
    /// If the device fails to return values.
    pub fn masked(&self) -> Result<[RgbImage; 2], ModelError> {
        let [static_, dynamic] = self.masked.clone();
        Ok([super::metrics::quantise(static_)?, super::metrics::quantise(dynamic)?])
    }
}

/// The renderer of a model without autodiff (see [`Model::plain`]) for [`render_view`].
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
        Layer::Depth,
        Layer::Static,
        Layer::Dynamic,
        Layer::Mask,
        Layer::MaskedStatic,
        Layer::MaskedDynamic,
        Layer::Motion,
    ];
    if model.static_.is_none() {
        // It would equal the composed render.
        wanted.retain(|&layer| layer != Layer::Dynamic);
    }
    LayerRenderer::as_trained(model, level, context, &wanted)
}

/// Renders a view with the result of [`view_renderer`], with or without a moment (see [`LayerRenderer::render`]).
///
/// # Errors
/// If the device fails or an op rejects its input.
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
    // Proof: every model has a composed layer and its depth, and `view_renderer` requests both.
    let composed_tensor = tensor(Layer::Composed).expect("composed");
    let depth = of(Layer::Depth).expect("depth").values.clone();
    let composed = super::metrics::quantise(composed_tensor.clone())?;
    Ok(ViewPictures { composed, branches, motion: picture(Layer::Motion)?, composed_tensor, depth })
}
