//! The files of a table.

use std::path::{Path, PathBuf};

use anyhow::Context;

use super::{Outcome, Table, plots};
use crate::sweep::index::Index;
use crate::{atomic, run};

/// Folder of the curves.
const PLOTS: &str = "plots";

/// Writes `table.md`, `table.tex`, `table.csv`, `seeds.csv`, `table.json` and the curves into the sweep's folder;
/// returns where they lie. `outcomes` are in the order of the index's cells.
///
/// # Errors
/// If a file cannot be written.
pub fn write(index: &Index, outcomes: &[Outcome], folder: &Path) -> anyhow::Result<Vec<PathBuf>> {
    let table = Table::of(index, outcomes);
    let mut written = Vec::new();
    let texts = [
        ("table.md", table.markdown()),
        ("table.tex", table.latex()),
        ("table.csv", table.csv()),
        ("seeds.csv", table.seeds_csv()),
    ];
    for (name, text) in texts {
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

/// Removes curves that the table no longer has: its grid may have changed. Other drawings are not ours.
fn remove_others(folder: &Path, plots: &[plots::Plot]) -> anyhow::Result<()> {
    let Ok(entries) = std::fs::read_dir(folder) else { return Ok(()) };
    for path in entries.filter_map(|entry| Some(entry.ok()?.path())) {
        let is_plot = path.file_name().and_then(|name| name.to_str()).is_some_and(plots::is_curve);
        let is_wanted = plots.iter().any(|plot| path.ends_with(&plot.file));
        if is_plot && !is_wanted {
            std::fs::remove_file(&path).with_context(|| format!("cannot remove {}", path.display()))?;
        }
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::super::specimen::{ablation, windows};
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
        let tables = ["table.md", "table.tex", "table.csv", "seeds.csv", "table.json"];
        assert_eq!(names, [&tables[..], &plots[..]].concat());
        assert!(written.iter().all(|path| path.is_file()));
    }

    #[test]
    fn curves_of_an_earlier_grid_are_removed_and_drawings_of_a_user_are_not() {
        let folder = tempfile::tempdir().expect("folder");
        let path = |name: &str| folder.path().join(PLOTS).join(name);
        let (old, others) = ("motion-knots_composed-psnr.svg", ["figure.svg", "paper_composed-psnr.svg"]);
        std::fs::create_dir(folder.path().join(PLOTS)).expect("made");
        for name in [&[old], &others[..]].concat() {
            std::fs::write(path(name), "x").expect("written");
        }
        let (index, outcomes) = windows();
        write(&index, &outcomes, folder.path()).expect("written");
        assert!(!path(old).exists() && others.iter().all(|name| path(name).exists()));
    }

    #[test]
    fn a_sweep_of_variants_has_no_curves_and_writes_the_same_twice() {
        let folder = tempfile::tempdir().expect("folder");
        let (index, outcomes) = ablation();
        let read = |paths: &[PathBuf]| -> Vec<String> {
            paths.iter().map(|path| std::fs::read_to_string(path).expect("read")).collect()
        };
        let first = read(&write(&index, &outcomes, folder.path()).expect("written"));
        assert_eq!(first.len(), 5);
        assert_eq!(read(&write(&index, &outcomes, folder.path()).expect("written")), first);
    }
}
