//! `metrics.jsonl`: one line per log step.

use std::collections::BTreeMap;
use std::fs::File;
use std::io::Write;
use std::path::{Path, PathBuf};
use std::time::Duration;

use anyhow::Context;
use mvfusion_model::profile::{self, Part};
use serde::Serialize;

use super::results::GaussianCounts;

/// A log step.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct MetricsLine {
    /// Steps done in the whole run.
    pub step: usize,
    /// Name of the stage.
    pub stage: &'static str,
    /// Step within the stage, from 1.
    pub stage_step: usize,
    /// Loss of the step.
    pub loss: f32,
    /// PSNR of the composed renders of the batch in dB; absent if they are perfect.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub psnr: Option<f64>,
    /// Numbers of Gaussians.
    pub gaussians: GaussianCounts,
    /// Steps per second since the last line.
    pub steps_per_second: f64,
    /// Seconds of training so far.
    pub elapsed: f64,
    /// Milliseconds per step by part, since the last line. On a GPU, only the time of the calls.
    pub ms: BTreeMap<&'static str, f64>,
}

/// The times since the last call as milliseconds per step. Parts that took no time are left out.
pub fn milliseconds(steps: usize) -> BTreeMap<&'static str, f64> {
    let a_step = |time: Duration| 1000.0 * time.as_secs_f64() / steps.max(1) as f64;
    let times = Part::ALL.iter().zip(profile::take());
    times.filter(|(_, time)| !time.is_zero()).map(|(part, time)| (part.name(), a_step(time))).collect()
}

/// The file to which lines are appended.
#[derive(Debug)]
pub struct MetricsLog {
    file: File,
    path: PathBuf,
}

impl MetricsLog {
    /// A new, empty file.
    ///
    /// # Errors
    /// If it cannot be created.
    pub fn create(path: &Path) -> anyhow::Result<Self> {
        let file = File::create(path).with_context(|| format!("cannot write {}", path.display()))?;
        Ok(Self { file, path: path.to_owned() })
    }

    /// Appends a whole line, so that readers never see half of one.
    ///
    /// # Errors
    /// If it cannot be written.
    pub fn add(&mut self, line: &MetricsLine) -> anyhow::Result<()> {
        let mut attempt = || -> anyhow::Result<()> {
            let mut text = serde_json::to_string(line)?;
            text.push('\n');
            self.file.write_all(text.as_bytes())?;
            Ok(self.file.flush()?)
        };
        attempt().with_context(|| format!("cannot write {}", self.path.display()))
    }
}
