//! The evaluation protocol `mvfusion`: which pictures are compared with which, and how figures are averaged.

use std::sync::Arc;

use burn::tensor::Tensor;
use image::{GrayImage, RgbImage};
use mvfusion_data::{Capture, Scene, View};
use serde::{Deserialize, Serialize};

use super::metrics::{MaskOverlap, masked_psnr, psnr, ssim};
use super::render::{ViewPictures, render_view};
use crate::ModelError;
use crate::model::{Model, Movement, Surroundings};
use crate::train::{mask_tensor, picture_tensor};

/// Name of the protocol, written beside every figure: last iteration, PSNR after an 8-bit round trip and averaged over
/// views, SSIM with zero padding on unrounded pictures, static branch against the clean background.
pub const PROTOCOL: &str = "mvfusion-1: last iteration; PSNR of 8-bit pictures, mean over views; SSIM 11x11 sigma 1.5 zero-padded; \
     dynamic region and mask IoU where masks are known, IoU pooled at 0.5; pixels that a view's mask ignores are black";

/// Figures of a layer. A figure that is not known is absent.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct LayerScores {
    /// Mean PSNR in dB.
    #[serde(skip_serializing_if = "Option::is_none", default)]
    pub psnr: Option<f64>,
    /// Mean SSIM.
    #[serde(skip_serializing_if = "Option::is_none", default)]
    pub ssim: Option<f64>,
}

/// Figures of a set of views.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Scores {
    /// The blended picture against the photo.
    pub composed: LayerScores,
    /// The static branch against the clean background.
    #[serde(rename = "static", skip_serializing_if = "Option::is_none", default)]
    pub static_: Option<LayerScores>,
    /// The blended picture against the photo, inside the true dynamic mask.
    #[serde(skip_serializing_if = "Option::is_none", default)]
    pub dynamic_region: Option<LayerScores>,
    /// Overlap of predicted and true mask.
    #[serde(skip_serializing_if = "Option::is_none", default)]
    pub mask_iou: Option<f64>,
}

/// Figures of one view.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct ViewScores {
    /// The view's name.
    pub view: String,
    /// Its figures.
    #[serde(flatten)]
    pub scores: Scores,
}

/// The result of an evaluation.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Evaluation {
    /// Means over the views.
    pub mean: Scores,
    /// Each view.
    pub views: Vec<ViewScores>,
}

/// Which views of a scene are scored.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Split {
    /// Those held out.
    Test,
    /// Those trained on: how well what moves there was understood, not how well the model generalises.
    Training,
}

impl Split {
    /// The views.
    pub fn views(self, scene: &Scene) -> &[View] {
        match self {
            Self::Test => &scene.test,
            Self::Training => &scene.train,
        }
    }

    /// What the static branch should show: the known background, or the photo itself where test views are clean.
    fn clean_background(self, view: &View, capture: Capture) -> Result<Option<Arc<RgbImage>>, ModelError> {
        Ok(match (&view.truth.background, self, capture) {
            (Some(background), ..) => Some(background.rgb()?),
            (None, Self::Test, Capture::Photos) => Some(view.image.rgb()?),
            (None, ..) => None,
        })
    }
}

/// Renders and scores views of a scene with a model without autodiff. `sink` gets every view's pictures, to show or to
/// keep.
///
/// # Errors
/// If a picture cannot be read, the device fails, or the sink does.
pub fn evaluate<E: From<ModelError>>(
    model: &Model,
    scene: &Scene,
    split: Split,
    movement: Movement,
    surroundings: &Surroundings,
    mut sink: impl FnMut(usize, &View, &ViewPictures) -> Result<(), E>,
) -> Result<Evaluation, E> {
    let mut views = Vec::with_capacity(split.views(scene).len());
    let mut overlap = MaskOverlap::default();
    for (index, view) in split.views(scene).iter().enumerate() {
        let pictures = render_view(model, view, movement, surroundings)?;
        let clean = split.clean_background(view, scene.capture)?;
        let scores = score(&pictures, view, clean.as_deref(), &mut overlap)?;
        sink(index, view, &pictures)?;
        views.push(ViewScores { view: view.name.clone(), scores });
    }
    let mut mean = average(&views);
    mean.mask_iou = overlap.ratio();
    Ok(Evaluation { mean, views })
}

