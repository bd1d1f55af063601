//! `run.json`: the record of a run.

use std::fmt;
use std::path::{Path, PathBuf};

use anyhow::Context;
use mvfusion_data::Scene;
use mvfusion_model::ModelError;
use mvfusion_model::train::{TrainState, parameter_hash};
use serde::{Deserialize, Serialize};

use super::geometry::SceneGeometry;
use super::images_hash::images_hash;
use crate::clock;
use crate::program::{BURN, GitRevision, Program};

/// The circumstances of a run.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct RunRecord {
    /// Version of this program.
    pub version: String,
    /// Version of Burn.
    pub burn: String,
    /// The revision of its sources; absent if it was built without a repository.
    #[serde(skip_serializing_if = "Option::is_none", default)]
    pub git: Option<GitRevision>,
    /// Cargo features of this build.
    pub features: Vec<String>,
    /// Operating system.
    pub os: String,
    /// Processor.
    pub arch: String,
    /// The command line.
    pub command: Vec<String>,
    /// The preset that the configuration started from.
    pub preset: String,
    /// The scene.
    pub scene: SceneRecord,
    /// Seed of the run.
    pub seed: u64,
    /// Device.
    pub device: String,
    /// CPU threads.
    pub threads: usize,
    /// SHA-256 of `config.toml` as this program wrote it; former versions recorded none.
    #[serde(skip_serializing_if = "Option::is_none", default)]
    pub config_sha256: Option<String>,
    /// The weights that the training began with, if they are another run's.
    #[serde(skip_serializing_if = "Option::is_none", default)]
    pub init_from: Option<InitialWeights>,
    /// Start of the training.
    pub started: String,
    /// When the run was resumed, and after which steps.
    #[serde(skip_serializing_if = "Vec::is_empty", default)]
    pub resumed: Vec<Resumption>,
    /// End of the run; absent until everything has been written.
    #[serde(skip_serializing_if = "Option::is_none", default)]
    pub finished: Option<String>,
}

/// A run was continued from a checkpoint.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct Resumption {
    /// When.
    pub at: String,
    /// Steps that were done before.
    pub step: usize,
}

/// The weights of another run.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct InitialWeights {
    /// Folder of that run.
    pub run: PathBuf,
    /// Steps that it was trained for.
    pub steps: usize,
    /// SHA-256 of its parameters.
    pub params_sha256: String,
}

impl InitialWeights {
    /// The weights in the state of a run.
    ///
    /// # Errors
    /// If the path has no absolute form, or the device fails.
    pub fn of(run: &Path, state: &TrainState) -> anyhow::Result<Self> {
        let run = std::path::absolute(run).with_context(|| format!("cannot use the path {}", run.display()))?;
        Ok(Self { run, steps: state.completed, params_sha256: parameter_hash(&state.model)? })
    }
}

impl fmt::Display for InitialWeights {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "the weights of {} after {} steps", self.run.display(), self.steps)
    }
}

/// A scene in numbers, and what identifies its images.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct SceneRecord {
    /// Its name.
    pub name: String,
    /// Training views.
    pub train_views: usize,
    /// Held-out views.
    pub test_views: usize,
    /// Initial points.
    pub points: usize,
    /// A hash of the training images, see [`images_hash`]; former versions wrote none.
    #[serde(skip_serializing_if = "Option::is_none", default)]
    pub images_sha256: Option<String>,
    /// What identifies cameras, times and points; former versions wrote none.
    #[serde(skip_serializing_if = "Option::is_none", default)]
    pub geometry: Option<SceneGeometry>,
}

impl SceneRecord {
    /// The numbers of a scene.
    ///
    /// # Errors
    /// If an image cannot be read.
    pub fn of(scene: &Scene) -> anyhow::Result<Self> {
        Ok(Self {
            name: scene.name.clone(),
            train_views: scene.train.len(),
            test_views: scene.test.len(),
            points: scene.points.len(),
            images_sha256: Some(images_hash(&scene.train)?),
            geometry: Some(SceneGeometry::of(scene)),
        })
    }

