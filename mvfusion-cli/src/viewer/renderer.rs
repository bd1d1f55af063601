//! Renders what pages ask for, with a model that may change. It uses no random numbers and changes no model.

use anyhow::Context;
use image::{GrayImage, RgbImage};
use mvfusion_data::{Camera, Capture, Scene, View, preview};
use mvfusion_model::config::FusionWeights;
use mvfusion_model::evaluation::{DepthRange, Layer, LayerRenderer, LayerScale, MotionLayers, masked_psnr, psnr};
use mvfusion_model::model::gaussians::BackgroundLevels;
use mvfusion_model::model::{DeformationLevel, Model, Moment, RenderContext};
use mvfusion_model::timeline::spread;

use super::frame::{Answer, FrameFacts, FrameGaussians, FrameTimes, ShownScale, Stopwatch};
use super::moments::{MomentCache, MomentKey};
use super::protocol::{CameraChoice, FrameRequest, ViewId, ViewSet};

/// Bytes of cached moments: 200 of a model with 5000 dynamic Gaussians.
const CACHE: usize = 256 << 20;
/// Training views whose depths give the common scale of depth pictures, and their longest side in pixels.
const DEPTH_VIEWS: usize = 6;
const DEPTH_SIDE: usize = 160;
/// Times that differ by less are the same. Addresses of the page keep six digits.
const SAME_TIME: f64 = 1e-6;

/// Why there is no picture while no model is shown.
const NOTHING: &str = "there is no model to show now; ask again";

/// Where motion layers come from.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum MotionSource {
    /// They are measured when first asked for, with these weights of the motion intensity.
    Measured(FusionWeights),
    /// The last measurement of the training.
    Training,
}

/// The model to show.
#[derive(Clone, Debug)]
pub struct Shown {
    /// The model, without autodiff.
    pub model: Model,
    /// Its level of deformation.
    pub level: DeformationLevel,
    /// Steps that it was trained for.
    pub step: usize,
}

/// Renders pictures for pages.
#[derive(Debug)]
pub struct FrameRenderer {
    /// `None` between two steps of a training, which may then change its tensors in place.
    shown: Option<Shown>,
    /// The model without temporal attention, if that makes a difference.
    without_mfta: Option<Model>,
    context: RenderContext,
    source: MotionSource,
    motion: Option<MotionLayers>,
    /// The common scale of depth pictures; the inner one is `None` if nothing has a depth.
    depths: Option<Option<DepthRange>>,
    moments: MomentCache<Moment>,
    scene: Scene,
    photo: Option<Photo>,
}

/// A photo in the size of the pictures that it was compared with last.
#[derive(Debug)]
struct Photo {
    view: ViewId,
    picture: RgbImage,
    /// Valid pixels.
    mask: Option<GrayImage>,
}

impl FrameRenderer {
    /// A renderer of models of a scene, none of which is shown yet.
    pub fn new(context: RenderContext, scene: Scene, source: MotionSource) -> Self {
        let moments = MomentCache::new(CACHE);
        Self {
            shown: None,
            without_mfta: None,
            context,
            source,
            motion: None,
            depths: None,
            moments,
            scene,
            photo: None,
        }
    }

    /// Shows a model from now on, unless that of the same step is shown.
    pub fn show(&mut self, step: usize, shown: impl FnOnce() -> Shown) {
        if self.shown.as_ref().is_some_and(|shown| shown.step == step) {
            return;
        }
        self.forget();
        let shown = shown();
        self.without_mfta = shown.model.without_mfta(shown.level);
        self.shown = Some(shown);
    }

    /// Lets go of the model, and of everything that was made from it.
    pub fn forget(&mut self) {
        (self.shown, self.without_mfta, self.motion, self.depths) = (None, None, None, None);
        self.moments.clear();
    }

    /// Answers a request.
    pub fn answer(&mut self, request: &FrameRequest) -> Answer {
        self.render(request).unwrap_or_else(|error| Answer::Refused { id: request.id, reason: format!("{error:#}") })
    }

