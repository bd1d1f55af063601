//! `cargo xtask results`: puts the table of a sweep into the page that has a place for it.

use std::fs;
use std::path::PathBuf;

use anyhow::{Context, Result, bail};
use clap::Args;
use serde_json::Value;

use crate::docs;
use crate::splice::splice;

/// The pages that have places for tables.
const PAGES: [&str; 3] = ["docs/results.md", "docs/results-appendix.md", "docs/ambiguities.md"];

/// Puts the table of a sweep into the page that has a place for it.
///
/// The sweep trains (`mvfusion sweep methods`, docs/sweeps.md). This chore copies its `table.md` between the lines that
/// name the sweep, in docs/results.md, docs/results-appendix.md or docs/ambiguities.md.
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
    let table = read("table.md")?;
    for page in PAGES {
        let path = docs::root().join(page);
        let old = fs::read_to_string(&path).with_context(|| format!("cannot read {page}"))?;
        if let Some(new) = with_table(&old, name, &table) {
            return fs::write(&path, new).with_context(|| format!("cannot write {page}"));
        }
    }
    bail!("no page has a place for this sweep: add the lines `{}` and `{}` to one of {PAGES:?}", start(name), end(name))
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
