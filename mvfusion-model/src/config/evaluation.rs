//! What is rendered and scored after training.

use std::path::PathBuf;

use serde::{Deserialize, Serialize};

use super::keys::keys;

/// Evaluation on the test views.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct EvalConfig {
    /// A folder of masks (white = dynamic), one a view and named as the views: `cam00/0000.png`.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub dynamic_masks: Option<PathBuf>,
    /// A folder with the weights of LPIPS; without it the metrics are absent.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub lpips_weights: Option<PathBuf>,
    /// Side-by-side pictures are written for this many test views, evenly spread; 0 for none.
    pub strips: usize,
    /// Whether every layer of every test view is written as a PNG of its own.
    pub pictures: bool,
    /// Whether the views that were trained on are scored as well (DeGauss: for photos, whose test views show nothing that
    /// moves). They say how well the moving things were understood, not how well the model generalises.
    pub training_views: bool,
}

impl Default for EvalConfig {
    fn default() -> Self {
        Self { dynamic_masks: None, lpips_weights: None, strips: 6, pictures: true, training_views: false }
    }
}

keys!(EvalConfig { dynamic_masks: ANY, lpips_weights: ANY, strips: ANY, pictures: ANY, training_views: ANY });
