//! Checkpoints that are damaged, crafted, or of other versions. All of them are made from one small state that holds
//! every kind of tensor.

mod crafted;
mod damage;
mod fields;
mod parts;
mod versions;

use std::fs;
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::path::{Path, PathBuf};
use std::sync::LazyLock;

use mvfusion_data::builtin::builtin;
use mvfusion_data::{BuiltinOptions, Scene};
use tempfile::TempDir;

use self::parts::Parts;
use crate::ModelError;
use crate::config::{
    BranchDensifyConfig, Config, DensifyConfig, GridConfig, InitConfig, ModelConfig, MotionConfig, StageConfig,
    TrainConfig,
};
use crate::device::flex;
use crate::train::{TrainState, TrainedModel, Trainer};

/// Steps of the state: in the last stage, between the two halves of an accumulated gradient.
const DONE: usize = 5;

/// The scene of the state.
fn scene() -> Scene {
    let mut scene = builtin(&BuiltinOptions { width: 24, height: 16, frames: 3, ..BuiltinOptions::default() });
    scene.points.positions.truncate(12);
    scene.points.colours.truncate(12);
    scene
}

/// The configuration of the state.
fn config() -> Config {
    let defaults = DensifyConfig::default();
    let few = |branch: &BranchDensifyConfig| BranchDensifyConfig { max_gaussians: 30, ..branch.clone() };
    let densify = DensifyConfig { dynamic: few(&defaults.dynamic), static_: few(&defaults.static_), ..defaults };
    Config {
        init: InitConfig { dynamic_points: 10, dynamic_from_cloud: 0, motion_points: 0, ..InitConfig::default() },
        model: ModelConfig {
            width: 4,
            grid: GridConfig {
                features: 2,
                resolution: [3, 4, 5, 6],
                multipliers: vec![1, 2],
                ..GridConfig::default()
            },
            sh_degree: 1,
            lifetime: true,
            exposure: true,
            ..ModelConfig::default()
        },
        motion: MotionConfig {
            samples: 3,
            knot_stride: 1,
            window: 1,
            hidden: 4,
            attention_width: 4,
            heads: 2,
            octaves: 1,
            ..MotionConfig::default()
        },
        train: TrainConfig {
            stages: StageConfig::of([2, 2, 4]),
            batch_size: 2,
            accumulation: 2,
            ..TrainConfig::default()
        },
        densify,
        ..Config::default()
    }
}

/// The bytes of the checkpoint of the state.
static BYTES: LazyLock<Vec<u8>> = LazyLock::new(|| {
    let mut trainer = Trainer::new(config(), &scene(), &flex()).expect("the run can start");
    (0..DONE).for_each(|_| assert!(trainer.step().expect("a step succeeds").is_some()));
    let folder = tempfile::tempdir().expect("a temporary folder");
    let path = folder.path().join("whole.safetensors");
    trainer.state().save(&path).expect("the state can be saved");
    fs::read(path).expect("it is there")
});

/// A checkpoint file that tests change.
struct Specimen {
    _folder: TempDir,
    path: PathBuf,
}

impl Specimen {
    fn new() -> Self {
        let folder = tempfile::tempdir().expect("a temporary folder");
        let path = folder.path().join("tried.safetensors");
        Self { _folder: folder, path }
    }

    fn write(&self, bytes: &[u8]) -> &Path {
        fs::write(&self.path, bytes).expect("written");
        &self.path
    }

    /// What is said of a file with these bytes, by training alone.
    fn refusal_of_training(&self, bytes: &[u8]) -> Option<String> {
        let load = || said(&TrainState::load(self.write(bytes), &config(), &flex().autodiff()).map(drop));
        catch_unwind(AssertUnwindSafe(load)).unwrap_or_else(|_| panic!("reading panics"))
    }

    /// What is said of a file with these bytes, by training and by evaluation: `None` if both accept it.
    fn refusal(&self, bytes: &[u8]) -> Option<String> {
        refusal_of(self.write(bytes), &config())
    }
}

/// What is said of a file, by training and by evaluation.
fn refusal_of(path: &Path, config: &Config) -> Option<String> {
    let device = flex().autodiff();
    let both = || {
        let state = TrainState::load(path, config, &device).map(drop);
        let model = TrainedModel::load(path, config, &flex()).map(drop);
        assert_eq!(said(&state), said(&model), "training and evaluation disagree");
        said(&state)
    };
    let said = catch_unwind(AssertUnwindSafe(both)).unwrap_or_else(|_| panic!("reading {} panics", path.display()));
    let said = said?;
    assert!(said.contains("tried.safetensors"), "the file is not named: {said}");
    Some(said)
}

fn said(result: &Result<(), ModelError>) -> Option<String> {
    result.as_ref().err().map(ToString::to_string)
}

/// Whether a text is short enough for a terminal.
fn is_short(said: &str) -> bool {
    said.len() < 700
}

#[test]
fn the_state_holds_every_kind_of_tensor() {
    let parts = Parts::of(&BYTES);
    for group in [
        "dynamic.velocities",
        "static.sh_rest",
        "network.grid.planes",
        "network.masks.",
        "refinement.attention.",
        "refinement.encoder.",
        "exposures.departures",
        "motion.local",
        "statistics.static.seen",
        "pending.means",
        "pending.screen",
        "pending.visible",
        "adam.dynamic.means.first",
        "adam.trunk.",
        "adam.refinement.encoder.",
        "adam.exposures.",
    ] {
        assert!(parts.tensors.keys().any(|name| name.starts_with(group)), "{group}");
    }
    assert_eq!(Specimen::new().refusal(&BYTES), None);
    assert_eq!(Specimen::new().refusal(&parts.bytes()), None, "taken apart and joined");
}
