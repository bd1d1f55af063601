//! Scoring a model on the held-out views, as both `train` and `eval` do.

use std::path::Path;
use std::time::Instant;

use anyhow::Context;
use mvfusion_data::{Scene, View};
use mvfusion_model::evaluation::{Evaluation, Judge, Layer, LayerRenderer, Protocol, Split, ViewPictures, evaluate};
use mvfusion_model::model::{Model, Movement, Surroundings};
use mvfusion_model::train::{TrainState, final_movement, parameter_hash};
use mvfusion_model::{Config, Device, ModelError};

use super::speed;
use crate::atomic;
use crate::progress::{Progress, Talk};
use crate::run::{
    self, EvalTime, FieldScores, GaussianCounts, LpipsWeights, PerView, PicturesHash, PicturesWriter, Results,
    TrainTime,
};

/// The layers of which the motion intensity is made.
const VARIANCES: [Layer; 3] = [Layer::PositionVariance, Layer::RotationVariance, Layer::ScaleVariance];

/// A judge of a protocol, with the networks of LPIPS if there is a folder of weights.
///
/// # Errors
/// If the folder or a file in it cannot be read, or does not fit.
pub(super) fn judge(protocol: Protocol, weights: Option<&Path>, device: &Device) -> anyhow::Result<Judge> {
    match weights {
        None => Ok(Judge::without_lpips(protocol)),
        Some(folder) => Judge::with_lpips(protocol, folder, device)
            .context("cannot use the weights of LPIPS; give their folder with --lpips-weights, or none"),
    }
}

/// A trained model with all that is needed to score it.
pub(super) struct Trained<'a> {
    /// The state after the last step (with autodiff).
    pub state: &'a TrainState,
    /// The scene.
    pub scene: &'a Scene,
    /// The configuration, scaled.
    pub config: &'a Config,
    /// SHA-256 of the configuration as it was written down.
    pub config_sha256: String,
    /// Who compares.
    pub judge: &'a Judge,
    /// Frames over which the speed of rendering is measured; 0 for not at all.
    pub speed_frames: usize,
    /// How long training took, where that is known.
    pub time: Option<TrainTime>,
    /// Name of the device.
    pub device: &'a str,
}

/// Figures of a model.
pub(super) struct Scored {
    /// For `results.json`.
    pub results: Results,
    /// For `per_view.json`.
    pub per_view: PerView,
}

impl Scored {
    /// Writes both files into a folder that is there.
    pub fn write(&self, folder: &Path) -> anyhow::Result<()> {
        atomic::write_json(&folder.join(run::PER_VIEW), &self.per_view)?;
        atomic::write_json(&folder.join(run::RESULTS), &self.results)
    }
}

/// Figures of a set of views, and what tells its pictures from others.
struct ScoredViews {
    evaluation: Evaluation,
    predictions: PicturesHash,
    photos: PicturesHash,
}

impl Trained<'_> {
    /// Renders and scores all held-out views; `pictures` gets what it wants of them.
    pub fn score(self, pictures: Option<&PicturesWriter>, talk: Talk) -> anyhow::Result<Scored> {
        let started = Instant::now();
        let model = self.state.model.plain();
        let surroundings = Surroundings::new(self.config, self.scene);
        let test = self.score_views(&model, Split::Test, &surroundings, pictures, talk)?;
        let training_views = match self.config.eval.training_views {
            true => Some(self.score_views(&model, Split::Training, &surroundings, None, talk)?.evaluation.mean),
            false => None,
        };
        let seconds = started.elapsed().as_secs_f64();
        let movement = final_movement(self.config);
        let speed = speed::measure(&model, &self.scene.test, movement, &surroundings, self.speed_frames, talk)?;
        let protocol = self.judge.protocol().statement();
        let steps = self.state.completed;
        let results = Results {
            protocol: protocol.to_owned(),
            test: test.evaluation.mean,
            training_views,
            gaussians: GaussianCounts::of(&model),
            train: self.time,
            eval: EvalTime { seconds },
            speed,
            lpips: LpipsWeights::of(self.judge),
            params_sha256: parameter_hash(&self.state.model)?,
            config_sha256: self.config_sha256,
            predictions_sha256: test.predictions.finish(),
            photos_sha256: test.photos.finish(),
            device: self.device.to_owned(),
            threads: rayon::current_num_threads(),
            seed: self.config.seed,
            field: FieldScores::of(steps, &test.evaluation.mean.composed),
        };
        Ok(Scored { results, per_view: PerView::of(protocol, &test.evaluation, steps) })
    }

    fn score_views(
        &self,
        model: &Model,
        split: Split,
        surroundings: &Surroundings,
        pictures: Option<&PicturesWriter>,
        talk: Talk,
    ) -> anyhow::Result<ScoredViews> {
        let count = split.views(self.scene).len();
        let mut progress = Progress::new("evaluation", count, talk);
        let (mut predictions, mut photos) = (PicturesHash::new(count), PicturesHash::new(count));
        let movement = final_movement(self.config);
        let variances = match pictures {
            Some(_) => self.variances(model, movement, surroundings)?,
            None => None,
        };
        let sink = |index, view: &View, layers: &ViewPictures| {
            predictions.add(index, &layers.composed);
            photos.add(index, &*view.image.rgb()?);
            if let Some(pictures) = pictures {
                pictures.write(index, view, layers)?;
                if let Some(renderer) = variances.as_ref().filter(|_| pictures.makes_strip(index)) {
                    write_variances(renderer, pictures, index, view)?;
                }
            }
            progress.say(view.name.clone());
            progress.advance();
            anyhow::Ok(())
        };
        let evaluation = evaluate(model, self.scene, split, movement, surroundings, self.judge, sink)?;
        progress.finish();
        Ok(ScoredViews { evaluation, predictions, photos })
    }

    /// What shows how the attributes vary, as in the paper's figure of variances; `None` where nothing moves.
    fn variances<'m>(
        &self,
        model: &'m Model,
        movement: Movement,
        surroundings: &'m Surroundings,
    ) -> Result<Option<LayerRenderer<'m>>, ModelError> {
        let can_be_shown = VARIANCES.iter().all(|layer| layer.lacking(model, movement).is_none());
        let renderer = || LayerRenderer::new(model, movement, surroundings, &VARIANCES, self.config.motion.weights);
        can_be_shown.then(renderer).transpose()
    }
}

/// Writes the pictures of how the attributes vary.
fn write_variances(
    renderer: &LayerRenderer<'_>,
    pictures: &PicturesWriter,
    index: usize,
    view: &View,
) -> anyhow::Result<()> {
    for layer in renderer.render(&view.camera, view.time)? {
        pictures.write_layer(index, layer.layer.name(), &renderer.picture(&layer)?)?;
    }
    Ok(())
}
