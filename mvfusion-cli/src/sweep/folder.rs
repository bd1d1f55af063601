//! The sweep folder: its files, and the state of each cell.

use std::collections::BTreeMap;
use std::fs::{self, DirEntry};
use std::io;
use std::path::{Path, PathBuf};

use anyhow::{Context, bail};
use mvfusion_data::files::{read_bytes, read_text};
use mvfusion_model::evaluation::Scores;
use mvfusion_model::files::{is_unfinished, sha256};
use serde::{Deserialize, Serialize};

use super::amendments::{Amendment, amendments};
use super::index::{Cell, INDEX, Index, Wanted, grid_hash, of_another_version};
use super::plan::Plan;
use super::table::{CellMetrics, Origin, Outcome};
use crate::lock::{FileLock, LockState, Refusal};
use crate::run::{self, LpipsWeights, Results, RunRecord};
use crate::{atomic, config};

/// The text of the grid.
const GRID: &str = "grid.toml";
/// Folder of the cells' runs and their additional files.
const CELLS: &str = "cells";

/// A sweep folder.
#[derive(Clone, Debug)]
pub struct SweepFolder {
    path: PathBuf,
}

/// The state of a cell.
#[derive(Clone, Debug, PartialEq)]
pub enum State {
    /// Not started.
    ToDo,
    /// Running in a process on this machine, or on another machine that shares the folder.
    Running,
    /// Started, but no longer running.
    Interrupted,
    /// Failed, with this message.
    Failed(String),
    /// Finished, with all its metrics.
    Finished,
}

impl State {
    /// The state in a word.
    pub fn word(&self) -> &'static str {
        match self {
            Self::ToDo => "to do",
            Self::Running => "running",
            Self::Interrupted => "interrupted",
            Self::Failed(_) => "failed",
            Self::Finished => "finished",
        }
    }
}

/// `cells/ID.json`: the task of a cell, next to its configuration, so that it can run without the index. If the grid
/// changes while a cell waits in a queue, the requested measurements follow the grid. Its id, and thus its training,
/// cannot change. If the grid no longer contains the cell, its task stays.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Order {
    /// The cell's place in the grid, in words.
    pub name: String,
    /// The preset that it starts from.
    pub preset: String,
    /// Measurements in addition to the metrics of a training.
    pub wanted: Wanted,
}

impl SweepFolder {
    /// The folder at a path, which need not exist yet.
    ///
    /// # Errors
    /// If the current folder does not exist any more.
    pub fn new(path: &Path) -> anyhow::Result<Self> {
        Ok(Self { path: std::path::absolute(path)? })
    }

    /// The folder.
    pub fn path(&self) -> &Path {
        &self.path
    }

    /// Checks that files can be written and locked, before anything runs, and that nothing of a user would be replaced.
    /// `text` is that of the grid.
    ///
    /// # Errors
    /// If the folder cannot be created or written to, or belongs to something else, or its grid was changed there.
    pub fn check(&self, text: &str) -> anyhow::Result<()> {
        let file = run::trial_file(&self.path, "sweep")?;
        file.try_lock().with_context(|| {
            format!("cannot lock files in {}; choose an --out whose file system supports locks", self.path.display())
        })?;
        match self.path.join(INDEX).is_file() {
            true => self.check_grid(text),
            false if self.path.is_dir() => self.check_stranger(text),
            false => Ok(()),
        }
    }

    /// Rejects a grid that was changed in the folder since a sweep wrote it there.
    fn check_grid(&self, text: &str) -> anyhow::Result<()> {
        let path = self.path.join(GRID);
        let Ok(now) = read_bytes(&path, run::MOST_OF_SETTINGS) else { return Ok(()) };
        if now != text.as_bytes() && grid_hash(&self.path).is_some_and(|written| written != sha256(&now)) {
            bail!(
                "{} was changed since the sweep wrote it, and would be replaced. Give this file as the grid to use the \
                 changes, or move it away.",
                path.display()
            );
        }
        Ok(())
    }

    /// Rejects a folder without an index that contains anything but what a sweep writes before the index: the files of
    /// cells that have not begun, and the same grid.
    fn check_stranger(&self, text: &str) -> anyhow::Result<()> {
        let shown = self.path.display();
        let is_ours = read_bytes(&self.path.join(GRID), run::MOST_OF_SETTINGS).is_ok_and(|now| now == text.as_bytes());
        let is_of_cell = |entry: io::Result<DirEntry>| {
            let name = entry.map(|entry| entry.file_name()).unwrap_or_default();
            let extension = Path::new(&name).extension();
            is_unfinished(&name) || extension.is_some_and(|extension| extension == "toml" || extension == "json")
        };
        let has_begun = |cells: PathBuf| !fs::read_dir(cells).is_ok_and(|mut entries| entries.all(is_of_cell));
        let entries = fs::read_dir(&self.path).with_context(|| format!("cannot list the folder {shown}"))?;
        for entry in entries {
            let name = entry.with_context(|| format!("cannot list the folder {shown}"))?.file_name();
            let is_known = match name.to_str() {
                Some(GRID) => is_ours,
                Some(CELLS) => is_ours || !has_begun(self.cells()),
                _ => is_unfinished(&name),
            };
            if !is_known {
                bail!(
                    "the folder {shown} contains `{}`, but no sweep of this grid. Choose another --out, or move it away.",
                    name.display()
                );
            }
        }
        Ok(())
    }

