//! The checkpoints of a run.

use std::fs;
use std::io;
use std::path::{Path, PathBuf};

use anyhow::Context;

use super::files::{CHECKPOINTS, FINAL};

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

/// Removes all checkpoints but the final one and the newest `keep` of the others.
///
/// # Errors
/// If one cannot be removed.
pub fn thin_out(run: &Path, keep: usize) -> anyhow::Result<()> {
    let old = checkpoints(run)?.into_iter().filter(|checkpoint| checkpoint.step.is_some()).skip(keep);
    old.map(|checkpoint| checkpoint.path)
        .try_for_each(|path| fs::remove_file(&path).with_context(|| format!("cannot remove {}", path.display())))
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
        thin_out(run.path(), 2).expect("removed");
        assert_eq!(steps(), [None, Some(100), Some(20)]);
    }
}
