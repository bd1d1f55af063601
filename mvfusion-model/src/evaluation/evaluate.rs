//! Renders views, computes their metrics, and averages them.

use std::sync::Arc;

use burn::tensor::Tensor;
use image::{GrayImage, RgbImage};
use mvfusion_data::{Capture, Scene, View};
use tracing::warn;

use super::evaluator::{Evaluator, Pair, Regions, ViewMetrics};
use super::metrics::{MaskOverlap, RegionSource, SmallMovers, TemporalDeviation, sequences};
use super::protocol::Protocol;
use super::render::{ViewPictures, render_view, view_renderer};
use super::scores::{Evaluation, HeldOutPhoto, Scores, ViewScores};
use crate::ModelError;
use crate::model::{DeformationLevel, Model, RenderContext};
use crate::train::mask_tensor;

/// The views of a scene to evaluate.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Split {
    /// Held-out views.
    Test,
    /// Training views. Their metrics measure the reconstruction of moving objects, not generalisation.
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

    /// The content of composed renders of held-out photos under a protocol; `None` for other views, whose moments were
    /// trained. A model with one branch can only show that branch.
    fn composed_shows(self, capture: Capture, model: &Model, protocol: Protocol) -> Option<HeldOutPhoto> {
        match (self, capture, &model.static_) {
            (Self::Training, ..) | (_, Capture::Video, _) => None,
            (Self::Test, Capture::Photos, None) => Some(HeldOutPhoto::AllBranches),
            (Self::Test, Capture::Photos, Some(_)) => Some(protocol.held_out_photos()),
        }
    }

    /// The ground truth of the static branch: the known background, or the photo itself if test views are clean.
    fn clean_background(self, view: &View, capture: Capture) -> Result<Option<Arc<RgbImage>>, ModelError> {
        Ok(match (&view.truth.background, self, capture) {
            (Some(background), ..) => Some(background.rgb()?),
            (None, Self::Test, Capture::Photos) => Some(view.image.rgb()?),
            (None, ..) => None,
        })
    }
}

/// Renders and evaluates views of a scene with a model without autodiff. The frames of a fixed camera are processed in
/// order of time. `sink` receives the renders of every view, with the view's index.
///
/// # Errors
/// If an image cannot be read, the device fails, or the sink fails.
pub fn evaluate<E: From<ModelError>>(
    model: &Model,
    scene: &Scene,
    split: Split,
    level: DeformationLevel,
    context: &RenderContext,
    evaluator: &Evaluator,
    mut sink: impl FnMut(usize, &View, &ViewPictures) -> Result<(), E>,
) -> Result<Evaluation, E> {
    let views = split.views(scene);
    let renderer = view_renderer(model, level, context)?;
    let mut scoring = Scoring {
        split,
        capture: scene.capture,
        composed_shows: split.composed_shows(scene.capture, model, evaluator.protocol()),
        evaluator,
        source: region_source(views),
        overlap: MaskOverlap::default(),
        small_movers: SmallMovers::default(),
        has_warned: false,
    };
    let mut scored: Vec<(usize, ViewScores)> = Vec::with_capacity(views.len());
    for sequence in sequences(views) {
        let varying = scoring.varying_pixels(sequence.iter().map(|&index| &views[index]))?;
        let mut before = None;
        for index in sequence {
            let view = &views[index];
            let moment = (scoring.composed_shows != Some(HeldOutPhoto::StaticBranch)).then_some(view.time);
            let pictures = render_view(&renderer, view, moment)?;
            let (scores, pair) = scoring.score(view, &pictures, varying.as_ref(), before.as_ref())?;
            sink(index, view, &pictures)?;
            scored.push((index, ViewScores { view: view.name.clone(), scores }));
            before = pair;
        }
    }
    scored.sort_by_key(|&(index, _)| index);
    let views: Vec<ViewScores> = scored.into_iter().map(|(_, view)| view).collect();
    let mut mean = Scores::mean(&views);
    mean.mask_iou = scoring.overlap.ratio();
    mean.small_movers = scoring.small_movers.recall();
    Ok(Evaluation { mean, views })
}

/// The source of the dynamic regions: masks if any view has one (exact if all of them are), otherwise temporal
/// deviation.
fn region_source(views: &[View]) -> RegionSource {
    let masked: Vec<&View> = views.iter().filter(|view| view.truth.dynamic_mask.is_some()).collect();
    match masked.iter().all(|view| view.truth.is_mask_exact) {
        _ if masked.is_empty() => RegionSource::TemporalDeviation,
        true => RegionSource::TrueMasks,
        false => RegionSource::GivenMasks,
    }
}

/// The shared state of the evaluation of all views.
struct Scoring<'a> {
    split: Split,
    capture: Capture,
    composed_shows: Option<HeldOutPhoto>,
    evaluator: &'a Evaluator,
    source: RegionSource,
    overlap: MaskOverlap,
    small_movers: SmallMovers,
    /// Whether a view without a valid pixel was warned of.
    has_warned: bool,
}

