//! Rendering and metrics after training.

use std::path::PathBuf;

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use super::keys::keys;

/// Evaluation on the test views. Ours; docs/evaluation.md has the protocols.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(default, deny_unknown_fields)]
pub struct EvalConfig {
    /// A folder of masks (white = dynamic), one per view, with the names of the views: `cam00/0000.png`.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub dynamic_masks: Option<PathBuf>,
    /// A folder with the weights of LPIPS, or `none`. If absent, the folder is the one in the environment variable
    /// MVFUSION_LPIPS, or else the default one of `mvfusion lpips-weights`. Without weights, these metrics are absent.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub lpips_weights: Option<PathBuf>,
    /// Number of evenly spaced test views with side-by-side images; 0 for none.
    pub strips: usize,
    /// Whether every layer of every test view is written as a separate PNG.
    pub pictures: bool,
    /// Whether the training views are evaluated as well (DeGauss: for photos, whose test views show nothing that
    /// moves). Their metrics measure the reconstruction of moving objects, not generalisation.
    pub training_views: bool,
}

impl Default for EvalConfig {
    fn default() -> Self {
        Self { dynamic_masks: None, lpips_weights: None, strips: 6, pictures: true, training_views: false }
    }
}

keys!(EvalConfig { dynamic_masks: ANY, lpips_weights: ANY, strips: FROM_0, pictures: ANY, training_views: ANY });
