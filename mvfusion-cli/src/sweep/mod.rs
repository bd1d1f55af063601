//! Sweeps: a grid of runs, run by this machine or by a cluster, and the table that comes of it.
//!
//! ```text
//! grid file ─► Grid ─► Plan (cells, each resolved and checked) ─► sweep.json, cells/ID.toml
//!                         local processes, or tasks of SLURM ─► run_cell ─► cells/ID/
//!                                           results.json of each ─► Table ─► Markdown, LaTeX, CSV, JSON, plots
//! ```
//! Nothing is kept in memory between the steps: the folder says what is to do, so that a sweep can be interrupted,
//! looked at, and gone on with by any process that sees the folder.

mod amendments;
mod cell;
mod check;
mod estimate;
mod folder;
mod grid;
mod index;
mod jobs;
mod local;
mod metric;
mod plan;
mod probe;
mod shipped;
mod slurm;
pub mod table;

pub use amendments::{Amendment, sentence as amendment_note};
pub use cell::run_cell;
pub use estimate::Estimate;
pub use folder::{State, SweepFolder};
pub use grid::{ColumnGroup, Difference, Expected, Grid, PaperRow, SceneEntry, Source, VariantEntry};
pub use index::{Cell, Index};
pub use jobs::default_jobs;
pub use local::Local;
pub use metric::TableMetric;
pub use plan::{Additions, Plan};
pub use probe::seconds as probe_seconds;
pub use shipped::{SHIPPED, Shipped, find as find_shipped, names as shipped_names, suggestion as suggested_grid};
pub use slurm::Slurm;
