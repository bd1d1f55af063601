//! Creating and removing the folder of a run, or another output folder of a command.

#[cfg(test)]
mod tests;

use std::ffi::OsString;
use std::fs;
use std::path::{Path, PathBuf};

use anyhow::{Context, bail};
use mvfusion_model::files::is_unfinished;
use serde::Deserialize;
use tracing::warn;

use super::aside;
use super::checkpoints::checkpoints;
use super::files::{ENTRIES, FILMS, METRICS, RECORD, TENSORBOARD, read_json};
use super::lock::{FolderLock, LOCK};
use super::record::RunRecord;
use crate::interrupt::path_for_shell;

/// What happens to a run that is already in the folder.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Existing {
    /// It stays, and the new run is an error.
    Keep,
    /// The new run replaces it.
    Replace,
}

/// The purpose of a folder, and everything that may be written at its top level.
#[derive(Clone, Copy, Debug)]
pub struct Contents {
    /// What it contains, for messages: `run`.
    pub what: &'static str,
    /// Names of files and folders.
    pub entries: &'static [&'static str],
    /// Those of them whose files other processes may be writing.
    pub foreign: &'static [&'static str],
    /// The file by which such a folder is known, for messages.
    pub mark: &'static str,
    /// Whether this program wrote the folder, by the contents of that file: others use names like these as well.
    pub is_ours: fn(&Path) -> bool,
    /// Whether everything in the folder has been written.
    pub is_complete: fn(&Path) -> bool,
    /// Whether an incomplete folder can be continued.
    pub is_of_use: fn(&Path) -> bool,
}

/// A run.
pub const RUN: Contents = Contents {
    what: "run",
    entries: &ENTRIES,
    foreign: &[FILMS],
    mark: RECORD,
    is_ours: is_run,
    is_complete: is_finished,
    is_of_use: has_checkpoint,
};

/// What every version of this program writes into [`RECORD`].
#[derive(Deserialize)]
struct Mark {
    #[serde(rename = "burn")]
    _burn: String,
    #[serde(rename = "preset")]
    _preset: String,
}

/// A folder that can be created. Nothing has been written yet, and no other process writes to it.
#[derive(Debug)]
pub struct RunPlan {
    path: PathBuf,
    contents: Contents,
    lock: FolderLock,
}

/// A run folder that only this process writes to. Unless [`RunFolder::keep`] was called, dropping it removes what was
/// written and restores what it replaced.
#[derive(Debug)]
pub struct RunFolder {
    path: PathBuf,
    contents: Contents,
    kept: bool,
    /// Released last.
    _lock: FolderLock,
}

impl RunPlan {
    /// Checks that a run can be written to `path`, and locks it. Leaves no trace unless the run is created.
    ///
    /// # Errors
    /// If the folder contains something that must not be replaced, cannot be written to, or another process writes to
    /// it.
    pub fn new(path: &Path, existing: Existing) -> anyhow::Result<Self> {
        Self::for_contents(path, existing, RUN)
    }

    /// The same for a folder with other contents.
    ///
    /// # Errors
    /// As [`RunPlan::new`].
    pub fn for_contents(path: &Path, existing: Existing, contents: Contents) -> anyhow::Result<Self> {
        if path.exists() && !path.is_dir() {
            let what = contents.what;
            bail!(
                "cannot create the {what} folder {}: a file of that name exists. Choose another --out.",
                path.display()
            );
        }
        trial_file(path, contents.what)?;
        let lock = FolderLock::take(path)?;
        check_existing(path, existing, contents)?;
        Ok(Self { path: path.to_owned(), contents, lock })
    }

    /// Makes room in the folder. An existing run is moved aside.
    ///
    /// # Errors
    /// If the file system refuses.
    pub fn create(self) -> anyhow::Result<RunFolder> {
        let Self { path, contents, lock } = self;
        aside::settle(&path, &contents).and_then(|()| aside::set_aside(&path, &contents)).with_context(|| {
            let what = contents.what;
            format!("cannot move the old {what} in {} aside; the next try puts right what has moved", path.display())
        })?;
        Ok(RunFolder { path, contents, kept: false, _lock: lock })
    }
}

impl RunFolder {
    /// The folder.
    pub fn path(&self) -> &Path {
        &self.path
    }

    /// The path of a file or folder within. Missing folders on the way are created.
    ///
    /// # Errors
    /// If the file system refuses.
    pub fn place(&self, parts: &[&str]) -> anyhow::Result<PathBuf> {
        place(&self.path, parts)
    }

    /// A run folder that is continued. It is kept whatever happens.
    ///
    /// # Errors
    /// If it does not exist, cannot be written to, or another process writes to it.
    pub fn continued(path: &Path) -> anyhow::Result<Self> {
        Self::continued_with(path, RUN)
    }

    /// The same for a folder with other contents.
    ///
    /// # Errors
    /// As [`RunFolder::continued`].
    pub fn continued_with(path: &Path, contents: Contents) -> anyhow::Result<Self> {
        let lock = lock(path)?;
        trial_file(path, contents.what)?;
        aside::settle(path, &contents).with_context(|| format!("cannot write to {}", path.display()))?;
        Ok(Self { path: path.to_owned(), contents, kept: true, _lock: lock })
    }

    /// Keeps the folder from now on, even after a failure. A replaced run stays aside.
    pub fn keep(&mut self) {
        self.kept = true;
    }

    /// Keeps the folder, which is complete now. Removes a replaced run.
    pub fn finish(&mut self) {
        self.kept = true;
        if let Err(error) = aside::discard_replaced(&self.path) {
            warn!("cannot remove the replaced {} in {}: {error}", self.contents.what, self.path.display());
        }
    }

