//! What a training writes after its last step: the Gaussians and the scores.

use std::io::Write;

use anyhow::Context;
use mvfusion_data::files::read_bytes;
use mvfusion_data::write::gaussian_ply;
use mvfusion_model::train::TrainedModel;

use super::super::score::Scoring;
use super::session::Session;
use crate::run::{self, PicturesWriter, Results, SceneFile, TrainCost};
use crate::{atomic, table, tensorboard};

impl Session {
    /// Writes the Gaussians of the branches.
    pub(super) fn write_gaussians(&self, steps: usize) -> anyhow::Result<()> {
        let iteration = format!("iteration_{steps}");
        let model = self.trainer.state().model.plain();
        for (name, branch) in model.branches() {
            let file = format!("{name}.ply");
            let cloud = branch.to_cloud()?;
            atomic::write(&self.folder.place(&[run::POINT_CLOUD, &iteration, &file])?, &gaussian_ply(&cloud))?;
        }
        Ok(())
    }

    /// Scores the model, writes metrics and images, and prints the table.
    pub(super) fn evaluate(&self, cost: TrainCost, config_sha256: String, out: &mut dyn Write) -> anyhow::Result<()> {
        let config = self.trainer.config();
        let pictures = PicturesWriter::new(self.folder.path(), &config.eval, self.scene.test.len());
        let trained = TrainedModel::from(self.trainer.state());
        let scoring = Scoring {
            trained: &trained,
            scene: &self.scene,
            config,
            config_sha256,
            evaluator: &self.evaluator,
            speed_frames: 0,
            lpips_folder: self.lpips_folder.clone(),
            cost: Some(cost),
            device: &self.device,
            run: self.folder.path(),
            go_on: &|| self.go_on(),
        };
        let scored = scoring.score(Some(&pictures), self.verbosity)?;
        scored.write(self.folder.path())?;
        atomic::write_json(&self.folder.place(&[run::SCENE])?, &SceneFile::of(&self.scene))?;
        table::write(&scored.results, self.evaluator.protocol(), self.verbosity, out)?;
        writeln!(out, "{:16}{}", "run", self.folder.path().display())?;
        if let Some(strip) = pictures.strip_to_see() {
            writeln!(out, "{:16}{}", "start with", strip.display())?;
            writeln!(out, "{:16}({})", "", run::legend(&self.trainer.state().model))?;
        }
        // As late as possible: a run that is killed after this and continued would write them again.
        self.add_scores(cost.steps, &scored.results, &pictures)
    }

    /// Ends the evaluation after a signal. It can be done again from the final checkpoint.
    fn go_on(&self) -> anyhow::Result<()> {
        self.signals.exit_code().map_or(Ok(()), |code| Err(self.interrupted(code).into()))
    }

    /// Writes the metrics and the strips into the event file, if there is one.
    fn add_scores(&self, step: usize, results: &Results, pictures: &PicturesWriter) -> anyhow::Result<()> {
        let Some(events) = &self.events else { return Ok(()) };
        let mut values = tensorboard::of_results(results);
        for path in pictures.strips() {
            let name = path.file_stem().unwrap_or_default().to_string_lossy();
            let bytes = read_bytes(&path, run::MOST_OF_PICTURE);
            let bytes = bytes.with_context(|| format!("cannot read {}", path.display()))?;
            values.push(tensorboard::Value::png(format!("strips/{name}"), bytes)?);
        }
        events.add(step, values)
    }
}
