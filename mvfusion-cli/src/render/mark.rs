//! `films.json`: the names of what was rendered into a folder, so that nothing else is replaced.

use std::collections::BTreeSet;
use std::path::{Path, PathBuf};

use anyhow::Context;

use crate::{atomic, run};

/// Name of the file.
pub(super) const MARK: &str = "films.json";

/// The folders and animations that were rendered into a folder.
pub(super) struct Mark {
    folder: PathBuf,
    names: BTreeSet<String>,
}

impl Mark {
    /// Reads that of a folder; none is empty.
    ///
    /// # Errors
    /// If the file is of another program.
    pub(super) fn read(folder: &Path) -> anyhow::Result<Self> {
        let path = folder.join(MARK);
        let read = || {
            run::read_json(&path).with_context(|| {
                format!(
                    "{} is no list of renders as `mvfusion render` writes it. Choose another folder with --out, or move \
                     it away",
                    path.display()
                )
            })
        };
        let names = if path.exists() { read()? } else { BTreeSet::new() };
        Ok(Self { folder: folder.to_owned(), names })
    }

    /// Its path.
    pub(super) fn path(&self) -> PathBuf {
        self.folder.join(MARK)
    }

    /// Whether a file was rendered, as far as its folder or its own name tells.
    pub(super) fn has(&self, path: &Path) -> bool {
        self.name_of(path).is_some_and(|name| self.names.contains(&name))
    }

    /// Adds folders and animations, and writes the file.
    ///
    /// # Errors
    /// If the file cannot be written.
    pub(super) fn add(mut self, paths: impl Iterator<Item = PathBuf>) -> anyhow::Result<()> {
        let names: Vec<String> = paths.filter_map(|path| self.name_of(&path)).collect();
        self.names.extend(names);
        atomic::write_json(&self.path(), &self.names)
    }

    /// The first part of a path within the folder.
    fn name_of(&self, path: &Path) -> Option<String> {
        let name = path.strip_prefix(&self.folder).ok()?.components().next()?;
        Some(name.as_os_str().to_string_lossy().into_owned())
    }
}
