//! The table that a sweep is for, and the curves over its swept keys.
//!
//! [`Table::of`] makes the means and spreads from what the cells yielded; the other files write them down, each in one
//! format. What is shown is rounded; `table.csv` and `table.json` have the numbers in full.

mod build;
mod csv;
mod entry;
mod json;
mod latex;
mod markdown;
mod metric;
mod notes;
mod paper;
mod plot;
mod plots;
mod regions;
mod scale;
#[cfg(test)]
mod specimen;

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

use anyhow::Context;
use mvfusion_model::evaluation::RegionSource;
use serde::Serialize;

pub use metric::TableMetric;
pub(super) use metric::lpips_network;

use super::index::{Index, Wanted};
use crate::{atomic, run};

/// Folder of the curves.
const PLOTS: &str = "plots";

/// What became of a cell.
#[derive(Clone, Debug, PartialEq)]
pub enum Outcome {
    /// It has its figures.
    Figures(CellFigures),
    /// It ended with an error.
    Failed,
    /// It has not run, or not to its end.
    Unfinished,
}

/// The figures of a cell.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct CellFigures {
    /// The numbers, by names such as `composed.psnr`.
    pub numbers: BTreeMap<String, f64>,
    /// What the dynamic region of the held-out views was taken from; absent where they have none.
    pub regions: Option<RegionSource>,
    /// What that of the training views was taken from.
    pub training_regions: Option<RegionSource>,
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
    /// The figures.
    pub columns: Vec<Column>,
    /// The rows, those from the literature first.
    pub rows: Vec<Row>,
    /// What the sweep measures beside the figures that a training leaves.
    pub wanted: Wanted,
    /// The scenes of columns that show a figure of a region, by what their regions were taken from.
    pub regions: BTreeMap<RegionSource, Vec<String>>,
    /// How the cells ended.
    pub cells: CellCounts,
}

/// A figure of the mean over some scenes.
#[derive(Clone, Debug, PartialEq)]
pub struct Column {
    /// Heading of the group that it belongs to; neighbours of the same group stand together.
    pub group: String,
    /// Which of the index's groups that is.
    pub group_index: usize,
    /// The scenes that are averaged.
    pub scenes: Vec<String>,
    /// The figure.
    pub metric: TableMetric,
    /// Decimals of the paper's numbers, as it gives them; absent where it has none in this column.
    pub paper_decimals: Option<usize>,
}

/// A row: what was trained alike but for scene and seed, or a method of the literature.
#[derive(Clone, Debug, PartialEq)]
pub struct Row {
    /// One for each of the table's headings.
    pub labels: Vec<String>,
    /// Where its figures come from.
    pub method: Method,
    /// One for each of the table's columns.
    pub entries: Vec<Entry>,
}

/// Where the figures of a row come from.
#[derive(Clone, Debug, PartialEq)]
pub enum Method {
    /// Cells of the sweep.
    Trained {
        /// Name of their variant.
        variant: String,
        /// Their values of the swept keys, as TOML.
        values: Vec<String>,
    },
    /// Not trained here; there are the paper's numbers alone.
    Literature(String),
}

/// A figure of a row.
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
}

/// Whether a figure is there.
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

/// Writes `table.md`, `table.tex`, `table.csv`, `table.json` and the curves into the sweep's folder; returns where they
/// lie. `outcomes` are in the order of the index's cells.
///
/// # Errors
/// If a file cannot be written.
pub fn write(index: &Index, outcomes: &[Outcome], folder: &Path) -> anyhow::Result<Vec<PathBuf>> {
    let table = Table::of(index, outcomes);
    let mut written = Vec::new();
    for (name, text) in [("table.md", table.markdown()), ("table.tex", table.latex()), ("table.csv", table.csv())] {
        let path = run::place(folder, &[name])?;
        atomic::write(&path, text.as_bytes())?;
        written.push(path);
    }
    let path = run::place(folder, &["table.json"])?;
    atomic::write_json(&path, &table.json())?;
    written.push(path);
    let plots = plots::of(&table);
    remove_others(&folder.join(PLOTS), &plots)?;
    for plot in plots {
        let path = run::place(folder, &[PLOTS, &plot.file])?;
        atomic::write(&path, plot.svg().as_bytes())?;
        written.push(path);
    }
    Ok(written)
}

/// Removes curves that the table no longer has: its grid may have changed.
fn remove_others(folder: &Path, plots: &[plots::Plot]) -> anyhow::Result<()> {
    let Ok(entries) = std::fs::read_dir(folder) else { return Ok(()) };
    for path in entries.filter_map(|entry| Some(entry.ok()?.path())) {
        let is_plot = path.extension().is_some_and(|extension| extension == "svg");
        let is_wanted = plots.iter().any(|plot| path.ends_with(&plot.file));
        if is_plot && !is_wanted {
            std::fs::remove_file(&path).with_context(|| format!("cannot remove {}", path.display()))?;
        }
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::specimen::{ablation, windows};
    use super::*;

    #[test]
    fn all_files_are_written_and_returned() {
        let folder = tempfile::tempdir().expect("folder");
        let (index, outcomes) = windows();
        let written = write(&index, &outcomes, folder.path()).expect("written");
        let names: Vec<String> = written
            .iter()
            .map(|path| path.strip_prefix(folder.path()).expect("within").to_string_lossy().replace('\\', "/"))
            .collect();
        let plots = ["plots/motion-window_composed-psnr.svg", "plots/motion-window_composed-lpips_alex.svg"];
        let tables = ["table.md", "table.tex", "table.csv", "table.json"];
        assert_eq!(names, [&tables[..], &plots[..]].concat());
        assert!(written.iter().all(|path| path.is_file()));
    }

    #[test]
    fn a_sweep_of_variants_has_no_curves_and_writes_the_same_twice() {
        let folder = tempfile::tempdir().expect("folder");
        let (index, outcomes) = ablation();
        let read = |paths: &[PathBuf]| -> Vec<String> {
            paths.iter().map(|path| std::fs::read_to_string(path).expect("read")).collect()
        };
        let first = read(&write(&index, &outcomes, folder.path()).expect("written"));
        assert_eq!(first.len(), 4);
        assert_eq!(read(&write(&index, &outcomes, folder.path()).expect("written")), first);
    }
}