    fn render(&mut self, request: &FrameRequest) -> anyhow::Result<Answer> {
        let camera = self.camera(request);
        let mut watch = Stopwatch::start();
        let mfta = request.mfta && self.without_mfta.is_some();
        let moment = request.time.map(|time| self.moment(time, mfta)).transpose()?;
        let deform = watch.lap();
        let motion = self.motion_of(request.layer)?;
        let depths = self.depths_of(request.layer)?;
        // A measurement for all pictures is no part of this one.
        watch.lap();
        let own = self.context.background;
        let background = BackgroundLevels { grey: request.background.unwrap_or(own.grey), ..own };
        let context = RenderContext { background, ..self.context.clone() };
        let Shown { model, level, step } = self.shown.as_ref().context(NOTHING)?;
        let renderer = LayerRenderer::with_motion(model, *level, &context, &[request.layer], &motion)?;
        let renderer = renderer.with_depths(depths);
        let mut rendered = match &moment {
            Some(moment) => renderer.render_moment(&camera, moment)?,
            None => renderer.render(&camera, None)?,
        };
        let splat = watch.lap();
        // Proof: one layer was asked for.
        let (picture, scale) = renderer.picture_with_scale(&rendered.pop().expect("one layer"))?;
        let read = watch.lap();
        let gaussians = FrameGaussians {
            static_: model.static_.as_ref().map_or(0, |branch| branch.count()),
            dynamic: model.dynamic.count(),
            alive: moment.map_or(0, |moment| moment.gaussians().means.dims()[0]),
        };
        let facts = FrameFacts {
            id: request.id,
            width: camera.width,
            height: camera.height,
            layer: request.layer.name(),
            step: *step,
            time: request.time,
            mfta,
            gaussians,
            ms: FrameTimes { deform, splat, read, encode: 0.0 },
            psnr: self.psnr(request, &picture),
            scale: scale.map(ShownScale::from),
        };
        Answer::frame(facts, &picture, request.quality)
    }

    fn camera(&self, request: &FrameRequest) -> Camera {
        let (width, height) = request.size;
        match request.camera {
            CameraChoice::Pose(camera) => camera,
            CameraChoice::View(view) => self.view(view).camera.resized(width, height),
        }
    }

    fn view(&self, id: ViewId) -> &View {
        // Proof: the protocol checks the index.
        match id.set {
            ViewSet::Train => &self.scene.train[id.index],
            ViewSet::Test => &self.scene.test[id.index],
        }
    }

    /// The Gaussians of a time, from the cache if it has them.
    fn moment(&mut self, time: f64, mfta: bool) -> anyhow::Result<Moment> {
        let key = MomentKey::new(time, mfta);
        if let Some(moment) = self.moments.get(key) {
            return Ok(moment);
        }
        let Shown { model, level, .. } = self.shown.as_ref().context(NOTHING)?;
        let model = if mfta { model } else { self.without_mfta.as_ref().unwrap_or(model) };
        let moment = model.moment(time, *level, &self.context)?;
        self.moments.keep(key, moment.clone(), moment.bytes());
        Ok(moment)
    }

    /// What a motion layer needs.
    fn motion_of(&mut self, layer: Layer) -> anyhow::Result<MotionLayers> {
        if !layer.is_motion() {
            return Ok(MotionLayers::default());
        }
        if let Some(motion) = &self.motion {
            return Ok(motion.clone());
        }
        let model = &self.shown.as_ref().context(NOTHING)?.model;
        let motion = match self.source {
            MotionSource::Measured(weights) => MotionLayers::measure(model, &self.context, weights)?,
            MotionSource::Training => MotionLayers::as_trained(model)?,
        };
        Ok(self.motion.insert(motion).clone())
    }