impl Scoring<'_> {
    /// The dynamic region of a camera's frames, if it is estimated from them.
    fn varying_pixels<'v>(&self, frames: impl Iterator<Item = &'v View>) -> Result<Option<GrayImage>, ModelError> {
        if self.source != RegionSource::TemporalDeviation {
            return Ok(None);
        }
        let frames: Vec<&View> = frames.collect();
        let mut deviation = TemporalDeviation::default();
        // A single photo of a moving camera has no deviation and need not be decoded.
        if frames.len() > 1 {
            for view in frames {
                let photo = view.image.rgb()?;
                deviation.add(&photo);
            }
        }
        Ok(deviation.region())
    }

    /// The metrics of a view, and the pair for the comparison with the next frame, if it has a valid pixel.
    fn score(
        &mut self,
        view: &View,
        pictures: &ViewPictures,
        varying: Option<&GrayImage>,
        before: Option<&Pair>,
    ) -> Result<(Scores, Option<Pair>), ModelError> {
        let valid = ValidMask::of(view)?;
        let given = view.truth.dynamic_mask.as_ref().map(|mask| mask.mask()).transpose()?;
        let movers = view.truth.movers_mask.as_ref().map(|mask| mask.mask()).transpose()?;
        let regions = given.as_ref().or(varying).map(|mask| valid.regions(mask, movers.as_ref()));
        let photo = view.image.rgb()?;
        let pair = valid.pair(&pictures.composed, &pictures.composed_tensor, &photo);
        if valid.is_empty() {
            // Both images are black, which is no evidence of anything.
            if !std::mem::replace(&mut self.has_warned, true) {
                warn!(
                    "{}: its mask excludes every pixel, so the view is not scored, nor is any other like it \
                     (scene.invert_masks)",
                    view.name
                );
            }
            return Ok((Scores { composed_shows: self.composed_shows, ..Scores::default() }, None));
        }
        let ViewMetrics { whole, dynamic, still, movers, temporal } =
            self.evaluator.metrics(&pair, before, regions.as_ref())?;
        let mut scores = Scores {
            composed: whole,
            composed_shows: self.composed_shows,
            dynamic_region: dynamic,
            still_region: still,
            region_source: regions.is_some().then_some(self.source),
            movers,
            temporal,
            ..Scores::default()
        }
        .with_difference();
        if let Some(layers) = &pictures.branches {
            // The mask of a clean view is black by construction, so there is no prediction.
            let predicts = self.composed_shows != Some(HeldOutPhoto::StaticBranch);
            if let (Some(_), Some(regions)) = (given.as_ref().filter(|_| predicts), &regions) {
                let predicted = valid.visible(&layers.mask);
                let (mut overlap, mut small) = (MaskOverlap::default(), SmallMovers::default());
                overlap.add(&predicted, &regions.dynamic);
                // Objects that sway in place are not movers, if movers are known.
                small.add(&predicted, regions.movers.as_ref().unwrap_or(&regions.dynamic));
                (scores.mask_iou, scores.small_movers) = (overlap.ratio(), small.recall());
                self.overlap.merge(overlap);
                self.small_movers.merge(small);
            }
            if let Some(clean) = self.split.clean_background(view, self.capture)? {
                let pair = valid.pair(&layers.static_, &layers.static_tensor, &clean);
                scores.static_ = Some(self.evaluator.metrics(&pair, None, None)?.whole);
            }
        }
        Ok((scores, Some(pair)))
    }
}

/// The valid pixels of a view; both images are black elsewhere, as in nerfbaselines.
struct ValidMask(Option<GrayImage>);

impl ValidMask {
    fn of(view: &View) -> Result<Self, ModelError> {
        Ok(Self(view.mask.as_ref().map(|mask| mask.read()).transpose()?))
    }

    /// Whether no pixel is valid.
    fn is_empty(&self) -> bool {
        self.0.as_ref().is_some_and(|mask| mask.pixels().all(|valid| valid.0[0] == 0))
    }

    /// An image, given in 8 bits and in full precision, and its reference, both black at invalid pixels.
    fn pair(&self, picture: &RgbImage, exact: &Tensor<4>, reference: &RgbImage) -> Pair {
        let Some(mask) = &self.0 else {
            return Pair::new(picture.clone(), exact.clone(), reference.clone());
        };
        let valid = mask_tensor(mask, &exact.device());
        let mut pair = Pair::new(blackened(picture, mask), exact.clone() * valid.clone(), reference.clone());
        pair.reference_exact = pair.reference_exact * valid;
        pair.reference = blackened(&pair.reference, mask);
        pair
    }

    /// An image that is black at invalid pixels.
    fn visible(&self, picture: &RgbImage) -> RgbImage {
        match &self.0 {
            Some(mask) => blackened(picture, mask),
            None => picture.clone(),
        }
    }

