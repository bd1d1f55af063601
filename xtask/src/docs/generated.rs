//! Lists between markers in the documentation, which the sources make: stale ones are faults.

use std::fs;
use std::path::{Path, PathBuf};

use anyhow::{Context, Result};
use mvfusion_model::Config;

use super::{Fault, configuration, examples, features, packages, text};
use crate::splice::splice;

/// The page that holds the lists of files and features.
const INDEX: &str = "docs/README.md";

/// The page that holds the keys of the configuration.
const CONFIGURATION: &str = "docs/configuration.md";

/// A list, the name in its markers, and the page that holds it.
struct List {
    name: &'static str,
    page: &'static str,
    body: String,
}

/// Writes the lists that are stale, and gives the files that changed.
pub fn write(root: &Path) -> Result<Vec<PathBuf>> {
    let mut changed = Vec::new();
    for list in lists(root)? {
        let old = text(root, Path::new(list.page))?;
        let new = replaced(&old, &list).with_context(|| missing(&list))?;
        if new != old {
            fs::write(root.join(list.page), new).with_context(|| format!("cannot write {}", list.page))?;
            changed.push(list.page.into());
        }
    }
    changed.dedup();
    Ok(changed)
}

/// Lists that are not what `write` would write, and sources that do not say what a list needs.
pub fn faults(root: &Path) -> Result<Vec<Fault>> {
    let packages = packages::all(root)?;
    let mut faults = features::faults(&packages);
    faults.extend(examples::faults(&examples::find(root, &packages)?));
    for list in lists(root)? {
        faults.extend(stale(&text(root, Path::new(list.page))?, &list));
    }
    Ok(faults)
}

fn lists(root: &Path) -> Result<Vec<List>> {
    let packages = packages::all(root)?;
    let examples = examples::find(root, &packages)?;
    Ok(vec![
        List { name: "examples", page: INDEX, body: examples::list(&examples) },
        List { name: "features", page: INDEX, body: features::list(&packages) },
        List { name: "keys", page: CONFIGURATION, body: configuration::list(Config::key_notes()) },
    ])
}

fn stale(page: &str, list: &List) -> Option<Fault> {
    let fault = |line, message| Some(Fault { path: list.page.into(), line, message });
    match replaced(page, list) {
        None => fault(1, missing(list)),
        Some(fresh) if fresh == page => None,
        Some(_) => {
            let line = page.lines().position(|line| line == start(list.name)).map_or(1, |index| index + 1);
            fault(line, format!("the list of {} is stale: run `cargo xtask docs --write`", list.name))
        }
    }
}

/// The page with the list of now, or `None` where it lacks the markers.
fn replaced(page: &str, list: &List) -> Option<String> {
    splice(page, &start(list.name), &end(list.name), &list.body)
}

fn start(name: &str) -> String {
    format!("<!-- {name}: written by `cargo xtask docs --write` -->")
}

fn end(name: &str) -> String {
    format!("<!-- end of {name} -->")
}

fn missing(List { name, page, .. }: &List) -> String {
    format!("{page} has no place for the list of {name}: add the lines `{}` and `{}`", start(name), end(name))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn list(body: &str) -> List {
        List { name: "colours", page: INDEX, body: body.to_owned() }
    }

    fn page(body: &str) -> String {
        format!("# Page\n\n{}\n{body}{}\nMore.\n", start("colours"), end("colours"))
    }

    #[test]
    fn a_fresh_list_passes() {
        assert_eq!(stale(&page("| red |\n"), &list("| red |\n")), None);
    }

    #[test]
    fn a_stale_list_is_found_with_the_command_that_mends_it() {
        let fault = stale(&page("| red |\n"), &list("| blue |\n")).expect("a fault");
        assert_eq!(fault.line, 3);
        assert!(fault.message.contains("cargo xtask docs --write"), "{fault}");
        let mended = replaced(&page("| red |\n"), &list("| blue |\n")).expect("markers");
        assert_eq!(mended, page("| blue |\n"));
    }

    #[test]
    fn a_page_without_markers_is_found() {
        let fault = stale("# Page\n", &list("| red |\n")).expect("a fault");
        assert!(fault.message.contains("no place for the list of colours"), "{fault}");
    }
}
