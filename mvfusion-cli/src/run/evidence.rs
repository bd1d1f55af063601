//! Whether a run is still what its results describe.

use std::fmt;
use std::path::{Path, PathBuf};

use anyhow::Context;
use mvfusion_data::files::read_bytes;
use mvfusion_model::files::sha256;
use serde::Deserialize;

use super::files::{CONFIG, MOST_OF_SETTINGS, RESULTS, read_json};

/// The hashes in `results.json` that identify a trained model. Early versions wrote no hash of the configuration.
#[derive(Clone, Debug, Deserialize)]
struct Recorded {
    params_sha256: String,
    #[serde(default)]
    config_sha256: String,
}

/// The same hashes of the run as it is now.
#[derive(Clone, Debug)]
pub struct Evidence {
    /// SHA-256 of all learned parameters.
    pub params_sha256: String,
    /// SHA-256 of `config.toml`.
    pub config_sha256: String,
}

/// The part of a run that has changed.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Part {
    /// The parameters in the checkpoint.
    Parameters,
    /// `config.toml`.
    Configuration,
}

/// A difference between a run and its results.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Change {
    /// What has changed.
    pub part: Part,
    /// The results.
    pub results: PathBuf,
    written: String,
    now: String,
}

impl fmt::Display for Change {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let part = match self.part {
            Part::Parameters => "the parameters of the checkpoint are",
            Part::Configuration => "config.toml is",
        };
        let Self { results, written, now, .. } = self;
        write!(
            f,
            "{part} not what {} describes: its SHA-256 was written as {written} and is now {now}",
            results.display()
        )
    }
}

/// SHA-256 of a run's `config.toml`.
///
/// # Errors
/// If the file cannot be read.
pub fn config_hash(run: &Path) -> anyhow::Result<String> {
    let path = run.join(CONFIG);
    let bytes = read_bytes(&path, MOST_OF_SETTINGS).with_context(|| format!("cannot read {}", path.display()))?;
    Ok(sha256(&bytes))
}

impl Evidence {
    /// What differs from the results in these folders, each of which need not have any.
    ///
    /// # Errors
    /// If results exist and cannot be read.
    pub fn changes<'a>(&self, folders: impl IntoIterator<Item = &'a Path>) -> anyhow::Result<Vec<Change>> {
        let mut changes = Vec::new();
        for folder in folders {
            let results = folder.join(RESULTS);
            if !results.is_file() {
                continue;
            }
            let Recorded { params_sha256, config_sha256 } = read_json(&results)?;
            let parts = [
                (Part::Parameters, params_sha256, &self.params_sha256),
                (Part::Configuration, config_sha256, &self.config_sha256),
            ];
            for (part, written, now) in
                parts.into_iter().filter(|(_, written, now)| !written.is_empty() && written != *now)
            {
                changes.push(Change { part, results: results.clone(), written, now: now.clone() });
            }
        }
        Ok(changes)
    }
}

/// How the configuration of a run differs from that of its results, if they can be read.
pub(super) fn changed_configuration(run: &Path) -> Option<Change> {
    let config_sha256 = config_hash(run).ok()?;
    let evidence = Evidence { params_sha256: String::new(), config_sha256 };
    evidence.changes([run]).ok()?.into_iter().find(|change| change.part == Part::Configuration)
}

#[cfg(test)]
mod tests {
    use std::fs;

    use super::*;

    #[test]
    fn each_part_that_changed_is_told_with_both_hashes() {
        let folder = tempfile::tempdir().expect("folder");
        let evidence =
            |params: &str, config: &str| Evidence { params_sha256: params.into(), config_sha256: config.into() };
        let changes = |evidence: Evidence| evidence.changes([folder.path()]).expect("read");
        assert_eq!(changes(evidence("a", "b")), [], "without results, there is nothing to compare with");
        fs::write(folder.path().join(RESULTS), r#"{"params_sha256": "a", "config_sha256": "b", "x": 1}"#)
            .expect("written");
        assert_eq!(changes(evidence("a", "b")), []);
        let both = changes(evidence("c", "d"));
        assert_eq!(both.iter().map(|change| change.part).collect::<Vec<_>>(), [Part::Parameters, Part::Configuration]);
        let said = both[0].to_string();
        assert!(said.contains("results.json") && said.ends_with("written as a and is now c"), "{said}");
        fs::write(folder.path().join(RESULTS), r#"{"params_sha256": "a"}"#).expect("written");
        assert_eq!(changes(evidence("a", "d")), [], "early results have no hash of the configuration");
        fs::write(folder.path().join(RESULTS), "{").expect("written");
        assert!(evidence("a", "b").changes([folder.path()]).is_err());
    }
}
