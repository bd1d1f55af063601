//! The run folder: its files and their contents.

mod aside;
mod checkpoints;
mod evidence;
mod field;
mod files;
mod folder;
mod geometry;
mod images_hash;
mod lock;
mod metrics;
mod open;
mod picture_kind;
mod pictures;
mod pictures_hash;
mod record;
mod replacements;
mod results;
mod scene_file;
mod size;

pub use self::lock::FolderLock;
pub(crate) use aside::remove_files;
pub use aside::{has_anywhere, waits};
pub use checkpoints::{Checkpoint, checkpoints, make_intermediate, newest_checkpoint, put_away, step_file, thin_out};
pub use evidence::{Change, Evidence, Part, config_hash};
pub use field::{FieldPerView, FieldScores};
pub use files::{
    CHECKPOINTS, CONFIG, ENTRIES, FILMS, FINAL, METRICS, PAGE, PANELS, PER_VIEW, POINT_CLOUD, PROTOCOLS, RECORD,
    RENDERS, REPLACEMENTS, REPORT, RESULTS, SCENE, STRIPS, TENSORBOARD, read_json,
};
pub(crate) use files::{MOST_OF_PICTURE, MOST_OF_RECORDS, MOST_OF_SETTINGS};
pub use folder::{Contents, Existing, RUN, RunFolder, RunPlan, is_finished, lock, waiting_note};
pub(crate) use folder::{is_run, place, trial_file};
pub use geometry::SceneGeometry;
pub use images_hash::images_hash;
pub use metrics::{MetricsLine, MetricsLog, milliseconds};
pub use open::{MasksRequest, OpenRun, RunRequest, changed_geometry};
pub use picture_kind::PictureKind;
pub use pictures::{PicturesWriter, legend};
pub use pictures_hash::PicturesHash;
pub use record::{InitialWeights, Resumption, RunRecord, SceneRecord};
pub use replacements::{PsnrChanges, Replaced, Replacements};
#[cfg(test)]
pub(crate) use results::specimen;
pub use results::{EvalTime, GaussianCounts, LpipsWeights, PerView, RenderSpeed, Results, TrainCost};
pub use scene_file::{HeldOutView, SceneCamera, SceneFile};
pub use size::DiskSize;
