//! Scoring a model on the held-out views, as both `train` and `eval` do.

use std::path::Path;
use std::time::Instant;

use anyhow::Context;
use image::RgbImage;
use mvfusion_data::{DataError, Scene, View};
use mvfusion_model::evaluation::{
    Evaluation, Evaluator, HeldOutPhoto, Layer, LayerRenderer, Protocol, RefinementSurvey, Scores, Split, ViewPictures,
    evaluate,
};
use mvfusion_model::model::{DeformationLevel, Model, RenderContext};
use mvfusion_model::train::{TrainedModel, parameter_hash};
use mvfusion_model::{Config, Device, ModelError};
use tracing::warn;

use super::speed;
use crate::atomic;
use crate::device::OpenDevice;
use crate::lpips::{LpipsFolder, NamedBy};
use crate::machine::Machine;
use crate::program::Program;
use crate::progress::{Progress, Verbosity};
use crate::run::{
    self, DiskSize, EvalTime, FieldScores, GaussianCounts, LpipsWeights, PerView, PicturesHash, PicturesWriter,
    Results, TrainCost,
};

/// The components of the motion intensity.
const VARIANCES: [Layer; 3] = [Layer::PositionVariance, Layer::RotationVariance, Layer::ScaleVariance];

/// An evaluator of a protocol, with the LPIPS networks if there is a folder of weights.
///
/// # Errors
/// If the folder or a file in it cannot be read, or a file does not fit its network.
pub(super) fn evaluator(
    protocol: Protocol,
    weights: Option<&LpipsFolder>,
    device: &Device,
) -> anyhow::Result<Evaluator> {
    let Some(weights) = weights else { return Ok(Evaluator::without_lpips(protocol)) };
    Evaluator::with_lpips(protocol, &weights.folder, device).with_context(|| match weights.named_by {
        NamedBy::Setting => "cannot use the LPIPS weights; give their folder with --lpips-weights".to_owned(),
        _ => format!("cannot use the LPIPS weights in {weights}; --lpips-weights none leaves LPIPS out"),
    })
}

/// A trained model with all that is needed to score it.
pub(super) struct Scoring<'a> {
    /// The model after the last step.
    pub trained: &'a TrainedModel,
    /// The scene.
    pub scene: &'a Scene,
    /// The configuration, scaled.
    pub config: &'a Config,
    /// SHA-256 of the configuration file.
    pub config_sha256: String,
    /// Computes the metrics.
    pub evaluator: &'a Evaluator,
    /// Frames for measuring the frame rate; 0 skips the measurement.
    pub speed_frames: usize,
    /// The folder of the weights of LPIPS, if there is one.
    pub lpips_folder: Option<LpipsFolder>,
    /// The cost of training, if known.
    pub cost: Option<TrainCost>,
    /// The device.
    pub device: &'a OpenDevice,
    /// The run folder.
    pub run: &'a Path,
    /// Is asked after each view; an error ends the evaluation.
    pub go_on: &'a dyn Fn() -> anyhow::Result<()>,
}

/// Metrics of a model.
pub(super) struct Scored {
    /// For `results.json`.
    pub results: Results,
    /// For `per_view.json`.
    pub per_view: PerView,
}

impl Scored {
    /// Writes both files to an existing folder.
    pub fn write(&self, folder: &Path) -> anyhow::Result<()> {
        atomic::write_json(&folder.join(run::PER_VIEW), &self.per_view)?;
        atomic::write_json(&folder.join(run::RESULTS), &self.results)
    }
}

/// Hashes that identify the images of an evaluation.
struct Hashes {
    predictions: PicturesHash,
    photos: PicturesHash,
    masks: Option<PicturesHash>,
}

impl Hashes {
    fn new(views: &[View]) -> Self {
        let is_masked = views.iter().any(|view| view.truth.dynamic_mask.is_some());
        let hash = || PicturesHash::new(views.len());
        Self { predictions: hash(), photos: hash(), masks: is_masked.then(hash) }
    }

    fn add(&mut self, index: usize, view: &View, composed: &RgbImage) -> Result<(), DataError> {
        self.predictions.add(index, composed);
        self.photos.add(index, &*view.image.rgb()?);
        if let (Some(hash), Some(mask)) = (&mut self.masks, &view.truth.dynamic_mask) {
            hash.add(index, &mask.mask()?);
        }
        Ok(())
    }
}

