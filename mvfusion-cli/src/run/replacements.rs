//! `replacements.json`: the metrics of a run with replaced outputs of its motion-aware modules.

use mvfusion_model::evaluation::{Replacement, Scores};
use mvfusion_model::model::motion::MotionModule;
use serde::{Deserialize, Serialize};

/// `replacements.json`.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Replacements {
    /// SHA-256 of all learned parameters.
    pub params_sha256: String,
    /// Metrics of the held-out views, with the modules' own outputs.
    pub test: Scores,
    /// The same of the training views, if `eval.training_views` is set.
    #[serde(skip_serializing_if = "Option::is_none", default)]
    pub training_views: Option<Scores>,
    /// The metrics with one output replaced.
    pub replaced: Vec<Replaced>,
}

/// Metrics with the output of one module replaced.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Replaced {
    /// The module.
    pub module: MotionModule,
    /// What replaces its output.
    pub replacement: Replacement,
    /// Metrics of the held-out views.
    pub test: Scores,
    /// The same of the training views.
    #[serde(skip_serializing_if = "Option::is_none", default)]
    pub training_views: Option<Scores>,
}