    /// Whether a sweep is here that has no cell of this index.
    pub fn has_other_cells(&self, index: &Index) -> bool {
        let is_new = |old: &Cell| index.cells.iter().all(|cell| cell.id != old.id);
        Index::read(&self.path).is_ok_and(|old| !old.cells.is_empty() && old.cells.iter().all(is_new))
    }

    /// What was changed of what decides since cells of this sweep had finished, if `index` takes its place.
    pub fn amendments(&self, index: &Index) -> Vec<Amendment> {
        let Ok(old) = Index::read(&self.path) else { return Vec::new() };
        amendments(&old, index, |id| self.is_trained(id))
    }

    /// Writes the grid, the files that each cell needs to run on its own, and the index.
    ///
    /// # Errors
    /// If a file cannot be written.
    pub fn prepare(&self, text: &str, plan: &Plan) -> anyhow::Result<()> {
        fs::create_dir_all(self.path.join(CELLS))
            .with_context(|| format!("cannot create the folder {}", self.path.display()))?;
        let Plan { index, configs } = plan;
        for (cell, config) in index.cells.iter().zip(configs) {
            write_changed(&self.config(&cell.id), config::to_toml(config)?.as_bytes())?;
            let order =
                Order { name: cell.name(&index.axes), preset: cell.preset.clone(), wanted: index.wanted.clone() };
            write_changed(&self.beside(&cell.id, "json"), serde_json::to_string_pretty(&order)?.as_bytes())?;
        }
        // Next to the index, which has its hash: between them, a kill would make it look like a changed copy.
        atomic::write(&self.path.join(GRID), text.as_bytes())?;
        index.write(&self.path)
    }

    /// The task of a cell.
    ///
    /// # Errors
    /// If the sweep has no such cell.
    pub fn order(&self, id: &str) -> anyhow::Result<Order> {
        let path = self.beside(id, "json");
        let text = read_text(&path, run::MOST_OF_SETTINGS).with_context(|| {
            format!("{} is not a sweep with a cell `{id}`: cannot read {}", self.path.display(), path.display())
        })?;
        serde_json::from_str(&text).with_context(|| of_another_version(&path))
    }

    /// The folder of the cells.
    pub fn cells(&self) -> PathBuf {
        self.path.join(CELLS)
    }

    /// The folder of a cell's run.
    pub fn run(&self, id: &str) -> PathBuf {
        self.path.join(CELLS).join(id)
    }

    /// A cell's configuration.
    pub fn config(&self, id: &str) -> PathBuf {
        self.beside(id, "toml")
    }

    /// The output of a cell's processes.
    pub fn log(&self, id: &str) -> PathBuf {
        self.beside(id, "log")
    }

    /// A file next to a cell's run folder, which contains only the files of the run.
    fn beside(&self, id: &str, extension: &str) -> PathBuf {
        self.path.join(CELLS).join(format!("{id}.{extension}"))
    }

    /// Records that a cell failed.
    ///
    /// # Errors
    /// If the file cannot be written.
    pub fn note_failure(&self, id: &str, words: &str) -> anyhow::Result<()> {
        atomic::write(&self.beside(id, "failed"), format!("{words}\n").as_bytes())
    }

    /// Removes the record of a failure, if there is one.
    ///
    /// # Errors
    /// If the file cannot be removed.
    pub fn forget_failure(&self, id: &str) -> anyhow::Result<()> {
        let path = self.beside(id, "failed");
        match fs::remove_file(&path) {
            Err(error) if error.kind() != io::ErrorKind::NotFound => {
                Err(error).with_context(|| format!("cannot remove {}", path.display()))
            }
            _ => Ok(()),
        }
    }

    /// Takes the lock of a cell; `None` if another process is running it.
    ///
    /// # Errors
    /// If the file cannot be created or locked.
    pub fn lock(&self, id: &str) -> anyhow::Result<Option<FileLock>> {
        let path = self.beside(id, "lock");
        match FileLock::take(&path) {
            Ok(lock) => Ok(Some(lock)),
            Err(Refusal::Held(_)) => Ok(None),
            Err(Refusal::Io(error)) => Err(error).with_context(|| format!("cannot lock {}", path.display())),
        }
    }

