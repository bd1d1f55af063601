//! The table that a sweep is for, and the curves over its swept keys.
//!
//! [`Table::of`] makes the means and spreads from what the cells yielded; the other files write them down, each in one
//! format. What is shown is rounded; `table.csv`, `seeds.csv` and `table.json` have the numbers in full.

mod build;
mod csv;
mod entry;
mod json;
mod latex;
mod markdown;
mod notes;
mod origins;
mod paper;
mod plot;
mod plots;
mod regions;
mod scale;
#[cfg(test)]
pub(super) mod specimen;
mod verdict;
mod write;

use std::collections::BTreeMap;

use mvfusion_model::evaluation::RegionSource;
use serde::Serialize;

pub use origins::{Mixture, Origin};
pub use plots::{Plot, Point, Series};
pub use verdict::{Effect, Interval, SceneVerdict, Verdict};
pub use write::write;

use super::amendments::Amendment;
use super::grid::Rule;
use super::index::{Cell, Wanted};
use super::metric::TableMetric;

/// A cell and what became of it.
type TrainedCell<'a> = (&'a Cell, &'a Outcome);

/// What became of a cell.
#[derive(Clone, Debug, PartialEq)]
pub enum Outcome {
    /// It has its metrics.
    Metrics(CellMetrics),
    /// It ended with an error.
    Failed,
    /// It has not run, or not to its end.
    Unfinished,
}

/// The metrics of a cell.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct CellMetrics {
    /// The numbers, by names such as `composed.psnr`.
    pub numbers: BTreeMap<String, f64>,
    /// What the dynamic region of the held-out views was taken from; absent where they have none.
    pub regions: Option<RegionSource>,
    /// What that of the training views was taken from.
    pub training_regions: Option<RegionSource>,
    /// Where they come from.
    pub origin: Origin,
}

/// The table of a sweep.
#[derive(Clone, Debug, PartialEq)]
pub struct Table {
    /// The sweep's name.
    pub name: String,
    /// Heading.
    pub title: String,
    /// What it shows.
    pub about: String,
    /// The swept keys, in the order of a row's values.
    pub axes: Vec<String>,
    /// The seeds of the sweep.
    pub seeds: Vec<u64>,
    /// Headings of a row's labels; a label that would be the same in all rows is left out.
    pub headings: Vec<String>,
    /// The metrics.
    pub columns: Vec<Column>,
    /// The rows: those from the literature, those that were trained, differences.
    pub rows: Vec<Row>,
    /// How differences are judged.
    pub rule: Option<Rule>,
    /// The differences as that rule judges them; empty without a rule.
    pub verdicts: Vec<Verdict>,
    /// What the sweep measures beside the metrics that a training leaves.
    pub wanted: Wanted,
    /// The scenes of columns that show a metric of a region, by what their regions were taken from.
    pub regions: BTreeMap<RegionSource, Vec<String>>,
    /// In what the finished cells differ beside their configuration.
    pub mixtures: Vec<Mixture>,
    /// What was changed of what decides, after cells had finished.
    pub amendments: Vec<Amendment>,
    /// How the cells ended.
    pub cells: CellCounts,
}

/// A metric of the mean over some scenes.
#[derive(Clone, Debug, PartialEq)]
pub struct Column {
    /// Heading of the group that it belongs to; neighbours of the same group stand together.
    pub group: String,
    /// Which of the index's groups that is.
    pub group_index: usize,
    /// The scenes that are averaged.
    pub scenes: Vec<String>,
    /// The metric.
    pub metric: TableMetric,
    /// Decimals of the paper's numbers, as it gives them; absent where it has none in this column.
    pub paper_decimals: Option<usize>,
}

/// A row: what was trained alike but for scene and seed, or a method of the literature.
#[derive(Clone, Debug, PartialEq)]
pub struct Row {
    /// One for each of the table's headings.
    pub labels: Vec<String>,
    /// Where its metrics come from.
    pub method: Method,
    /// One for each of the table's columns.
    pub entries: Vec<Entry>,
}

/// Where the metrics of a row come from.
#[derive(Clone, Debug, PartialEq)]
pub enum Method {
    /// Cells of the sweep.
    Trained {
        /// Name of their variant.
        variant: String,
        /// Their values of the swept keys, as TOML.
        values: Vec<String>,
    },
    /// The differences of two variants at the same values, seed by seed.
    Difference {
        /// The variant whose metrics come first.
        variant: String,
        /// The variant whose metrics are subtracted.
        minus: String,
        /// Their values of the swept keys, as TOML.
        values: Vec<String>,
    },
    /// Not trained here; there are the paper's numbers alone.
    Literature(String),
}

/// A metric of a row.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Entry {
    /// Whether there is one, and if not, why.
    pub state: State,
    /// The mean over the scenes for each seed that has all of them.
    pub seeds: Vec<SeedMean>,
    /// Mean and deviation over these seeds; absent where there are none.
    pub spread: Option<Spread>,
    /// The paper's number.
    pub paper: Option<f64>,
    /// Why the paper's number is not comparable; empty where it is.
    pub not_comparable: Vec<String>,
    /// Whether no row has a better one.
    pub is_best: bool,
    /// Whether it is a difference of two rows, which is written with its sign.
    pub is_difference: bool,
}

/// Whether a metric is there.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum State {
    /// At least one seed has it.
    Known,
    /// Not yet.
    Unfinished,
    /// Cells that it needs failed.
    Failed,
    /// No cell that finished knows it, or the sweep has no cell for it.
    Unknown,
    /// It is of a method that is not trained here.
    #[default]
    NotTrained,
}

/// The mean over the scenes of a seed.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct SeedMean {
    /// The seed.
    pub seed: u64,
    /// The mean.
    pub mean: f64,
}

/// Mean and deviation over seeds.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Spread {
    /// The mean.
    pub mean: f64,
    /// The sample standard deviation, with n - 1; absent for a single seed.
    pub deviation: Option<f64>,
}

/// How the cells of a sweep ended.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize)]
pub struct CellCounts {
    /// All of them.
    pub total: usize,
    /// Those that failed.
    pub failed: usize,
    /// Those that are still to finish.
    pub unfinished: usize,
}
