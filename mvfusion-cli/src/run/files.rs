//! The names of the files and folders within a run's folder.

/// The resolved configuration.
pub const CONFIG: &str = "config.toml";
/// What was done: versions, device, times.
pub const RECORD: &str = "run.json";
/// A line for every log step.
pub const METRICS: &str = "metrics.jsonl";
/// The metrics.
pub const RESULTS: &str = "results.json";
/// The metrics of each view.
pub const PER_VIEW: &str = "per_view.json";
/// Folder of the states.
pub const CHECKPOINTS: &str = "checkpoints";
/// The state after the last step, within [`CHECKPOINTS`].
pub const FINAL: &str = "final.safetensors";
/// Folder of the Gaussians.
pub const POINT_CLOUD: &str = "point_cloud";
/// Folder of the evaluation's pictures.
pub const RENDERS: &str = "renders";
/// Folder of what `mvfusion render` makes, a folder for each kind of views.
pub const FILMS: &str = "films";
/// Folder of the metrics of other protocols, with one folder for each.
pub const PROTOCOLS: &str = "protocols";
/// Folder of the side-by-side pictures.
pub const STRIPS: &str = "strips";
/// The run on one page.
pub const REPORT: &str = "report.html";

/// All that a run writes at the top of its folder.
pub const ENTRIES: [&str; 12] =
    [CONFIG, RECORD, METRICS, RESULTS, PER_VIEW, PROTOCOLS, CHECKPOINTS, POINT_CLOUD, RENDERS, FILMS, STRIPS, REPORT];

/// Name of the pictures of the view of this number.
pub(super) fn picture_file(index: usize) -> String {
    format!("{index:05}.png")
}