fn score(
    pictures: &ViewPictures,
    view: &View,
    clean: Option<&RgbImage>,
    overlap: &mut MaskOverlap,
) -> Result<Scores, ModelError> {
    let photo = view.image.rgb()?;
    let counted = Counted::of(view)?;
    let mask = view.truth.dynamic_mask.as_ref().map(|mask| mask.mask()).transpose()?;
    let mask = mask.map(|mask| counted.within(mask));
    let composed = counted.compare(&pictures.composed, &pictures.composed_tensor, &photo)?;
    let dynamic_region = mask.as_ref().and_then(|mask| region(&pictures.composed, &photo, mask));
    let mut mask_iou = None;
    if let (Some(mask), Some(layers)) = (&mask, &pictures.branches) {
        overlap.add(&layers.mask, mask);
        let mut own = MaskOverlap::default();
        own.add(&layers.mask, mask);
        mask_iou = own.ratio();
    }
    let static_ = match (&pictures.branches, clean) {
        (Some(layers), Some(clean)) => Some(counted.compare(&layers.static_, &layers.static_tensor, clean)?),
        _ => None,
    };
    Ok(Scores { composed, static_, dynamic_region, mask_iou })
}

fn region(picture: &RgbImage, photo: &RgbImage, mask: &GrayImage) -> Option<LayerScores> {
    masked_psnr(picture, photo, mask).map(|psnr| LayerScores { psnr: Some(psnr), ssim: None })
}

/// Which pixels of a view count; both pictures are black elsewhere, as nerfbaselines has it.
struct Counted(Option<GrayImage>);

impl Counted {
    fn of(view: &View) -> Result<Self, ModelError> {
        Ok(Self(view.mask.as_ref().map(|mask| mask.read()).transpose()?))
    }

    /// The figures of a picture, given in 8 bits and in full precision.
    fn compare(&self, picture: &RgbImage, exact: &Tensor<4>, reference: &RgbImage) -> Result<LayerScores, ModelError> {
        let device = exact.device();
        let reference_tensor = picture_tensor(reference, &device);
        let Some(mask) = &self.0 else {
            return Ok(LayerScores {
                psnr: psnr(picture, reference),
                ssim: Some(ssim(exact.clone(), reference_tensor)?),
            });
        };
        let counted = mask_tensor(mask, &device);
        Ok(LayerScores {
            psnr: psnr(&blackened(picture, mask), &blackened(reference, mask)),
            ssim: Some(ssim(exact.clone() * counted.clone(), reference_tensor * counted)?),
        })
    }

    /// A mask, black where pixels do not count.
    fn within(&self, mut mask: GrayImage) -> GrayImage {
        if let Some(counted) = &self.0 {
            for (pixel, counted) in mask.pixels_mut().zip(counted.pixels()) {
                pixel.0[0] = pixel.0[0].min(counted.0[0]);
            }
        }
        mask
    }
}

fn blackened(picture: &RgbImage, mask: &GrayImage) -> RgbImage {
    let mut picture = picture.clone();
    for (pixel, counted) in picture.pixels_mut().zip(mask.pixels()) {
        if counted.0[0] == 0 {
            pixel.0 = [0; 3];
        }
    }
    picture
}

/// Means over the views that have the figure; absent if none has.
fn average(views: &[ViewScores]) -> Scores {
    let mean = |figure: &dyn Fn(&Scores) -> Option<f64>| -> Option<f64> {
        let known: Vec<f64> = views.iter().filter_map(|view| figure(&view.scores)).collect();
        (!known.is_empty()).then(|| known.iter().sum::<f64>() / known.len() as f64)
    };
    let layer = |layer: &dyn Fn(&Scores) -> Option<LayerScores>| LayerScores {
        psnr: mean(&|scores| layer(scores)?.psnr),
        ssim: mean(&|scores| layer(scores)?.ssim),
    };
    let known = |scores: LayerScores| (scores != LayerScores::default()).then_some(scores);
    Scores {
        composed: layer(&|scores| Some(scores.composed)),
        static_: known(layer(&|scores| scores.static_)),
        dynamic_region: known(layer(&|scores| scores.dynamic_region)),
        mask_iou: None,
    }
}
