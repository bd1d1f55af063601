//! A run's folder: which files there are, and what stands in them.

mod field;
mod folder;
mod metrics;
mod open;
mod pictures;
mod pictures_hash;
mod ply;
mod record;
mod results;

pub use field::{FieldPerView, FieldScores};
pub use folder::{Contents, Existing, RunFolder, RunPlan};
pub(crate) use folder::{place, trial_file};
pub use metrics::{MetricsLine, MetricsLog, milliseconds};
pub use open::{MasksRequest, OpenRun, RunRequest};
pub use pictures::{PicturesWriter, legend};
pub use pictures_hash::PicturesHash;
pub use ply::write_ply;
pub use record::{RunRecord, SceneRecord};
#[cfg(test)]
pub(crate) use results::specimen;
pub use results::{EvalTime, GaussianCounts, LpipsWeights, PerView, RenderSpeed, Results, TrainTime};

/// The resolved configuration.
pub const CONFIG: &str = "config.toml";
/// What was done: versions, device, times.
pub const RECORD: &str = "run.json";
/// A line for every log step.
pub const METRICS: &str = "metrics.jsonl";
/// The figures.
pub const RESULTS: &str = "results.json";
/// The figures of each view.
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
/// Folder of what other protocols than ours say, a folder each.
pub const PROTOCOLS: &str = "protocols";
/// Folder of the side-by-side pictures.
pub const STRIPS: &str = "strips";
/// All of it on one page.
pub const REPORT: &str = "report.html";

/// All that a run writes at the top of its folder.
pub const ENTRIES: [&str; 12] =
    [CONFIG, RECORD, METRICS, RESULTS, PER_VIEW, PROTOCOLS, CHECKPOINTS, POINT_CLOUD, RENDERS, FILMS, STRIPS, REPORT];