    /// The regions into which a mask (white = dynamic) divides the image, and the movers if they are known.
    fn regions(&self, mask: &GrayImage, movers: Option<&GrayImage>) -> Regions {
        let divide = |mask: &GrayImage, is_white: fn(u8) -> bool| {
            let mut part = mask.clone();
            for pixel in part.pixels_mut() {
                pixel.0[0] = if is_white(pixel.0[0]) { u8::MAX } else { 0 };
            }
            if let Some(valid) = &self.0 {
                for (pixel, valid) in part.pixels_mut().zip(valid.pixels()) {
                    pixel.0[0] = pixel.0[0].min(valid.0[0]);
                }
            }
            part
        };
        let white = |level| level >= 128;
        Regions {
            dynamic: divide(mask, white),
            still: divide(mask, |level| level < 128),
            movers: movers.map(|movers| divide(movers, white)),
        }
    }
}

fn blackened(picture: &RgbImage, mask: &GrayImage) -> RgbImage {
    let mut picture = picture.clone();
    for (pixel, valid) in picture.pixels_mut().zip(mask.pixels()) {
        if valid.0[0] == 0 {
            pixel.0 = [0; 3];
        }
    }
    picture
}

#[cfg(test)]
mod tests {
    use image::Luma;
    use mvfusion_data::BuiltinOptions;
    use mvfusion_data::builtin::builtin;
    #[cfg(feature = "flex")]
    use mvfusion_data::{BuiltinKind, Picture};

    use super::*;
    #[cfg(feature = "flex")]
    use crate::{config::Config, device, train::Trainer};

    #[test]
    fn pixels_that_do_not_count_are_in_neither_region() {
        let row = |levels: [u8; 4]| GrayImage::from_raw(4, 1, levels.to_vec()).expect("four pixels");
        let valid = ValidMask(Some(row([255, 255, 0, 0])));
        let regions = valid.regions(&row([128, 127, 255, 0]), Some(&row([200, 100, 255, 0])));
        let white = |mask: &GrayImage| mask.pixels().map(|pixel| *pixel == Luma([255])).collect::<Vec<_>>();
        assert_eq!(regions.movers.as_ref().map(white), Some(vec![true, false, false, false]));
        assert_eq!(white(&regions.dynamic), [true, false, false, false]);
        assert_eq!(white(&regions.still), [false, true, false, false]);
    }

    #[test]
    fn what_is_predicted_where_pixels_do_not_count_is_no_mistake() {
        let valid = ValidMask(Some(GrayImage::from_raw(2, 1, vec![255, 0]).expect("two pixels")));
        let regions = valid.regions(&GrayImage::from_pixel(2, 1, Luma([255])), None);
        assert!(regions.movers.is_none());
        let mut overlap = MaskOverlap::default();
        overlap.add(&valid.visible(&RgbImage::from_pixel(2, 1, image::Rgb([255; 3]))), &regions.dynamic);
        assert_eq!(overlap.ratio(), Some(1.0));
    }

    #[test]
    #[cfg(feature = "flex")]
    fn a_mask_that_is_black_by_construction_is_not_scored() {
        let options =
            BuiltinOptions { width: 16, height: 12, photos: 4, ..BuiltinOptions::of_kind(BuiltinKind::Casual) };
        let mut scene = builtin(&options);
        // Something small is known to move in every held-out photo.
        scene.test.truncate(2);
        for view in &mut scene.test {
            let mut mask = RgbImage::new(view.camera.width as u32, view.camera.height as u32);
            mask.put_pixel(3, 4, image::Rgb([255; 3]));
            view.truth.dynamic_mask = Some(Picture::Memory(Arc::new(mask)));
        }
        let mut config = Config::default();
        (config.model.width, config.model.grid.resolution, config.init.dynamic_points) = (8, [4; 4], 20);
        let trainer = Trainer::new(config, &scene, &device::flex()).expect("the run can start");
        let (model, context) = (trainer.state().model.plain(), trainer.render_context());
        for (protocol, is_scored) in [(Protocol::Mvfusion, false), (Protocol::ThreeDgs, true)] {
            let (evaluator, nothing) = (Evaluator::without_lpips(protocol), |_, _: &_, _: &_| Ok::<(), ModelError>(()));
            let scores = evaluate(&model, &scene, Split::Test, DeformationLevel::Still, context, &evaluator, nothing)
                .expect("the views can be scored");
            let means = std::iter::once(&scores.mean).chain(scores.views.iter().map(|view| &view.scores));
            for mean in means {
                assert_eq!([mean.mask_iou.is_some(), mean.small_movers.is_some()], [is_scored; 2], "{protocol:?}");
                assert!(mean.composed.psnr.is_some() && mean.dynamic_region.is_some());
            }
        }
    }

    #[test]
    fn masks_are_true_only_if_all_of_them_are() {
        let sizes = BuiltinOptions { width: 16, height: 16, frames: 2, ..BuiltinOptions::default() };
        let mut views = builtin(&sizes).test;
        assert_eq!(region_source(&views), RegionSource::TrueMasks);
        views[1].truth.is_mask_exact = false;
        assert_eq!(region_source(&views), RegionSource::GivenMasks);
        views.iter_mut().for_each(|view| view.truth.dynamic_mask = None);
        assert_eq!(region_source(&views), RegionSource::TemporalDeviation);
    }
}
