//! Creating and removing the folder of a run, or another output folder of a command.

use std::ffi::OsString;
use std::fs;
use std::io;
use std::path::{Path, PathBuf};

use anyhow::{Context, bail};
use mvfusion_model::files::is_unfinished;
use tracing::warn;

use super::files::ENTRIES;

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
}

/// A run.
const RUN: Contents = Contents { what: "run", entries: &ENTRIES };

/// A folder that can be created. Nothing has been written yet.
#[derive(Clone, Debug)]
pub struct RunPlan {
    path: PathBuf,
    contents: Contents,
}

/// A run folder. Unless [`RunFolder::keep`] was called, dropping it removes the folder and restores what it replaced.
#[derive(Debug)]
pub struct RunFolder {
    path: PathBuf,
    contents: Contents,
    /// Whether the folder existed before.
    existed: bool,
    /// Parent folders that were created for this one, outermost first.
    parents: Vec<PathBuf>,
    kept: bool,
}

/// The subfolder that keeps the files of a replaced run until the new run is complete. It is inside the run folder,
/// because that folder may be a link or a mount point that cannot be renamed.
pub(super) const ASIDE: &str = ".replaced";

impl RunPlan {
    /// Checks that a run can be written to `path`. Leaves no trace.
    ///
    /// # Errors
    /// If the folder contains something that must not be replaced, or cannot be written to.
    pub fn new(path: &Path, existing: Existing) -> anyhow::Result<Self> {
        Self::for_contents(path, existing, RUN)
    }

    /// The same for a folder with other contents.
    ///
    /// # Errors
    /// As [`RunPlan::new`].
    pub fn for_contents(path: &Path, existing: Existing, contents: Contents) -> anyhow::Result<Self> {
        if path.exists() {
            check_existing(path, existing, contents)?;
        }
        trial_file(path, contents.what)?;
        Ok(Self { path: path.to_owned(), contents })
    }

    /// Creates the folder. An existing run is moved aside.
    ///
    /// # Errors
    /// If the file system refuses.
    pub fn create(self) -> anyhow::Result<RunFolder> {
        let Self { path, contents } = self;
        let existed = path.exists();
        let missing = |folder: &&Path| !folder.as_os_str().is_empty() && !folder.exists();
        let mut parents: Vec<PathBuf> = path.ancestors().skip(1).take_while(missing).map(Path::to_owned).collect();
        parents.reverse();
        let mut folder = RunFolder { path, contents, existed, parents, kept: false };
        fs::create_dir_all(&folder.path)
            .and_then(|()| remove_unfinished(&folder.path))
            .with_context(|| format!("cannot create the folder {}", folder.path.display()))?;
        if existed && let Err(error) = move_aside(&folder.path, contents.entries) {
            // Files that have not been moved yet belong to the old run and must not be removed.
            folder.kept = true;
            let back = move_back(&folder.path, contents.entries);
            let place = if back.is_ok() { String::new() } else { format!("; part of it is in {ASIDE}") };
            let what = contents.what;
            return Err(error)
                .with_context(|| format!("cannot move the old {what} in {} aside{place}", folder.path.display()));
        }
        Ok(folder)
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
    /// If the file system refuses.
    pub fn continued(path: &Path) -> anyhow::Result<Self> {
        trial_file(path, RUN.what)?;
        remove_unfinished(path).with_context(|| format!("cannot write to {}", path.display()))?;
        Ok(Self { path: path.to_owned(), contents: RUN, existed: true, parents: Vec::new(), kept: true })
    }

    /// Keeps the folder from now on, even after a failure. A replaced run stays aside.
    pub fn keep(&mut self) {
        self.kept = true;
    }

    /// Keeps the folder, which is complete now. Removes a replaced run.
    pub fn finish(&mut self) {
        self.kept = true;
        let aside = self.path.join(ASIDE);
        if aside.exists()
            && let Err(error) = fs::remove_dir_all(&aside)
        {
            warn!("cannot remove the replaced {} {}: {error}", self.contents.what, aside.display());
        }
    }

    /// Restores the original state.
    fn undo(&self) -> io::Result<()> {
        if self.existed {
            remove_entries(&self.path, self.contents.entries)?;
            return move_back(&self.path, self.contents.entries);
        }
        fs::remove_dir_all(&self.path)?;
        self.parents.iter().rev().try_for_each(fs::remove_dir)
    }
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

/// Removes unfinished files of a killed process at the top level of a folder.
fn remove_unfinished(folder: &Path) -> io::Result<()> {
    for entry in fs::read_dir(folder)? {
        let entry = entry?;
        if is_unfinished(&entry.file_name()) {
            fs::remove_file(entry.path())?;
        }
    }
    Ok(())
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
            && let Err(error) = self.undo()
        {
            warn!("cannot remove the failed {} {}: {error}", self.contents.what, self.path.display());
        }
    }
}

fn check_existing(path: &Path, existing: Existing, contents: Contents) -> anyhow::Result<()> {
    let (shown, what) = (path.display(), contents.what);
    if !path.is_dir() {
        bail!("cannot create the {what} folder {shown}: a file of that name exists. Choose another --out.");
    }
    let mut entries: Vec<OsString> = fs::read_dir(path)
        .and_then(|entries| entries.map(|entry| entry.map(|entry| entry.file_name())).collect())
        .with_context(|| format!("cannot list the folder {shown}"))?;
    entries.retain(|name| !is_unfinished(name));
    if entries.is_empty() {
        return Ok(());
    }
    if existing == Existing::Keep {
        bail!("the folder {shown} is not empty. Use --force to replace the {what} in it, or choose another --out.");
    }
    // Other files were put there by a user, who may still need them.
    match entries.iter().find(|name| *name != ASIDE && !contents.entries.iter().any(|&known| *name == known)) {
        Some(other) => bail!(
            "the folder {shown} contains `{}`, which does not belong to such a {what}, so --force does not replace it. \
             Move it away, or choose another --out.",
            other.display()
        ),
        None => Ok(()),
    }
}

/// Moves the files of a run aside. If another run is already there, an earlier replacement was interrupted. That run is
/// then kept, and the files in the folder are the remains of its successor.
fn move_aside(run: &Path, known: &'static [&'static str]) -> io::Result<()> {
    let aside = run.join(ASIDE);
    if aside.exists() {
        return remove_entries(run, known);
    }
    let entries: Vec<&str> = known.iter().copied().filter(|name| run.join(name).exists()).collect();
    if !entries.is_empty() {
        fs::create_dir(&aside)?;
    }
    entries.into_iter().try_for_each(|name| fs::rename(run.join(name), aside.join(name)))
}