impl Scoring<'_> {
    /// Renders and scores all held-out views. `pictures` writes those that it needs.
    pub fn score(self, pictures: Option<&PicturesWriter>, verbosity: Verbosity) -> anyhow::Result<Scored> {
        let started = Instant::now();
        let TrainedModel { model, steps } = self.trained;
        let context = RenderContext::new(self.config, self.scene);
        let mut hashes = Hashes::new(&self.scene.test);
        let add = |index, view: &View, composed: &RgbImage| Ok(hashes.add(index, view, composed)?);
        let test = self.score_views(model, Split::Test, &context, pictures, verbosity, add)?;
        let training_views = match self.config.eval.training_views {
            true => Some(self.score_views(model, Split::Training, &context, None, verbosity, |_, _, _| Ok(()))?.mean),
            false => None,
        };
        let seconds = started.elapsed().as_secs_f64();
        let level = self.trained.level(self.config);
        let speed = speed::measure(model, &self.scene.test, level, &context, self.speed_frames, verbosity);
        let speed = speed.unwrap_or_else(|error| {
            // The metrics are more important and took longer to compute.
            verbosity.note(&format!("note:   the frame rate could not be measured: {error}"));
            None
        });
        let refinement = self.survey(model, &context)?.map(|survey| survey.figures());
        let protocol = self.evaluator.protocol();
        let results = Results {
            protocol: protocol.statement().to_owned(),
            test: test.mean,
            training_views,
            refinement,
            gaussians: GaussianCounts::of(model),
            train: self.cost,
            eval: EvalTime { seconds },
            speed,
            lpips: LpipsWeights::of(self.evaluator),
            params_sha256: parameter_hash(model)?,
            config_sha256: self.config_sha256,
            predictions_sha256: hashes.predictions.finish(),
            photos_sha256: hashes.photos.finish(),
            masks_sha256: hashes.masks.map(PicturesHash::finish),
            lpips_folder: self.lpips_folder,
            program: Some(Program::this()),
            machine: Some(Machine::this(self.device)),
            size: DiskSize::of(model, self.run).inspect_err(|error| warn!("{error:#}")).ok(),
            device: self.device.name.clone(),
            threads: rayon::current_num_threads(),
            seed: self.config.seed,
            field: FieldScores::of(protocol, *steps, &test.mean.composed),
        };
        Ok(Scored { results, per_view: PerView::of(protocol, &test, *steps) })
    }

    /// The mean metrics of a model on the held-out views, and on the training views with `eval.training_views` or if the
    /// held-out ones show the static branch alone, which neither MVG nor MFTA changes.
    pub fn means(
        &self,
        model: &Model,
        context: &RenderContext,
        verbosity: Verbosity,
    ) -> anyhow::Result<(Scores, Option<Scores>)> {
        let mean = |split| {
            self.score_views(model, split, context, None, verbosity, |_, _, _| Ok(())).map(|scored| scored.mean)
        };
        let test = mean(Split::Test)?;
        let is_wanted = self.config.eval.training_views || test.composed_shows == Some(HeldOutPhoto::StaticBranch);
        Ok((test, is_wanted.then(|| mean(Split::Training)).transpose()?))
    }

    /// What the motion-aware modules of a model contribute; `None` if they do not take part.
    pub fn survey(&self, model: &Model, context: &RenderContext) -> Result<Option<RefinementSurvey>, ModelError> {
        match self.trained.level(self.config) {
            DeformationLevel::Refined => RefinementSurvey::of(model, context),
            DeformationLevel::Still | DeformationLevel::Base => Ok(None),
        }
    }

    /// Renders and scores a set of views. `add` receives each composed render.
    fn score_views(
        &self,
        model: &Model,
        split: Split,
        context: &RenderContext,
        pictures: Option<&PicturesWriter>,
        verbosity: Verbosity,
        mut add: impl FnMut(usize, &View, &RgbImage) -> anyhow::Result<()>,
    ) -> anyhow::Result<Evaluation> {
        let mut progress = Progress::new("evaluation", split.views(self.scene).len(), verbosity);
        let level = self.trained.level(self.config);
        let variances = match pictures.filter(|pictures| pictures.writes_layers()) {
            Some(_) => self.variances(model, level, context)?,
            None => None,
        };
        let sink = |index, view: &View, layers: &ViewPictures| {
            add(index, view, &layers.composed)?;
            if let Some(pictures) = pictures {
                pictures.write(index, view, layers)?;
                if let Some(renderer) = variances.as_ref().filter(|_| pictures.makes_strip(index)) {
                    write_variances(renderer, pictures, index, view)?;
                }
            }
            progress.say(view.name.clone());
            progress.advance();
            (self.go_on)()
        };
        let evaluation = evaluate(model, self.scene, split, level, context, self.evaluator, sink)?;
        progress.finish();
        Ok(evaluation)
    }

    /// A renderer of the attribute variances, as in the paper's figure; `None` if nothing moves.
    fn variances<'m>(
        &self,
        model: &'m Model,
        level: DeformationLevel,
        context: &'m RenderContext,
    ) -> Result<Option<LayerRenderer<'m>>, ModelError> {
        let can_be_shown = VARIANCES.iter().all(|layer| layer.lacking(model, level).is_none());
        let renderer = || LayerRenderer::new(model, level, context, &VARIANCES, self.config.motion.weights);
        can_be_shown.then(renderer).transpose()
    }
}

/// Writes the images of the attribute variances.
fn write_variances(
    renderer: &LayerRenderer<'_>,
    pictures: &PicturesWriter,
    index: usize,
    view: &View,
) -> anyhow::Result<()> {
    for layer in renderer.render(&view.camera, view.time)? {
        pictures.write_layer(index, layer.layer, &renderer.picture(&layer)?)?;
    }
    Ok(())
}
