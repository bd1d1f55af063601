//! A few steps of a cell, to estimate its running time.

use std::collections::BTreeMap;
use std::path::Path;
use std::process::Stdio;

use anyhow::{Context, ensure};
use mvfusion_data::files::read_text;
use mvfusion_model::Config;
use mvfusion_model::train::Stage;
use serde::Deserialize;

use super::index::Cell;
use super::local::own_program;
use crate::run::{self, Results};
use crate::{atomic, config};

/// Steps of a probe. They cover each stage.
const STEPS: usize = 40;

/// The relevant values of a line of `metrics.jsonl`.
#[derive(Deserialize)]
struct Line {
    stage: String,
    elapsed: f64,
}

/// Estimated seconds of a cell, from a few of its steps on this machine.
///
/// # Errors
/// If the cell cannot be trained.
pub fn seconds(cell: &Cell, configuration: &Config, device: &str, threads: usize) -> anyhow::Result<f64> {
    let folder = tempfile::tempdir().context("cannot create a folder for the probe")?;
    let path = folder.path().join(run::CONFIG);
    let mut short = configuration.clone();
    short.train.scale *= STEPS as f64 / cell.steps.max(STEPS) as f64;
    // The adaptations for short runs do not belong in the probe of a full run.
    short.train.scale_times &= configuration.train.scale < 1.0;
    short.train.log_interval = 1;
    atomic::write(&path, config::to_toml(&short)?.as_bytes())?;
    let out = folder.path().join("run");
    let output = own_program()?
        .args(["train", "--quiet", "--preset", &cell.preset, "--device", device, "--threads", &threads.to_string()])
        .arg("--config")
        .arg(&path)
        .arg("--out")
        .arg(&out)
        .stdin(Stdio::null())
        .output()
        .context("cannot start the program for a probe")?;
    let said = String::from_utf8_lossy(&output.stderr);
    ensure!(output.status.success(), "the probe of a cell failed: {}", said.trim().trim_start_matches("error: "));
    let results: Results =
        serde_json::from_str(&read(&out.join(run::RESULTS))?).context("cannot read the probe's results")?;
    let paces = paces(&read(&out.join(run::METRICS))?)?;
    let stages = configuration.scaled().train.stages;
    // A stage that is too short for the probe counts as the slowest.
    let slowest = paces.values().copied().fold(0.0, f64::max);
    let pace = |stage: Stage| paces.get(stage.name()).copied().unwrap_or(slowest);
    let training: f64 = stages.lengths().into_iter().map(|(stage, steps)| pace(stage) * steps as f64).sum();
    Ok(training + results.eval.seconds)
}

fn read(path: &Path) -> anyhow::Result<String> {
    read_text(path, run::MOST_OF_RECORDS).with_context(|| format!("cannot read {}", path.display()))
}

/// Seconds of the median step of each stage. The first steps are slower: they compile kernels and decode images.
fn paces(log: &str) -> anyhow::Result<BTreeMap<String, f64>> {
    let mut steps: BTreeMap<String, Vec<f64>> = BTreeMap::new();
    let mut before = 0.0;
    for line in log.lines() {
        let Line { stage, elapsed } = serde_json::from_str(line).context("cannot read the probe's log")?;
        steps.entry(stage).or_default().push(elapsed - before);
        before = elapsed;
    }
    let median = |(stage, mut steps): (String, Vec<f64>)| {
        steps.sort_by(f64::total_cmp);
        let median = steps[steps.len() / 2];
        (stage, median)
    };
    Ok(steps.into_iter().map(median).collect())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_stage_goes_by_its_median_step() {
        let line = |stage: &str, elapsed: f64| format!("{{\"stage\":\"{stage}\",\"elapsed\":{elapsed}}}\n");
        let log = [("geometry", 9.0), ("geometry", 10.0), ("geometry", 11.0), ("refinement", 14.0)];
        let log: String = log.map(|(stage, elapsed)| line(stage, elapsed)).concat();
        let paces = paces(&log).expect("read");
        assert_eq!(paces, BTreeMap::from([("geometry".to_owned(), 1.0), ("refinement".to_owned(), 3.0)]));
    }
}
