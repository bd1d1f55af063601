//! The checkpoints of a run.

use std::fs;
use std::io;
use std::path::{Path, PathBuf};

use anyhow::{Context, bail};

use super::files::{CHECKPOINTS, FINAL};
use super::folder::{require_folder, waiting_note};

/// A checkpoint in a run folder.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Checkpoint {
    /// The file.
    pub path: PathBuf,
    /// Steps done, for one that was written during the training; `None` for the final one.
    pub step: Option<usize>,
}

/// File name of a checkpoint that is written during the training.
pub fn step_file(step: usize) -> String {
    format!("step_{step}.safetensors")
}

/// The step of a file of that name.
fn step_of(name: &str) -> Option<usize> {
    name.strip_prefix("step_")?.strip_suffix(".safetensors")?.parse().ok()
}

/// The checkpoints of a run, the newest first.
///
/// # Errors
/// If the folder exists and cannot be listed.
pub fn checkpoints(run: &Path) -> anyhow::Result<Vec<Checkpoint>> {
    let folder = run.join(CHECKPOINTS);
    let entries = match fs::read_dir(&folder) {
        Err(error) if error.kind() == io::ErrorKind::NotFound => return Ok(Vec::new()),
        entries => entries.with_context(|| format!("cannot list {}", folder.display()))?,
    };
    let mut found = Vec::new();
    for entry in entries {
        let name = entry.with_context(|| format!("cannot list {}", folder.display()))?.file_name();
        let Some(name) = name.to_str() else { continue };
        let step = step_of(name);
        if name == FINAL || step.is_some() {
            found.push(Checkpoint { path: folder.join(name), step });
        }
    }
    found.sort_by_key(|checkpoint| std::cmp::Reverse(checkpoint.step.unwrap_or(usize::MAX)));
    Ok(found)
}

/// The newest checkpoint of a run.
///
/// # Errors
/// If the folder is no run, or contains none.
pub fn newest_checkpoint(run: &Path) -> anyhow::Result<Checkpoint> {
    let shown = run.display();
    require_folder(run)?;
    match (checkpoints(run)?.into_iter().next(), waiting_note(run)) {
        (Some(newest), _) => Ok(newest),
        (None, Some(note)) => bail!("{shown} contains no checkpoint: its training was interrupted. {note}"),
        (None, None) => {
            bail!("{shown} contains no checkpoint: it is not a run, or its training was interrupted before one.")
        }
    }
}

/// Renames the final checkpoint of a run that is trained on: it is that of a step now.
///
/// # Errors
/// If it cannot be renamed.
pub fn make_intermediate(checkpoint: &Checkpoint, step: usize) -> anyhow::Result<()> {
    if checkpoint.step.is_some() {
        return Ok(());
    }
    let path = &checkpoint.path;
    fs::rename(path, path.with_file_name(step_file(step))).with_context(|| format!("cannot rename {}", path.display()))
}

/// Renames a checkpoint that cannot be read, so that it is no longer the newest one. It is not removed.
///
/// # Errors
/// If it cannot be renamed.
pub fn put_away(checkpoint: &Checkpoint) -> anyhow::Result<()> {
    let path = &checkpoint.path;
    let away = path.with_extension("safetensors.unreadable");
    fs::rename(path, away).with_context(|| format!("cannot rename {}", path.display()))
}

/// Removes checkpoints of steps. Kept are the newest `keep`, except for those before step `least`; whatever these
/// numbers are, the newest checkpoint and the final one stay.
///
/// # Errors
/// If one cannot be removed.
pub fn thin_out(run: &Path, keep: usize, least: usize) -> anyhow::Result<()> {
    let mut kept = 0;
    for (age, Checkpoint { path, step }) in checkpoints(run)?.into_iter().enumerate() {
        let Some(step) = step else { continue };
        if age == 0 || (kept < keep && step >= least) {
            kept += 1;
        } else {
            fs::remove_file(&path).with_context(|| format!("cannot remove {}", path.display()))?;
        }
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_final_checkpoint_is_the_newest_and_old_ones_are_removed() {
        let run = tempfile::tempdir().expect("folder");
        assert_eq!(checkpoints(run.path()).expect("none"), []);
        fs::create_dir(run.path().join(CHECKPOINTS)).expect("made");
        for name in ["step_9.safetensors", "step_100.safetensors", "step_20.safetensors", "notes.txt", FINAL] {
            fs::write(run.path().join(CHECKPOINTS).join(name), "").expect("written");
        }
        let steps = || checkpoints(run.path()).expect("listed").into_iter().map(|c| c.step).collect::<Vec<_>>();
        assert_eq!(steps(), [None, Some(100), Some(20), Some(9)]);
        thin_out(run.path(), 2, 0).expect("removed");
        assert_eq!(steps(), [None, Some(100), Some(20)]);
        thin_out(run.path(), 2, 50).expect("removed");
        assert_eq!(steps(), [None, Some(100)]);
        fs::remove_file(run.path().join(CHECKPOINTS).join(FINAL)).expect("removed");
        thin_out(run.path(), 2, 200).expect("nothing to remove");
        assert_eq!(steps(), [Some(100)], "the newest one stays");
    }
}
