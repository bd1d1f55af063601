//! Lists between markers in the documentation, which the sources make: stale ones are faults.

use std::fs;
use std::path::{Path, PathBuf};

use anyhow::{Context, Result};

use super::{Fault, examples, features, packages, text};
use crate::splice::splice;

/// The page that holds the lists.
const PAGE: &str = "docs/README.md";

/// A list, and the name in its markers.
struct List {
    name: &'static str,
    body: String,
}

/// Writes the lists that are stale, and gives the files that changed.
pub fn write(root: &Path) -> Result<Vec<PathBuf>> {
    let path = Path::new(PAGE);
    let old = text(root, path)?;
    let mut new = old.clone();
    for list in lists(root)? {
        new = replaced(&new, &list).with_context(|| missing(list.name))?;
    }
    if new == old {
        return Ok(Vec::new());
    }
    fs::write(root.join(path), new).with_context(|| format!("cannot write {PAGE}"))?;
    Ok(vec![path.to_owned()])
}

/// Lists that are not what `write` would write, and sources that do not say what a list needs.
pub fn faults(root: &Path) -> Result<Vec<Fault>> {
    let packages = packages::all(root)?;
    let mut faults = features::faults(&packages);
    faults.extend(examples::faults(&examples::find(root, &packages)?));
    let page = text(root, Path::new(PAGE))?;
    faults.extend(lists(root)?.iter().filter_map(|list| stale(&page, list)));
    Ok(faults)
}

fn lists(root: &Path) -> Result<Vec<List>> {
    let packages = packages::all(root)?;
    let examples = examples::find(root, &packages)?;
    Ok(vec![
        List { name: "examples", body: examples::list(&examples) },
        List { name: "features", body: features::list(&packages) },
    ])
}

fn stale(page: &str, list: &List) -> Option<Fault> {
    let fault = |line, message| Some(Fault { path: PAGE.into(), line, message });
    match replaced(page, list) {
        None => fault(1, missing(list.name)),
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

fn missing(name: &str) -> String {
    format!("{PAGE} has no place for the list of {name}: add the lines `{}` and `{}`", start(name), end(name))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn list(body: &str) -> List {
        List { name: "colours", body: body.to_owned() }
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