    /// The common scale of depth pictures. While the model changes, each picture has its own.
    fn depths_of(&mut self, layer: Layer) -> anyhow::Result<Option<DepthRange>> {
        if layer != Layer::Depth || self.source == MotionSource::Training {
            return Ok(None);
        }
        if let Some(depths) = self.depths {
            return Ok(depths);
        }
        let Shown { model, level, .. } = self.shown.as_ref().context(NOTHING)?;
        let small = |camera: &Camera| {
            let share = (DEPTH_SIDE as f64 / camera.width.max(camera.height) as f64).min(1.0);
            let side = |side: usize| ((side as f64 * share) as usize).max(1);
            camera.resized(side(camera.width), side(camera.height))
        };
        let views = spread(self.scene.train.len(), DEPTH_VIEWS).into_iter().map(|index| &self.scene.train[index]);
        let frames: Vec<_> = views.map(|view| (small(&view.camera), Some(view.time))).collect();
        let renderer =
            LayerRenderer::with_motion(model, *level, &self.context, &[Layer::Depth], &MotionLayers::default())?;
        Ok(*self.depths.insert(renderer.with_depths_of(frames)?.depths()))
    }

    /// PSNR against the photo, for a composed picture of what the photo shows: from its camera, at its time, and with
    /// the background of the run.
    fn psnr(&mut self, request: &FrameRequest, picture: &RgbImage) -> Option<f64> {
        let CameraChoice::View(view) = request.camera else { return None };
        let is_own_background = request.background.is_none_or(|grey| grey == self.context.background.grey);
        if request.layer != Layer::Composed || !is_own_background || !self.is_time_of(view, request.time) {
            return None;
        }
        let size = picture.dimensions();
        let photo = match self.photo.take().filter(|photo| photo.view == view && photo.picture.dimensions() == size) {
            Some(photo) => photo,
            // A photo that cannot be read is no reason to show no picture.
            None => self.photo(view, size).inspect_err(|error| tracing::warn!("{error:#}")).ok()?,
        };
        let Photo { picture: photo, mask, .. } = self.photo.insert(photo);
        match mask {
            Some(mask) => masked_psnr(picture, photo, mask),
            None => psnr(picture, photo),
        }
    }

    /// Whether the photo of a view shows this time. Held-out photos of a photo collection show the static scene alone, as
    /// does a model with a static branch.
    fn is_time_of(&self, id: ViewId, time: Option<f64>) -> bool {
        let has_static = self.shown.as_ref().is_some_and(|shown| shown.model.static_.is_some());
        let photo = match (self.scene.capture, id.set) {
            (Capture::Photos, ViewSet::Test) if has_static => None,
            _ => Some(self.view(id).time),
        };
        match (photo, time) {
            (Some(photo), Some(time)) => (photo - time).abs() < SAME_TIME,
            (photo, time) => photo == time,
        }
    }

    fn photo(&self, id: ViewId, (width, height): (u32, u32)) -> anyhow::Result<Photo> {
        let view = self.view(id);
        let whole = view.image.rgb()?;
        let picture = preview::resized(&whole, width, height);
        let mask = view.mask.as_ref().map(|mask| mask.read()).transpose()?;
        Ok(Photo { view: id, picture, mask: mask.map(|mask| preview::resized_mask(&mask, width, height)) })
    }
}

/// The layers that a model cannot show, each with the reason.
pub fn unavailable_layers(
    model: &Model,
    level: DeformationLevel,
    source: MotionSource,
) -> Vec<(&'static str, &'static str)> {
    let reason = |layer: Layer| {
        let not_measured = match (source, layer) {
            (MotionSource::Training, Layer::Motion) => model.motion.is_none().then_some("it is not measured yet"),
            (MotionSource::Training, _) if layer.is_motion() => Some("it is not measured while the model trains"),
            _ => None,
        };
        layer.lacking(model, level).or(not_measured)
    };
    Layer::ALL.into_iter().filter_map(|layer| Some((layer.name(), reason(layer)?))).collect()
}

impl From<LayerScale> for ShownScale {
    fn from(scale: LayerScale) -> Self {
        match scale {
            LayerScale::Depth(DepthRange { near, far }) => Self::Depth { near, far },
            LayerScale::Heat(white) => Self::Heat { white },
        }
    }
}

#[cfg(test)]
mod tests;