    /// Brings back what waits in place of what is in the folder. If nothing waits, nothing changes.
    ///
    /// # Errors
    /// If the file system refuses.
    pub fn restore(&self) -> anyhow::Result<()> {
        if !aside::waits(&self.path) {
            return Ok(());
        }
        let path = self.path.display();
        aside::bring_back(&self.path, &self.contents)
            .with_context(|| format!("cannot bring back the replaced {} in {path}", self.contents.what))
    }
}

/// The lock of a run that exists.
///
/// # Errors
/// If it does not, or another process writes to it.
pub fn lock(run: &Path) -> anyhow::Result<FolderLock> {
    require_folder(run)?;
    FolderLock::take(run)
}

/// Checks that there is a folder of a run.
///
/// # Errors
/// If there is none.
pub(super) fn require_folder(run: &Path) -> anyhow::Result<()> {
    if !run.is_dir() {
        bail!("there is no folder {}. Give a run folder, such as runs/quickstart-0.", run.display());
    }
    Ok(())
}

/// A note on the run that waits until its successor in `folder` is complete, and how to bring it back. `None` if none
/// does.
pub fn waiting_note(folder: &Path) -> Option<String> {
    note_on_waiting(folder, RUN.what)
}

fn note_on_waiting(folder: &Path, what: &str) -> Option<String> {
    aside::waits(folder).then(|| {
        format!(
            "{} holds a replaced {what}, until the {what} that replaces it is finished. Bring it back with: mvfusion \
             restore {}",
            folder.display(),
            path_for_shell(folder)
        )
    })
}

/// Whether a run is finished.
pub fn is_finished(run: &Path) -> bool {
    read_json::<RunRecord>(&run.join(RECORD)).is_ok_and(|record| record.finished.is_some())
}

/// Whether a folder is a run of this program, or an empty log: what is left of a training killed before its record.
pub(crate) fn is_run(folder: &Path) -> bool {
    let is_log = || fs::metadata(folder.join(METRICS)).is_ok_and(|log| log.is_file() && log.len() == 0);
    let is_begun = || ENTRIES.iter().all(|name| [METRICS, TENSORBOARD].contains(name) || !folder.join(name).exists());
    read_json::<Mark>(&folder.join(RECORD)).is_ok() || (is_log() && is_begun())
}

/// Whether a run can be continued.
fn has_checkpoint(run: &Path) -> bool {
    // What cannot be listed may be of use.
    checkpoints(run).map_or(true, |found| !found.is_empty())
}

/// An unnamed file at the place of an existing or future folder. It proves that files can be written there.
///
/// # Errors
/// If they cannot.
pub(crate) fn trial_file(path: &Path, what: &str) -> anyhow::Result<fs::File> {
    let shown = path.display();
    if let Some(file) = path.ancestors().find(|folder| folder.is_file()) {
        bail!("cannot create the {what} folder {shown}: {} is a file. Choose another --out.", file.display());
    }
    let ground = path.ancestors().find(|folder| folder.is_dir()).unwrap_or(Path::new("."));
    tempfile::tempfile_in(ground).with_context(|| {
        format!(
            "cannot write to {}, where the {what} folder {shown} would be created; choose another --out",
            ground.display()
        )
    })
}

/// The path of a file or folder within a run folder. Missing folders on the way are created.
///
/// # Errors
/// If the file system refuses.
pub(crate) fn place(run: &Path, parts: &[&str]) -> anyhow::Result<PathBuf> {
    let path = parts.iter().fold(run.to_owned(), |path, part| path.join(part));
    if let Some(folder) = path.parent() {
        fs::create_dir_all(folder).with_context(|| format!("cannot create the folder {}", folder.display()))?;
    }
    Ok(path)
}

impl Drop for RunFolder {
    fn drop(&mut self) {
        if !self.kept
            && let Err(error) = aside::bring_back(&self.path, &self.contents)
        {
            warn!("cannot remove the failed {} {}: {error}", self.contents.what, self.path.display());
        }
    }
}

fn check_existing(path: &Path, existing: Existing, contents: Contents) -> anyhow::Result<()> {
    let (shown, what) = (path.display(), contents.what);
    let mut entries: Vec<OsString> = fs::read_dir(path)
        .and_then(|entries| entries.map(|entry| entry.map(|entry| entry.file_name())).collect())
        .with_context(|| format!("cannot list the folder {shown}"))?;
    entries.retain(|name| !is_unfinished(name) && name != LOCK);
    if entries.is_empty() {
        return Ok(());
    }
    if !entries.iter().any(|name| aside::is_aside(name)) && !(contents.is_ours)(path) {
        bail!(
            "the folder {shown} is not empty, and was not made by this program: it has no {} as this program writes it \
             into every {what}. Choose another --out, or move away what it contains.",
            contents.mark
        );
    }
    if existing == Existing::Keep {
        match note_on_waiting(path, what) {
            Some(note) => bail!("{note}. Or use --force to begin anew; the replaced {what} is kept until then."),
            None if (contents.is_of_use)(path) && !(contents.is_complete)(path) => bail!(
                "the folder {shown} contains an unfinished {what}. Continue it with --resume {}, replace it with --force, \
                 or choose another --out.",
                path_for_shell(path)
            ),
            None => bail!(
                "the folder {shown} is not empty. Use --force to replace the {what} in it, or choose another --out."
            ),
        }
    }
    // Other files were put there by a user, who may still need them.
    let is_known = |name: &OsString| aside::is_aside(name) || contents.entries.iter().any(|&known| *name == known);
    match entries.iter().find(|name| !is_known(name)) {
        Some(other) => bail!(
            "the folder {shown} contains `{}`, which no {what} of this program contains, so --force does not replace \
             it. Move it away, or choose another --out.",
            other.display()
        ),
        None => Ok(()),
    }
}
