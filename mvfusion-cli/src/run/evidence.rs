//! Whether a run is still what its results describe.

use std::fmt;
use std::path::{Path, PathBuf};

use anyhow::Context;
use mvfusion_data::files::read_bytes;
use mvfusion_model::files::sha256;
use serde::Deserialize;

use super::files::{CONFIG, MOST_OF_SETTINGS, RESULTS, read_json};

/// The hashes in `results.json` that identify a trained model and what it was evaluated on. Early versions wrote only
/// that of the parameters.
#[derive(Clone, Debug, Deserialize)]
struct Recorded {
    params_sha256: String,
    #[serde(default)]
    config_sha256: String,
    #[serde(default)]
    photos_sha256: String,
}

/// The same hashes of the run as it is now.
#[derive(Clone, Debug)]
pub struct Evidence {
    /// SHA-256 of all learned parameters.
    pub params_sha256: String,
    /// SHA-256 of `config.toml`.
    pub config_sha256: String,
    /// SHA-256 of the held-out photos; with `None`, they are not compared.
    pub photos_sha256: Option<String>,
}

/// The part of a run that has changed.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Part {
    /// The parameters in the checkpoint.
    Parameters,
    /// `config.toml`.
    Configuration,
    /// The held-out photos.
    Photos,
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
            Part::Photos => "the held-out photos are",
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
            let Recorded { params_sha256, config_sha256, photos_sha256 } = read_json(&results)?;
            let parts = [
                (Part::Parameters, params_sha256, Some(&self.params_sha256)),
                (Part::Configuration, config_sha256, Some(&self.config_sha256)),
                (Part::Photos, photos_sha256, self.photos_sha256.as_ref()),
            ];
            let known = parts.into_iter().filter_map(|(part, written, now)| Some((part, written, now?)));
            for (part, written, now) in known.filter(|(_, written, now)| !written.is_empty() && written != *now) {
                changes.push(Change { part, results: results.clone(), written, now: now.clone() });
            }
        }
        Ok(changes)
    }
}

/// How the configuration of a run differs from that of its results, if they can be read.
pub(super) fn changed_configuration(run: &Path) -> Option<Change> {
    let config_sha256 = config_hash(run).ok()?;
    let evidence = Evidence { params_sha256: String::new(), config_sha256, photos_sha256: None };
    evidence.changes([run]).ok()?.into_iter().find(|change| change.part == Part::Configuration)
}

#[cfg(test)]
mod tests {
    use std::fs;

    use super::*;

    #[test]
    fn each_part_that_changed_is_told_with_both_hashes() {
        let folder = tempfile::tempdir().expect("folder");
        let evidence = |params: &str, config: &str| Evidence {
            params_sha256: params.into(),
            config_sha256: config.into(),
            photos_sha256: None,
        };
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
        let on_photos = |photos: &str| changes(Evidence { photos_sha256: Some(photos.into()), ..evidence("a", "b") });
        assert_eq!(on_photos("e"), [], "nor of the photos");
        fs::write(folder.path().join(RESULTS), r#"{"params_sha256": "a", "photos_sha256": "e"}"#).expect("written");
        assert_eq!(on_photos("e"), []);
        let [other] = &on_photos("f")[..] else { panic!("one part has changed") };
        assert_eq!(other.part, Part::Photos);
        assert!(other.to_string().starts_with("the held-out photos are not what "), "{other}");
        assert_eq!(changes(evidence("a", "b")), [], "photos that are not known are not compared");
        fs::write(folder.path().join(RESULTS), "{").expect("written");
        assert!(evidence("a", "b").changes([folder.path()]).is_err());
    }
}
