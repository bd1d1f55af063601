//! The files of a run folder, as far as they can be read.

use std::fmt;
use std::io;
use std::path::{Path, PathBuf};

use anyhow::bail;
use mvfusion_data::files::read_text;
use mvfusion_model::Config;
use mvfusion_model::evaluation::Protocol;
use serde::de::DeserializeOwned;
use serde_json::Value;

use super::log::Log;
use crate::config;
use crate::run::{self, PerView, Replacements, Results, SceneFile};

/// A part of a run, or why it is missing.
pub type Found<T> = Result<T, Missing>;

/// Why a part of a run cannot be shown: a sentence that names the file.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Missing(String);

impl Missing {
    /// A reason, as a sentence.
    pub fn new(sentence: impl Into<String>) -> Self {
        Self(sentence.into())
    }
}

impl fmt::Display for Missing {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(&self.0)
    }
}

/// How to restore a file that the evaluation writes.
const REMEDY: &str = " `mvfusion eval RUN --write` writes it again.";

/// The files of a run, except for its images.
#[derive(Debug)]
pub struct RunFiles {
    /// The folder.
    pub folder: PathBuf,
    /// The text of the configuration file.
    pub config_text: Found<String>,
    /// The configuration, before `train.scale`.
    pub config: Found<Config>,
    /// `run.json`, whose contents depend on the version.
    pub record: Found<Value>,
    /// `metrics.jsonl`.
    pub log: Found<Log>,
    /// `results.json` as a whole.
    pub results_value: Found<Value>,
    /// The metrics in it.
    pub results: Found<Results>,
    /// `per_view.json`.
    pub per_view: Found<PerView>,
    /// The cameras and times of the views.
    pub scene: Found<SceneFile>,
    /// What the panels of the strips show; unknown in runs of earlier versions.
    pub panels: Option<Vec<String>>,
    /// The metrics with replaced outputs of the motion-aware modules; absent if they were never computed.
    pub replacements: Option<Found<Replacements>>,
    /// The metrics under other protocols, in the order of [`Protocol::ALL`].
    pub others: Vec<(Protocol, Found<Results>)>,
}

impl RunFiles {
    /// Reads all files that exist.
    ///
    /// # Errors
    /// If the folder does not exist, or contains no file of a run.
    pub fn read(folder: &Path) -> anyhow::Result<Self> {
        if !folder.is_dir() {
            bail!("the folder {} does not exist. Give a run folder, such as runs/quickstart-0.", folder.display());
        }
        if !run::ENTRIES.iter().any(|&name| name != run::REPORT && folder.join(name).exists()) {
            bail!("{} is not a run: it contains neither {} nor {}.", folder.display(), run::CONFIG, run::RESULTS);
        }
        Ok(Self {
            folder: folder.to_owned(),
            config_text: text(folder, run::CONFIG),
            config: text(folder, run::CONFIG).and_then(|_| configuration(folder)),
            // The evaluation writes everything except the record.
            record: json(folder, run::RECORD, ""),
            log: text(folder, run::METRICS).map(|text| Log::parse(&text)),
            results_value: json(folder, run::RESULTS, REMEDY),
            results: json(folder, run::RESULTS, REMEDY),
            per_view: json(folder, run::PER_VIEW, REMEDY),
            scene: json(folder, run::SCENE, REMEDY),
            panels: json(folder, &format!("{}/{}", run::STRIPS, run::PANELS), REMEDY).ok(),
            replacements: folder.join(run::REPLACEMENTS).exists().then(|| {
                json(folder, run::REPLACEMENTS, " `mvfusion eval RUN --replace all --write` writes it again.")
            }),
            others: others(folder),
        })
    }

    /// A value of `run.json` as text, by its path.
    pub fn recorded(&self, path: &[&str]) -> Option<String> {
        let value = path.iter().try_fold(self.record.as_ref().ok()?, |value, name| value.get(name))?;
        match value {
            Value::Null | Value::Array(_) | Value::Object(_) => None,
            Value::String(text) => Some(text.clone()),
            other => Some(other.to_string()),
        }
    }
}

/// The metrics under protocols other than the run's own. A protocol that was never used is not missing.
fn others(folder: &Path) -> Vec<(Protocol, Found<Results>)> {
    let read = |protocol: Protocol| {
        let name = format!("{}/{}/{}", run::PROTOCOLS, protocol.name(), run::RESULTS);
        let remedy = format!(" `mvfusion eval RUN --protocol {} --write` writes it again.", protocol.name());
        folder.join(&name).exists().then(|| (protocol, json::<Results>(folder, &name, &remedy)))
    };
    let is_other = |protocol: &Protocol| *protocol != Protocol::default();
    Protocol::ALL.into_iter().filter(is_other).filter_map(read).collect()
}

fn configuration(folder: &Path) -> Found<Config> {
    config::read(&folder.join(run::CONFIG))
        .map_err(|error| Missing::new(format!("{} was written by another version: {error:#}", run::CONFIG)))
}

fn text(folder: &Path, name: &str) -> Found<String> {
    read_text(&folder.join(name), run::MOST_OF_RECORDS).map_err(|error| match error.kind() {
        io::ErrorKind::NotFound => Missing::new(format!("The run has no {name}.")),
        _ => Missing::new(format!("{name} cannot be read: {error}.")),
    })
}

/// Reads a JSON file. If that fails, `remedy` follows the reason.
fn json<T: DeserializeOwned>(folder: &Path, name: &str, remedy: &str) -> Found<T> {
    let wrong = |error| Missing::new(format!("{name} cannot be read: {error}.{remedy}"));
    serde_json::from_str(&text(folder, name)?).map_err(wrong)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_is_no_run_is_refused_and_named() {
        let folder = tempfile::tempdir().expect("folder");
        let error = RunFiles::read(folder.path()).expect_err("refused").to_string();
        assert!(error.contains("is not a run") && error.contains("results.json"), "{error}");
        let error = RunFiles::read(&folder.path().join("gone")).expect_err("refused").to_string();
        assert!(error.contains("does not exist") && error.contains("gone"), "{error}");
        // A report alone is what is left of a run, not a run.
        std::fs::write(folder.path().join(run::REPORT), "x").expect("written");
        RunFiles::read(folder.path()).expect_err("refused");
    }

    #[test]
    fn each_file_that_is_missing_or_broken_is_named_and_costs_no_other() {
        let folder = tempfile::tempdir().expect("folder");
        let write = |name: &str, bytes: &[u8]| std::fs::write(folder.path().join(name), bytes).expect("written");
        write(run::RECORD, br#"{"preset": "a", "seed": 7, "git": null}"#);
        write(run::RESULTS, b"{\"protocol\": ");
        write(run::METRICS, &[0xff, 0xfe]);
        write(run::CONFIG, b"[train]\nno_such_key = 1\n");
        let files = RunFiles::read(folder.path()).expect("read");
        assert_eq!(files.recorded(&["seed"]).as_deref(), Some("7"));
        assert_eq!(files.recorded(&["git"]), None);
        assert_eq!(files.recorded(&["scene", "name"]), None);
        let sentence = |found: Option<Missing>, words: [&str; 2]| {
            let found = found.expect("missing").to_string();
            assert!(words.iter().all(|word| found.contains(word)), "{found}");
        };
        sentence(files.results.err(), ["results.json", "EOF"]);
        sentence(files.per_view.err(), ["no per_view.json", ""]);
        sentence(files.log.err(), ["metrics.jsonl", "UTF-8"]);
        sentence(files.config.err(), ["config.toml", "no_such_key"]);
        assert!(files.config_text.is_ok());
    }
}
