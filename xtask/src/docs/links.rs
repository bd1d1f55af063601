//! Links between the files of the repository.

use std::collections::{BTreeMap, BTreeSet};
use std::path::{Component, Path, PathBuf};

use anyhow::Result;

use super::markdown::{Document, Link, LinkKind};
use super::{Fault, text};

/// What a link can lead to. All paths are from the root.
#[derive(Debug, Default)]
pub struct Repository {
    files: BTreeSet<PathBuf>,
    folders: BTreeSet<PathBuf>,
    documents: BTreeMap<PathBuf, Document>,
}

impl Repository {
    /// Reads the Markdown files among `files`.
    pub fn read(root: &Path, files: Vec<PathBuf>) -> Result<Self> {
        let mut repository = Self::default();
        for path in files {
            if path.extension().is_some_and(|extension| extension == "md") {
                let document = Document::parse(&text(root, &path)?);
                repository.documents.insert(path.clone(), document);
            }
            repository.folders.extend(path.ancestors().skip(1).map(Path::to_owned));
            repository.files.insert(path);
        }
        Ok(repository)
    }

    /// The faults of every document, and of the links between them.
    pub fn faults(&self) -> Vec<Fault> {
        let mut faults = Vec::new();
        for (path, document) in &self.documents {
            let fault = |line, message| Fault { path: path.clone(), line, message };
            faults.extend(document.faults.iter().map(|(line, message)| fault(*line, message.clone())));
            let broken = |link: &Link| self.broken(path, link).map(|message| fault(link.line, message));
            faults.extend(document.links.iter().filter_map(broken));
        }
        faults
    }

    /// Why a link leads nowhere, or `None` if it leads somewhere or out into the web.
    fn broken(&self, from: &Path, link: &Link) -> Option<String> {
        let target = link.target.as_str();
        if is_web(target) {
            return None;
        }
        let (path, anchor) = match target.split_once('#') {
            Some((path, anchor)) => (path, Some(anchor)),
            None => (target, None),
        };
        let Some(path) = resolve(from, path) else {
            return Some(format!("`{target}` leads out of the repository: link to a file within it, or to an address"));
        };
        let found = match link.kind {
            LinkKind::Link => self.files.contains(&path) || self.folders.contains(&path),
            LinkKind::Picture => self.files.contains(&path),
        };
        if !found {
            return Some(self.missing(target, &path, link.kind));
        }
        let document = self.documents.get(&path)?;
        let anchor = anchor.filter(|&anchor| !document.anchors.contains(anchor))?;
        Some(format!(
            "no heading of {} has the anchor `#{anchor}`: {}",
            path.display(),
            nearest(anchor, &document.anchors)
        ))
    }

    fn missing(&self, target: &str, path: &Path, kind: LinkKind) -> String {
        let what = match kind {
            LinkKind::Link => "file",
            LinkKind::Picture => "picture",
        };
        match self.files.iter().find(|file| file.file_name() == path.file_name()) {
            Some(file) => format!("no {what} `{target}`: is {} meant?", file.display()),
            None => format!("no {what} `{target}`: correct the path, or remove the link"),
        }
    }
}

/// Whether a target has a scheme (`https:`, `mailto:`) or the host of one.
fn is_web(target: &str) -> bool {
    let is_scheme = |text: &str| text.chars().all(|c| c.is_ascii_alphanumeric() || matches!(c, '+' | '-' | '.'));
    target.starts_with("//") || target.split_once(':').is_some_and(|(scheme, _)| is_scheme(scheme))
}

/// A link's path from the root, or `None` if it leads out of that.
fn resolve(from: &Path, target: &str) -> Option<PathBuf> {
    let mut path = match target {
        "" => return Some(from.to_owned()),
        _ if target.starts_with('/') => PathBuf::new(),
        _ => from.parent().map(Path::to_owned).unwrap_or_default(),
    };
    for component in Path::new(target).components() {
        match component {
            Component::Normal(name) => path.push(name),
            Component::ParentDir if path.pop() => {}
            Component::ParentDir => return None,
            _ => {}
        }
    }
    Some(path)
}

/// What to do about an anchor that does not exist.
fn nearest(anchor: &str, anchors: &BTreeSet<String>) -> String {
    let likeness = |other: &String| strsim::jaro_winkler(anchor, other);
    match anchors.iter().max_by(|a, b| likeness(a).total_cmp(&likeness(b))) {
        Some(other) => format!("is `#{other}` meant?"),
        None => "the file has no headings".to_owned(),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The faults of `docs/a.md` beside `README.md`, `docs/b.md` and `docs/c.png`.
    fn faults(text: &str) -> Vec<String> {
        let folder = tempfile::tempdir().expect("a folder");
        std::fs::create_dir(folder.path().join("docs")).expect("a folder");
        let files = [("README.md", "# Title\n"), ("docs/a.md", text), ("docs/b.md", "# Of b\n"), ("docs/c.png", "")];
        for (path, text) in files {
            std::fs::write(folder.path().join(path), text).expect("a file");
        }
        let repository = Repository::read(folder.path(), files.map(|(path, _)| path.into()).to_vec()).expect("files");
        repository.faults().iter().map(Fault::to_string).collect()
    }

    #[track_caller]
    fn assert_fault(text: &str, expected: &str) {
        let faults = faults(text);
        assert_eq!(faults.len(), 1, "{faults:?}");
        assert!(faults[0].contains(expected), "{}", faults[0]);
    }

    #[test]
    fn links_that_lead_somewhere_pass() {
        let text = "# Of a\n[1](b.md) [2](../README.md#title) [3](../docs) [4](/docs/b.md#of-b) [5](#of-a) ![6](c.png)\n\
                    [7](https://example.org/none) [8](mailto:a@example.org) <https://example.org>\n";
        assert_eq!(faults(text), [] as [&str; 0]);
    }

    #[test]
    fn a_link_to_a_file_that_does_not_exist_is_found_with_its_line() {
        assert_fault("# Of a\n\n[1](none.md)\n", "docs/a.md:3: no file `none.md`: correct the path");
        assert_fault("[1][x]\n\n[x]: none.md\n", "no file `none.md`");
        assert_fault("<a href=\"none.md\">1</a>\n", "no file `none.md`");
    }

    #[test]
    fn a_file_that_lies_elsewhere_is_proposed() {
        assert_fault("[1](README.md)\n", "no file `README.md`: is README.md meant?");
    }

    #[test]
    fn a_link_out_of_the_repository_is_found() {
        assert_fault("[1](../../elsewhere.md)\n", "leads out of the repository");
    }

    #[test]
    fn an_anchor_that_no_heading_has_is_found_with_the_nearest() {
        assert_fault(
            "[1](b.md#of-c)\n",
            "docs/a.md:1: no heading of docs/b.md has the anchor `#of-c`: is `#of-b` meant?",
        );
        assert_fault("text [1](#none)\n", "the file has no headings");
    }

    #[test]
    fn a_picture_that_does_not_exist_is_found() {
        assert_fault("![1](d.png)\n", "no picture `d.png`");
        assert_fault("![1](../docs)\n", "no picture `../docs`");
        assert_fault("<img alt=\"1\" src=\"d.png\">\n", "no picture `d.png`");
    }
}
