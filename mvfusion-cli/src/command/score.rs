//! Scoring a model on the held-out views, as both `train` and `eval` do.

use std::time::Instant;

use mvfusion_data::{Scene, View};
use mvfusion_model::Config;
use mvfusion_model::evaluation::{Evaluation, Judge, Protocol, Split, ViewPictures, evaluate};
use mvfusion_model::model::{Model, Surroundings};
use mvfusion_model::train::{final_movement, parameter_hash};

use crate::progress::{Progress, Talk};
use crate::run::{EvalTime, GaussianCounts, PicturesWriter, Results, TrainTime};

/// Whose figures are computed.
const PROTOCOL: Protocol = Protocol::Mvfusion;

/// A trained model with all that is needed to score it.
pub(super) struct Trained<'a> {
    /// The model, as trained (with autodiff).
    pub model: &'a Model,
    /// The scene.
    pub scene: &'a Scene,
    /// The configuration, scaled.
    pub config: &'a Config,
    /// How long training took, where that is known.
    pub time: Option<TrainTime>,
    /// Name of the device.
    pub device: &'a str,
}

/// Figures of a model.
pub(super) struct Scored {
    /// For `results.json`.
    pub results: Results,
    /// Each view.
    pub evaluation: Evaluation,
}

impl Trained<'_> {
    /// Renders and scores all held-out views; `pictures` gets what it wants of them.
    pub fn score(self, pictures: Option<&PicturesWriter>, talk: Talk) -> anyhow::Result<Scored> {
        let started = Instant::now();
        let model = self.model.plain();
        let evaluation = self.score_split(&model, Split::Test, pictures, talk)?;
        let training_views = match self.config.eval.training_views {
            true => Some(self.score_split(&model, Split::Training, None, talk)?.mean),
            false => None,
        };
        let results = Results {
            protocol: PROTOCOL.statement().to_owned(),
            test: evaluation.mean,
            training_views,
            gaussians: GaussianCounts::of(&model),
            train: self.time,
            eval: EvalTime { seconds: started.elapsed().as_secs_f64() },
            params_sha256: parameter_hash(self.model)?,
            device: self.device.to_owned(),
            threads: rayon::current_num_threads(),
            seed: self.config.seed,
        };
        Ok(Scored { results, evaluation })
    }

    fn score_split(
        &self,
        model: &Model,
        split: Split,
        pictures: Option<&PicturesWriter>,
        talk: Talk,
    ) -> anyhow::Result<Evaluation> {
        let surroundings = Surroundings::new(self.config, self.scene);
        let movement = final_movement(self.config);
        let mut progress = Progress::new("evaluation", split.views(self.scene).len(), talk);
        let judge = Judge::without_lpips(PROTOCOL);
        let sink = |index, view: &View, layers: &ViewPictures| {
            if let Some(pictures) = pictures {
                pictures.write(index, view, layers)?;
            }
            progress.say(view.name.clone());
            progress.advance();
            anyhow::Ok(())
        };
        let evaluation = evaluate(model, self.scene, split, movement, &surroundings, &judge, sink)?;
        progress.finish();
        Ok(evaluation)
    }
}
