//! `metrics.jsonl`: one line per log step.

use std::collections::BTreeMap;
use std::fs::File;
use std::io::{self, Write};
use std::path::{Path, PathBuf};
use std::time::Duration;

use anyhow::Context;
use mvfusion_data::files::read_text;
use mvfusion_model::profile::{self, Part};
use serde::{Deserialize, Serialize};

use super::files::MOST_OF_RECORDS;
use super::results::{GaussianCounts, is_zero};
use crate::atomic;

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
    /// Steps of the run so far that changed nothing, because a number was not finite; absent if there are none.
    #[serde(skip_serializing_if = "is_zero")]
    pub skipped: usize,
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

    /// The file of an interrupted run, without the lines after `step`: these steps will be done again. Returns the
    /// seconds of training up to the last line that stays, too.
    ///
    /// # Errors
    /// If it cannot be read or written.
    pub fn resume(path: &Path, step: usize) -> anyhow::Result<(Self, f64)> {
        /// What a line says of its place in the run.
        #[derive(Deserialize)]
        struct Place {
            step: usize,
            elapsed: f64,
        }
        let text = match read_text(path, MOST_OF_RECORDS) {
            Err(error) if error.kind() == io::ErrorKind::NotFound => String::new(),
            text => text.with_context(|| format!("cannot read {}", path.display()))?,
        };
        let (mut kept, mut elapsed) = (String::new(), 0.0);
        for line in text.lines() {
            // A line that was cut off was the last one.
            let Ok(place) = serde_json::from_str::<Place>(line) else { break };
            if place.step > step {
                break;
            }
            kept += line;
            kept.push('\n');
            elapsed = place.elapsed;
        }
        atomic::write(path, kept.as_bytes())?;
        let file = File::options().append(true).open(path);
        let file = file.with_context(|| format!("cannot write {}", path.display()))?;
        Ok((Self { file, path: path.to_owned() }, elapsed))
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

#[cfg(test)]
mod tests {
    use std::fs;

    use super::*;

    #[test]
    fn lines_after_the_checkpoint_and_half_lines_go() {
        let folder = tempfile::tempdir().expect("folder");
        let path = folder.path().join("metrics.jsonl");
        let line = |step: usize| format!("{{\"step\":{step},\"elapsed\":{}.5}}\n", step * 2);
        fs::write(&path, [line(10), line(20), line(30), "{\"step\":40,".to_owned()].concat()).expect("written");
        let (_, elapsed) = MetricsLog::resume(&path, 25).expect("resumed");
        assert_eq!((fs::read_to_string(&path).expect("read"), elapsed), ([line(10), line(20)].concat(), 40.5));
        let (_, elapsed) = MetricsLog::resume(&folder.path().join("none.jsonl"), 25).expect("a new file");
        assert_eq!(elapsed, 0.0);
    }
}
