//! `cargo xtask results`: puts the table of a sweep into docs/results.md.

use std::fs;
use std::path::{Path, PathBuf};

use anyhow::{Context, Result};
use clap::Args;
use serde_json::Value;

use crate::docs;
use crate::splice::splice;

/// The page that the tables stand in.
const PAGE: &str = "docs/results.md";

/// Puts the table of a sweep into docs/results.md.
///
/// The sweep trains (`mvfusion sweep methods`, docs/sweeps.md). This chore copies its `table.md` between the lines of
/// the page that name the sweep.
#[derive(Debug, Args)]
pub struct ResultsArguments {
    /// Folder of the sweep, such as runs/sweeps/methods.
    folder: PathBuf,
}

/// Carries out the chore.
pub fn run(arguments: &ResultsArguments) -> Result<()> {
    let folder = &arguments.folder;
    let read = |name: &str| {
        let path = folder.join(name);
        fs::read_to_string(&path).with_context(|| {
            format!("cannot read {}: give the folder of a sweep after `mvfusion sweep table`", path.display())
        })
    };
    let json: Value = serde_json::from_str(&read("table.json")?).context("table.json is not JSON")?;
    let name = json["name"].as_str().context("table.json does not name its sweep")?;
    let page = docs::root().join(PAGE);
    let old = fs::read_to_string(&page).with_context(|| format!("cannot read {PAGE}"))?;
    let new = with_table(&old, name, &read("table.md")?).with_context(|| {
        format!("{PAGE} has no place for this sweep: add the lines `{}` and `{}`", start(name), end(name))
    })?;
    write(&page, &new)
}

fn write(page: &Path, text: &str) -> Result<()> {
    fs::write(page, text).with_context(|| format!("cannot write {}", page.display()))
}

/// The page with the table of a sweep. The page has a heading of its own, so the table's goes.
fn with_table(page: &str, name: &str, table: &str) -> Option<String> {
    let body = match table.split_once("\n\n") {
        Some((heading, rest)) if heading.starts_with("# ") => rest,
        _ => table,
    };
    splice(page, &start(name), &end(name), body)
}

fn start(name: &str) -> String {
    format!("<!-- sweep {name}: written by `cargo xtask results` -->")
}

fn end(name: &str) -> String {
    format!("<!-- end of sweep {name} -->")
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_table_stands_between_the_lines_that_name_its_sweep() {
        let page = |body: &str| format!("# Results\n\n{}\n{body}{}\n", start("methods"), end("methods"));
        let found = with_table(&page("old\n"), "methods", "# Methods\n\n| a |\n|---|\n");
        assert_eq!(found, Some(page("| a |\n|---|\n")));
        assert_eq!(with_table(&page("old\n"), "other", "| a |\n"), None);
    }
}