    /// In what the cameras, times and points of a scene differ from those recorded; `None` if they do not, or if none were
    /// recorded.
    pub fn difference(&self, scene: &Scene) -> Option<&'static str> {
        self.geometry.as_ref()?.difference(&SceneGeometry::of(scene))
    }

    /// Rejects a scene whose training images, cameras, times or points are not the recorded ones. What was not recorded is
    /// accepted.
    ///
    /// # Errors
    /// [`ModelError::OtherScene`] with what differs. If an image cannot be read.
    pub fn check(&self, scene: &Scene) -> anyhow::Result<()> {
        if let Some(written) = &self.images_sha256 {
            let now = images_hash(&scene.train)?;
            if now != *written {
                let reason = format!(
                    "its training images are not those of the run, whose `images_sha256` was written as {written} and is \
                     now {now}"
                );
                return Err(ModelError::OtherScene { reason }.into());
            }
        }
        match self.difference(scene) {
            None => Ok(()),
            Some(what) => Err(ModelError::OtherScene { reason: format!("{what} are not those of the run") }.into()),
        }
    }
}

impl RunRecord {
    /// The record of a run that begins now.
    ///
    /// # Errors
    /// If an image of the scene cannot be read.
    pub fn begin(preset: &str, scene: &Scene, seed: u64, device: &str) -> anyhow::Result<Self> {
        let Program { version, git, features } = Program::this();
        Ok(Self {
            version,
            burn: BURN.to_owned(),
            git,
            features,
            os: std::env::consts::OS.to_owned(),
            arch: std::env::consts::ARCH.to_owned(),
            command: std::env::args_os().map(|argument| argument.to_string_lossy().into_owned()).collect(),
            preset: preset.to_owned(),
            scene: SceneRecord::of(scene)?,
            seed,
            device: device.to_owned(),
            threads: rayon::current_num_threads(),
            config_sha256: None,
            init_from: None,
            started: clock::now(),
            resumed: Vec::new(),
            finished: None,
        })
    }

    /// The same for a run that begins with these weights.
    pub fn initialised(self, weights: Option<InitialWeights>) -> Self {
        Self { init_from: weights, ..self }
    }

    /// The same for a run that continues now after `step` steps. It is no longer finished.
    pub fn continued(mut self, step: usize) -> Self {
        self.resumed.push(Resumption { at: clock::now(), step });
        Self { finished: None, ..self }
    }

    /// The same at the end of the run.
    pub fn finished(self) -> Self {
        Self { finished: Some(clock::now()), ..self }
    }
}

#[cfg(test)]
mod tests {
    use mvfusion_data::{BuiltinOptions, Picture, builtin};

    use super::*;

    #[test]
    fn other_images_are_refused_unless_none_were_recorded() {
        let folder = tempfile::tempdir().expect("folder");
        let mut scene = builtin::builtin(&BuiltinOptions { width: 16, height: 16, frames: 1, ..Default::default() });
        let record = SceneRecord::of(&scene).expect("in memory");
        record.check(&scene).expect("the same");
        let mut shifted = scene.clone();
        shifted.train[0].camera.cy += 1.0;
        let error = record.check(&shifted).expect_err("refused").to_string();
        assert!(error.contains("principal points are not those of the run"), "{error}");
        let file = folder.path().join("other.png");
        std::fs::write(&file, "other").expect("written");
        scene.train[0].image = Picture::file(file, (16, 16));
        let error = record.check(&scene).expect_err("refused");
        assert!(matches!(error.downcast_ref(), Some(ModelError::OtherScene { .. })), "{error}");
        let former = r#"{"name": "a", "train_views": 7, "test_views": 1, "points": 3}"#;
        let former: SceneRecord = serde_json::from_str(former).expect("read");
        former.check(&scene).expect("former versions recorded none");
    }
}
