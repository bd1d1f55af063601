//! What a trained model takes on disk.

use std::fs;
use std::io;
use std::path::Path;

use anyhow::Context;
use mvfusion_model::model::Model;
use mvfusion_model::train::parameter_bytes;
use serde::{Deserialize, Serialize};

use super::files::{REPORT, RESULTS};

/// Bytes on disk.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct DiskSize {
    /// The learned parameters in a checkpoint.
    pub parameters: u64,
    /// The run folder when its metrics were computed: checkpoints, Gaussians and images, but neither `results.json` nor
    /// the report.
    pub run: u64,
}

impl DiskSize {
    /// The sizes of a model and of its run.
    ///
    /// # Errors
    /// If the folder cannot be listed.
    pub fn of(model: &Model, run: &Path) -> anyhow::Result<Self> {
        let run = run_bytes(run).with_context(|| format!("cannot list the files of {}", run.display()))?;
        Ok(Self { parameters: parameter_bytes(model), run })
    }
}

/// Bytes of a run. The files that hold this number, or are made after it, do not count, so that a second evaluation finds
/// the same.
fn run_bytes(run: &Path) -> io::Result<u64> {
    let mut bytes = bytes_in(run)?;
    for name in [RESULTS, REPORT] {
        match run.join(name).symlink_metadata() {
            Ok(file) if file.is_file() => bytes -= file.len(),
            Err(error) if error.kind() != io::ErrorKind::NotFound => return Err(error),
            _ => {}
        }
    }
    Ok(bytes)
}

/// Bytes of the files in a folder. Hidden ones do not belong to the run, and links lead out of it.
fn bytes_in(folder: &Path) -> io::Result<u64> {
    let mut bytes = 0;
    for entry in fs::read_dir(folder)? {
        let entry = entry?;
        if entry.file_name().as_encoded_bytes().starts_with(b".") {
            continue;
        }
        let kind = entry.file_type()?;
        if kind.is_dir() {
            bytes += bytes_in(&entry.path())?;
        } else if kind.is_file() {
            bytes += entry.metadata()?.len();
        }
    }
    Ok(bytes)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn files_count_with_those_in_subfolders_but_without_hidden_ones() {
        let folder = tempfile::tempdir().expect("folder");
        fs::create_dir_all(folder.path().join("a/b")).expect("created");
        fs::create_dir(folder.path().join(".replaced")).expect("created");
        for (file, length) in [("x", 3), ("a/b/y", 40), (".replaced/z", 500), (".part", 6000)] {
            fs::write(folder.path().join(file), vec![0; length]).expect("written");
        }
        assert_eq!(bytes_in(folder.path()).expect("listed"), 43);
    }

    #[test]
    fn the_metrics_and_the_report_of_the_run_itself_do_not_count() {
        let folder = tempfile::tempdir().expect("folder");
        fs::create_dir(folder.path().join("protocols")).expect("created");
        for (file, length) in [("x", 3), (RESULTS, 40), (REPORT, 500), ("protocols/results.json", 6000)] {
            fs::write(folder.path().join(file), vec![0; length]).expect("written");
        }
        assert_eq!(run_bytes(folder.path()).expect("listed"), 6003);
    }
}