    /// The state of a cell.
    ///
    /// # Errors
    /// If its files cannot be read.
    pub fn state(&self, id: &str, wanted: &Wanted) -> anyhow::Result<State> {
        let path = self.beside(id, "lock");
        let lock = FileLock::state(&path).with_context(|| format!("cannot read {}", path.display()))?;
        if lock == LockState::Held {
            return Ok(State::Running);
        }
        // The lock is checked before the metrics. Otherwise, a cell that ends between the two checks would seem
        // interrupted.
        if self.is_finished(id, wanted) {
            return Ok(State::Finished);
        }
        let path = self.beside(id, "failed");
        match read_text(&path, run::MOST_OF_RECORDS) {
            Ok(words) => Ok(State::Failed(words.trim_end().to_owned())),
            Err(error) if error.kind() == io::ErrorKind::NotFound => {
                Ok(if lock == LockState::Free { State::Interrupted } else { State::ToDo })
            }
            Err(error) => Err(error).with_context(|| format!("cannot read {}", path.display())),
        }
    }

    /// Whether a cell has all requested metrics.
    pub fn is_finished(&self, id: &str, wanted: &Wanted) -> bool {
        self.is_trained(id) && self.results(id).is_some_and(|results| is_measured(&results, wanted))
    }

    /// Whether the training and the evaluation of a cell have finished.
    pub fn is_trained(&self, id: &str) -> bool {
        self.record(id).is_some_and(|record| record.finished.is_some()) && self.results(id).is_some()
    }

    /// The record of a cell's training, if it exists.
    fn record(&self, id: &str) -> Option<RunRecord> {
        read_json(&self.run(id).join(run::RECORD))
    }

    /// The metrics of a cell, if they exist.
    pub fn results(&self, id: &str) -> Option<Results> {
        read_json(&self.run(id).join(run::RESULTS))
    }

    /// The outcome of each cell, for the table.
    ///
    /// # Errors
    /// As [`SweepFolder::state`].
    pub fn outcomes(&self, index: &Index) -> anyhow::Result<Vec<Outcome>> {
        let outcome = |cell: &Cell| {
            let measured = |(results, record): (Results, RunRecord)| {
                let source = |scores: &Scores| scores.region_source;
                Outcome::Metrics(CellMetrics {
                    numbers: metrics(&results),
                    regions: source(&results.test),
                    training_regions: results.training_views.as_ref().and_then(source),
                    origin: Origin::of(&record, &results),
                })
            };
            Ok(match self.state(&cell.id, &index.wanted)? {
                State::Finished => {
                    self.results(&cell.id).zip(self.record(&cell.id)).map_or(Outcome::Unfinished, measured)
                }
                State::Failed(_) => Outcome::Failed,
                State::ToDo | State::Running | State::Interrupted => Outcome::Unfinished,
            })
        };
        index.cells.iter().map(outcome).collect()
    }
}

/// Writes a file if its contents change. A running cell may be reading it.
fn write_changed(path: &Path, bytes: &[u8]) -> anyhow::Result<()> {
    match read_bytes(path, run::MOST_OF_SETTINGS) {
        Ok(old) if old == bytes => Ok(()),
        _ => atomic::write(path, bytes),
    }
}

/// Whether a run has the additional metrics that were requested: the frame rate over as many frames, and LPIPS of every
/// requested network with the requested weights.
fn is_measured(results: &Results, wanted: &Wanted) -> bool {
    let has_network = |(network, sha256): (&String, &String)| match results.lpips.get(network) {
        Some(LpipsWeights::WeightsSha256(own)) => own == sha256,
        _ => false,
    };
    let is_timed = |frames| results.speed.is_some_and(|speed| speed.frames == frames);
    (wanted.speed_frames == 0 || is_timed(wanted.speed_frames)) && wanted.lpips.iter().all(has_network)
}

/// A JSON file that is either complete or missing. A broken file counts as missing.
fn read_json<T: serde::de::DeserializeOwned>(path: &Path) -> Option<T> {
    run::read_json(path).ok()
}

/// Bytes of a mebibyte.
const MEBIBYTE: f64 = (1_u64 << 20) as f64;

/// All metrics of a run, by their names in grids.
pub(super) fn metrics(results: &Results) -> BTreeMap<String, f64> {
    let short = |(name, value): (String, f64)| (name.strip_prefix("test.").unwrap_or(&name).to_owned(), value);
    let mut metrics: BTreeMap<String, f64> = results.metrics().into_iter().map(short).collect();
    metrics.insert("eval.seconds".into(), results.eval.seconds);
    if let Some(train) = results.train {
        metrics.insert("train.seconds".into(), train.seconds);
        metrics.insert("train.ms_per_step".into(), 1e3 * train.seconds / train.steps.max(1) as f64);
        metrics.extend(train.peak_memory.map(|bytes| ("train.peak_memory".to_owned(), bytes as f64 / MEBIBYTE)));
    }
    if let Some(speed) = results.speed {
        metrics.insert("speed.fps".into(), speed.fps);
        metrics.extend(speed.fps_without_mfta.map(|fps| ("speed.fps_without_mfta".to_owned(), fps)));
    }
    metrics
}

#[cfg(test)]
mod tests;
