//! Runs of seconds, by the program's own commands within this process.

use std::path::{Path, PathBuf};
use std::sync::OnceLock;

use anyhow::{Context, Result, anyhow, bail};
use clap::Parser;
use mvfusion_cli::args::Command;
use mvfusion_cli::progress::Verbosity;
use mvfusion_cli::{Cli, command};
use mvfusion_tests::SMALL_MODEL;
use tempfile::TempDir;

/// Settings of a run that passes through all stages in seconds.
const TINY: [&str; 3] =
    ["train.stages={geometry=3, deformation=2, refinement=3}", "train.log_interval=1", "eval.strips=2"];

/// Trains into the folder `run`, with further arguments, and returns what `mvfusion train` said.
pub fn train(run: &Path, more: &[&str]) -> Result<String> {
    mvfusion(&training(run, more)?)
}

/// The command line of such a training.
pub fn training<'a>(run: &'a Path, more: &[&'a str]) -> Result<Vec<&'a str>> {
    let settings = TINY.iter().chain(&SMALL_MODEL).flat_map(|setting| ["--set", setting]);
    let line = ["train", "--device", "cpu", "--out", text(run)?].into_iter().chain(settings);
    Ok(line.chain(more.iter().copied()).collect())
}

/// Carries out a command, and returns what it said.
pub fn mvfusion(arguments: &[&str]) -> Result<String> {
    let mut said = Vec::new();
    match Cli::try_parse_from(["mvfusion"].iter().chain(arguments))?.command {
        Command::Train(args) => command::train(&args, Verbosity::SILENT, &mut said)?,
        Command::Render(args) => command::render(&args, Verbosity::SILENT, &mut said)?,
        Command::LpipsWeights(args) => command::lpips_weights(&args, &mut said)?,
        Command::Export(args) => command::export(&args, Verbosity::SILENT, &mut said)?,
        Command::Prepare(args) => command::prepare(&args, Verbosity::SILENT, &mut said)?,
        other => bail!("no test runs {other:?}"),
    }
    Ok(String::from_utf8(said)?)
}

/// A path as an argument.
pub fn text(path: &Path) -> Result<&str> {
    path.to_str().context("a path that is text")
}

/// A run that several trials look at, trained by the first of them.
pub struct SharedRun(OnceLock<Result<TempDir, String>>);

impl SharedRun {
    /// A run that is not trained yet.
    pub const fn new() -> Self {
        Self(OnceLock::new())
    }

    /// The run's folder, once `train` has trained into it.
    ///
    /// # Errors
    /// If the training failed, for every trial.
    pub fn folder(&self, train: impl FnOnce(&Path) -> Result<String>) -> Result<PathBuf> {
        let trained = || -> Result<TempDir> {
            let folder = tempfile::tempdir()?;
            train(&folder.path().join("run"))?;
            Ok(folder)
        };
        // In a static, the folder is never dropped; the system cleans its folder of temporary files.
        let folder = self.0.get_or_init(|| trained().map_err(|error| format!("{error:#}")));
        Ok(folder.as_ref().map_err(|error| anyhow!("{error}"))?.path().join("run"))
    }
}
