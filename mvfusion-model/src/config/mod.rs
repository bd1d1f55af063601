//! The configuration of a run, as one tree of plain structs. On disk it is TOML, and unknown keys are rejected.
//!
//! The defaults are those of the preset `neu3d` at full length (METHOD §11, columns Neu3D, with the MVFusion overrides
//! of §11.2). A shipped preset contains only its changes. Each default cites its source.

mod check;
mod contradiction;
mod densify;
mod describe;
mod evaluation;
mod keys;
mod loss;
mod model;
mod motion;
mod open_scene;
mod optim;
mod range;
mod scale;
mod scene;
mod schema;
mod sources;
mod steps;
mod times;
mod train;
mod variants;

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use keys::{Key, ListedKey, Range, keys};

pub use densify::{BranchDensifyConfig, DensifyConfig, OpacityReset};
pub use describe::{Choice, KeyKind, KeyNotes};
pub use evaluation::EvalConfig;
pub use keys::{NumberKind, NumericKey};
pub use loss::LossConfig;
pub use model::{Background, Branches, GridBoundsRule, GridConfig, ModelConfig, TimeRows, Uncovered};
pub use motion::{FusionWeights, MotionConfig, Spread, StillRule};
pub use optim::{Decay, OptimConfig};
pub(crate) use scene::LEAST_MOTION_DURATION;
pub use scene::{InitConfig, SceneConfig, SceneKind};
pub use steps::{Interval, Steps};
pub use train::{BadStepRule, StageConfig, TrainConfig};
pub use variants::{
    Activation, Descriptor, Normalisation, Refinement, Temporal, TokenMode, TokenOffset, TokenValues, Trajectory,
};

/// The configuration of a run.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(default, deny_unknown_fields)]
pub struct Config {
    /// Seed of every random stream of the run. Ours.
    pub seed: u64,
    /// How the scene is read.
    pub scene: SceneConfig,
    /// The clouds of Gaussians before the first step.
    pub init: InitConfig,
    /// The branches and the deformation network.
    pub model: ModelConfig,
    /// MVG and MFTA.
    pub motion: MotionConfig,
    /// The schedule of training.
    pub train: TrainConfig,
    /// Learning rates.
    pub optim: OptimConfig,
    /// Densification of both branches.
    pub densify: DensifyConfig,
    /// The losses.
    pub loss: LossConfig,
    /// Evaluation on the test views.
    pub eval: EvalConfig,
}

keys!(Config {
    seed: SEED,
    scene: ANY,
    init: ANY,
    model: ANY,
    motion: ANY,
    train: ANY,
    optim: ANY,
    densify: ANY,
    loss: ANY,
    eval: ANY,
});

impl Config {
    /// Every number of the configuration, with its valid values. The range of a key may depend on another key.
    pub fn numeric_keys(&self) -> Vec<NumericKey> {
        self.listed().into_iter().filter_map(|listed| listed.number).collect()
    }

    /// Every key, in the order of the declarations. The first is that of the whole, which is empty.
    fn listed(&self) -> Vec<ListedKey> {
        let mut listed = Vec::new();
        self.list("", Range::ANY, &mut listed);
        listed
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_number_has_two_ends() {
        let numbers = Config::default().numeric_keys();
        let open: Vec<&str> = numbers
            .iter()
            .filter(|number| !(number.least.is_finite() && number.most.is_finite() && number.least < number.most))
            .map(|number| number.key.as_str())
            .collect();
        // Photos are taken of rooms without an end.
        assert_eq!(open, ["init.box_reach"]);
    }
}