fn move_back(run: &Path, known: &[&str]) -> io::Result<()> {
    let aside = run.join(ASIDE);
    if !aside.exists() {
        return Ok(());
    }
    for name in known.iter().filter(|name| aside.join(name).exists()) {
        fs::rename(aside.join(name), run.join(name))?;
    }
    fs::remove_dir(aside)
}

/// Removes the files of a run.
fn remove_entries(run: &Path, known: &[&str]) -> io::Result<()> {
    for path in known.iter().map(|name| run.join(name)) {
        if path.is_dir() {
            fs::remove_dir_all(path)?;
        } else if path.exists() {
            fs::remove_file(path)?;
        }
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;

    fn names(folder: &Path) -> Vec<OsString> {
        fs::read_dir(folder).expect("listed").map(|entry| entry.expect("entry").file_name()).collect()
    }

    #[test]
    fn a_failed_run_leaves_nothing_not_even_the_parents_it_made() {
        let ground = tempfile::tempdir().expect("folder");
        let plan = RunPlan::new(&ground.path().join("runs/deep/a"), Existing::Keep).expect("planned");
        assert!(names(ground.path()).is_empty());
        let folder = plan.create().expect("made");
        fs::write(folder.place(&["checkpoints", "x"]).expect("placed"), "x").expect("written");
        drop(folder);
        assert!(names(ground.path()).is_empty());
    }

    #[test]
    fn a_failed_replacement_brings_the_old_run_back() {
        let ground = tempfile::tempdir().expect("folder");
        let path = ground.path().join("a");
        fs::create_dir(&path).expect("made");
        fs::write(path.join(crate::run::RESULTS), "old").expect("written");
        let create = || RunPlan::new(&path, Existing::Replace).expect("planned").create().expect("made");
        let write = |folder: &RunFolder| fs::write(folder.place(&["results.json"]).expect("placed"), "new");
        let folder = create();
        write(&folder).expect("written");
        drop(folder);
        assert_eq!(names(&path), ["results.json"]);
        assert_eq!(fs::read(path.join("results.json")).expect("read"), b"old");

        let mut folder = create();
        write(&folder).expect("written");
        folder.keep();
        drop(folder);
        assert_eq!(fs::read(path.join(ASIDE).join("results.json")).expect("read"), b"old");
        assert_eq!(fs::read(path.join("results.json")).expect("read"), b"new");

        let mut folder = create();
        write(&folder).expect("written");
        folder.finish();
        drop(folder);
        assert_eq!(names(&path), ["results.json"]);
        assert_eq!(fs::read(path.join("results.json")).expect("read"), b"new");
    }

    #[test]
    fn a_replacement_that_was_cut_short_does_not_cost_the_old_run() {
        let ground = tempfile::tempdir().expect("folder");
        let path = ground.path().join("a");
        fs::create_dir_all(path.join(ASIDE)).expect("made");
        fs::write(path.join(ASIDE).join("results.json"), "old").expect("written");
        fs::write(path.join("metrics.jsonl"), "half a run").expect("written");
        drop(RunPlan::new(&path, Existing::Replace).expect("planned").create().expect("made"));
        assert_eq!(names(&path), ["results.json"]);
    }

    #[test]
    fn what_a_killed_process_was_writing_is_in_nobodys_way() {
        let ground = tempfile::tempdir().expect("folder");
        let path = ground.path().join("a");
        fs::create_dir(&path).expect("made");
        for existing in [Existing::Keep, Existing::Replace] {
            fs::write(path.join(".x7Gh1s.part"), "half a file").expect("written");
            let mut folder = RunPlan::new(&path, existing).expect("planned").create().expect("made");
            assert!(names(&path).is_empty());
            folder.finish();
        }
    }

    #[test]
    fn an_empty_folder_stays_after_a_failure() {
        let ground = tempfile::tempdir().expect("folder");
        let folder = RunPlan::new(ground.path(), Existing::Keep).expect("planned").create().expect("made");
        fs::write(folder.place(&["config.toml"]).expect("placed"), "x").expect("written");
        drop(folder);
        assert!(ground.path().exists() && names(ground.path()).is_empty());
    }

    #[test]
    fn what_is_no_run_is_never_replaced() {
        let ground = tempfile::tempdir().expect("folder");
        fs::write(ground.path().join("thesis.tex"), "x").expect("written");
        for existing in [Existing::Keep, Existing::Replace] {
            RunPlan::new(ground.path(), existing).expect_err("refused");
        }
        let error = RunPlan::new(&ground.path().join("thesis.tex/a"), Existing::Keep).expect_err("refused");
        assert!(error.to_string().contains("thesis.tex is a file"), "{error}");
    }
}
