//! The examples: the list in the documentation, and what CI runs.

use std::fmt::Write as _;
use std::fs;
use std::path::{Path, PathBuf};

use anyhow::{Context, Result};

use super::packages::Package;
use super::{Fault, text};

/// A file of the folder `examples` of a package.
#[derive(Debug)]
pub struct Example {
    pub package: String,
    pub name: String,
    /// From the root.
    pub path: PathBuf,
    /// The first sentence of its head comment, without the full stop.
    pub summary: String,
}

/// Every example of the packages, sorted by name within its package.
pub fn find(root: &Path, packages: &[Package]) -> Result<Vec<Example>> {
    let mut examples = Vec::new();
    for package in packages {
        let folder = package.folder.join("examples");
        if !root.join(&folder).is_dir() {
            continue;
        }
        let listing = fs::read_dir(root.join(&folder)).with_context(|| format!("cannot list {}", folder.display()))?;
        let mut files: Vec<_> = listing.map(|entry| Ok(folder.join(entry?.file_name()))).collect::<Result<_>>()?;
        files.retain(|file| file.extension().is_some_and(|extension| extension == "rs"));
        files.sort();
        for path in files {
            let name =
                path.file_stem().and_then(|name| name.to_str()).context("an example's name is not UTF-8")?.to_owned();
            let summary = first_sentence(&text(root, &path)?);
            examples.push(Example { package: package.name.clone(), name, path, summary });
        }
    }
    Ok(examples)
}

/// The rows of a table: example, summary, command.
pub fn list(examples: &[Example]) -> String {
    let mut list = "| example | what it shows | command |\n|---|---|---|\n".to_owned();
    for Example { package, name, path, summary } in examples {
        let summary = super::tables::cell(summary);
        // The list stands in `docs`.
        let link = path.display();
        _ = writeln!(list, "| [{name}](../{link}) | {summary} | `cargo run -p {package} --example {name}` |");
    }
    list
}

/// Examples that do not say what they show.
pub fn faults(examples: &[Example]) -> Vec<Fault> {
    let silent = examples.iter().filter(|example| example.summary.is_empty());
    let message = "the example has no head comment: start the file with a sentence `//! …` that says what it shows";
    silent.map(|example| Fault { path: example.path.clone(), line: 1, message: message.to_owned() }).collect()
}

/// The first sentence of the head comment.
fn first_sentence(source: &str) -> String {
    let head = source.lines().map_while(|line| line.strip_prefix("//!")).map(str::trim);
    let paragraph: Vec<_> = head.skip_while(|line| line.is_empty()).take_while(|line| !line.is_empty()).collect();
    let paragraph = paragraph.join(" ");
    paragraph.split(". ").next().unwrap_or_default().to_owned()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn an_example_is_listed_with_the_first_sentence_of_its_head() {
        let folder = tempfile::tempdir().expect("a folder");
        fs::create_dir_all(folder.path().join("a/examples")).expect("a folder");
        let file = folder.path().join("a/examples/loop.rs");
        fs::write(file, "//! Trains a\n//! model|mask. And more.\n//!\n//! Other.\nfn main() {}\n").expect("a file");
        let package = Package { name: "b".to_owned(), folder: "a".into(), features: Vec::new() };
        let examples = find(folder.path(), &[package]).expect("examples");
        let row = "| [loop](../a/examples/loop.rs) | Trains a model\\|mask | `cargo run -p b --example loop` |";
        assert_eq!(list(&examples).lines().next_back(), Some(row));
        assert_eq!(faults(&examples), []);
    }

    #[test]
    fn an_example_without_a_head_comment_is_found() {
        let example = |summary: &str| Example {
            package: "a".to_owned(),
            name: "b".to_owned(),
            path: "a/examples/b.rs".into(),
            summary: summary.to_owned(),
        };
        assert_eq!(first_sentence("// A licence.\nfn main() {}\n"), "");
        assert_eq!(faults(&[example("Shows it"), example("")]).len(), 1);
    }

    #[test]
    fn a_package_without_examples_has_none() {
        let folder = tempfile::tempdir().expect("a folder");
        let package = Package { name: "a".to_owned(), folder: "a".into(), features: Vec::new() };
        assert!(find(folder.path(), &[package]).expect("examples").is_empty());
    }
}
