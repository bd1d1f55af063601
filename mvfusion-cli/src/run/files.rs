//! The names of the files and folders in a run folder.

use std::path::Path;

use anyhow::Context;
use mvfusion_data::files::read_text;
use serde::de::DeserializeOwned;

/// The resolved configuration.
pub const CONFIG: &str = "config.toml";
/// The record of the run: versions, device, times.
pub const RECORD: &str = "run.json";
/// One line per log step.
pub const METRICS: &str = "metrics.jsonl";
/// Folder of the event files for TensorBoard.
pub const TENSORBOARD: &str = "tensorboard";
/// The metrics.
pub const RESULTS: &str = "results.json";
/// The metrics of each view.
pub const PER_VIEW: &str = "per_view.json";
/// The cameras and times of the views, and the extent of the scene.
pub const SCENE: &str = "scene.json";
/// The metrics with replaced outputs of the motion-aware modules.
pub const REPLACEMENTS: &str = "replacements.json";
/// Folder of the checkpoints.
pub const CHECKPOINTS: &str = "checkpoints";
/// The state after the last step, within [`CHECKPOINTS`].
pub const FINAL: &str = "final.safetensors";
/// Folder of the Gaussians.
pub const POINT_CLOUD: &str = "point_cloud";
/// Folder of the images that the evaluation writes.
pub const RENDERS: &str = "renders";
/// Folder of the output of `mvfusion render`, with one folder for each kind of views.
pub const FILMS: &str = "films";
/// Folder of the metrics under other protocols, with one folder for each.
pub const PROTOCOLS: &str = "protocols";
/// Folder of the side-by-side images.
pub const STRIPS: &str = "strips";
/// What the panels of the side-by-side images show, within [`STRIPS`].
pub const PANELS: &str = "panels.json";
/// The report of the run.
pub const REPORT: &str = "report.html";

/// The page of `mvfusion export --html`, which plays the scene.
pub const PAGE: &str = "scene.html";

/// Everything that a run writes at the top level of its folder.
pub const ENTRIES: [&str; 16] = [
    CONFIG,
    RECORD,
    METRICS,
    TENSORBOARD,
    RESULTS,
    PER_VIEW,
    SCENE,
    REPLACEMENTS,
    PROTOCOLS,
    CHECKPOINTS,
    POINT_CLOUD,
    RENDERS,
    FILMS,
    STRIPS,
    REPORT,
    PAGE,
];

/// Bytes of a configuration, a grid, or another file that a person may write. The largest grid of ours has 10 kB.
pub(crate) const MOST_OF_SETTINGS: u64 = 1 << 22;
/// Bytes of a file with one entry for each run, view, cell or log step. An entry takes at most a few kilobytes.
pub(crate) const MOST_OF_RECORDS: u64 = 1 << 28;
/// Bytes of an image.
pub(crate) const MOST_OF_PICTURE: u64 = 1 << 30;

/// Reads a JSON file of a run.
///
/// # Errors
/// If it cannot be read or is not what this version writes.
pub fn read_json<T: DeserializeOwned>(path: &Path) -> anyhow::Result<T> {
    let read = || -> anyhow::Result<T> { Ok(serde_json::from_str(&read_text(path, MOST_OF_RECORDS)?)?) };
    read().with_context(|| format!("cannot read {}", path.display()))
}

/// File name of the images of a view with this index.
pub(super) fn picture_file(index: usize) -> String {
    format!("{index:05}.png")
}
