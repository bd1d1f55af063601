//! `mvfusion sweep status`: the state of each cell.

use std::collections::BTreeMap;
use std::io::Write;
use std::path::Path;

use serde::Serialize;

use super::json;
use crate::args::SweepFolderArgs;
use crate::sweep::{Cell, Index, State, SweepFolder};

/// All states, in the order of the summary.
const WORDS: [&str; 5] = ["finished", "running", "interrupted", "failed", "to do"];

/// The state of a sweep, for scripts.
#[derive(Serialize)]
struct Report<'a> {
    folder: &'a Path,
    name: &'a str,
    /// The number of cells in each state.
    counts: BTreeMap<String, usize>,
    cells: Vec<CellState<'a>>,
}

#[derive(Serialize)]
struct CellState<'a> {
    id: &'a str,
    state: String,
    /// Why it failed.
    #[serde(skip_serializing_if = "Option::is_none")]
    failure: Option<&'a str>,
    scene: &'a str,
    /// Absent where the grid has none.
    #[serde(skip_serializing_if = "str::is_empty")]
    variant: &'a str,
    /// The values of the swept keys, as TOML.
    values: BTreeMap<&'a str, &'a str>,
    seed: u64,
    steps: usize,
    run: String,
}

/// Prints the state of each cell, then how many cells are in which state.
///
/// # Errors
/// If the folder holds no sweep, or a file of a cell cannot be read.
pub(super) fn status(args: &SweepFolderArgs, out: &mut dyn Write) -> anyhow::Result<()> {
    let folder = SweepFolder::new(&args.folder)?;
    let index = Index::read(folder.path())?;
    let states: Vec<(&Cell, State)> = index
        .cells
        .iter()
        .map(|cell| Ok((cell, folder.state(&cell.id, &index.wanted)?)))
        .collect::<anyhow::Result<_>>()?;
    match args.json {
        true => json::print(&report(&folder, &index, &states), out),
        false => tell(&index, &states, out),
    }
}

fn count(states: &[(&Cell, State)], word: &str) -> usize {
    states.iter().filter(|(_, state)| state.word() == word).count()
}

fn tell(index: &Index, states: &[(&Cell, State)], out: &mut dyn Write) -> anyhow::Result<()> {
    for (cell, state) in states {
        let words = match state {
            State::Failed(words) => format!(": {words}"),
            _ => String::new(),
        };
        writeln!(out, "{:12} {}  {}{words}", state.word(), cell.id, cell.name(&index.axes))?;
    }
    let counts = WORDS.map(|word| (count(states, word), word)).into_iter().filter(|(count, _)| *count > 0);
    let counts: Vec<String> = counts.map(|(count, word)| format!("{count} {word}")).collect();
    Ok(writeln!(out, "{} cells: {}", states.len(), counts.join(", "))?)
}

fn report<'a>(folder: &'a SweepFolder, index: &'a Index, states: &'a [(&'a Cell, State)]) -> Report<'a> {
    let cells = states.iter().map(|(cell, state)| CellState {
        id: &cell.id,
        state: key(state.word()),
        failure: match state {
            State::Failed(words) => Some(words),
            _ => None,
        },
        scene: &cell.scene,
        variant: &cell.variant,
        values: index.axes.iter().map(String::as_str).zip(cell.values.iter().map(String::as_str)).collect(),
        seed: cell.seed,
        steps: cell.steps,
        run: folder.run(&cell.id).display().to_string(),
    });
    Report {
        folder: folder.path(),
        name: &index.name,
        counts: WORDS.map(|word| (key(word), count(states, word))).into_iter().collect(),
        cells: cells.collect(),
    }
}

/// A state as a key: `to_do`.
fn key(word: &str) -> String {
    word.replace(' ', "_")
}
