//! Interruptions at chosen steps: a training in three processes ends as it does in one.

use std::fs;
use std::path::Path;
use std::process::{Command, Stdio};

use anyhow::{Context, Result};

use super::Tally;
use super::ground::{Outcome, SMALL, end, read_json, said, succeed};

/// 400 steps that densify every 20 and learn the static branch from two steps at once, with a checkpoint of each.
const SETTINGS: [&str; 8] = [
    "train.stages={geometry=120, deformation=130, refinement=150}",
    "train.checkpoint_interval=1",
    "train.keep_checkpoints=1000",
    "train.accumulation=2",
    "motion.interval=30",
    "densify={from=10, until=240, interval=20, prune_from=10, prune_interval=30, births_interval=50}",
    "densify.dynamic={geometry_threshold=1e-4, threshold=1e-4, max_gaussians=200}",
    // A checkpoint of each step takes room.
    "densify.static={geometry_threshold=1e-4, threshold=1e-4, max_gaussians=400}",
];

/// Steps after which the training is interrupted: within stages, at their changes (120, 250), after a densification (40,
/// 140), after a birth (170), between the two halves of a gradient (131 or 132, 271 or 272), before the last step.
pub const INTERRUPTIONS: [[usize; 2]; 8] =
    [[150, 250], [60, 185], [120, 250], [40, 140], [131, 132], [271, 272], [170, 300], [329, 399]];

/// Threads of the two processes that resume.
const THREADS: [[&str; 2]; 3] = [["1", "2"], ["1", "1"], ["2", "2"]];

/// Interrupts a training at the first `count` pairs of steps; with all, by all numbers of threads.
pub fn resume(program: &Path, count: usize) -> Result<Tally> {
    let folder = tempfile::tempdir().context("cannot make a folder")?;
    let whole = folder.path().join("whole");
    let settings = SETTINGS.into_iter().chain(SMALL).flat_map(|setting| ["--set", setting]);
    let mut command = Command::new(program);
    command.args(["train", "--quiet", "--out"]).arg(&whole).args(settings);
    succeed(command)?;
    let reference = Outcome::of(&whole)?;
    let threads = if count < INTERRUPTIONS.len() { &THREADS[..1] } else { &THREADS[..] };
    let mut tally = Tally::default();
    for steps in &INTERRUPTIONS[..count] {
        for threads in threads {
            let mut source = whole.clone();
            for (part, (&step, threads)) in steps.iter().zip(threads).enumerate() {
                let run = folder.path().join(format!("part-{part}"));
                interrupted_after(step, &source, &run)?;
                let mut command = Command::new(program);
                command.args(["train", "--quiet", "--threads", threads, "--resume"]).arg(&run);
                let output = end(command.stdout(Stdio::null()).stderr(Stdio::piped()).spawn()?)?;
                tally.done += 1;
                if Outcome::of(&run).ok().as_ref() != Some(&reference) {
                    tally.lost.push(format!("after {steps:?} by {threads} threads: {}", said(&output)));
                }
                source = run;
            }
        }
    }
    Ok(tally)
}

/// A copy of a finished run as it was after `step` steps.
fn interrupted_after(step: usize, run: &Path, copy: &Path) -> Result<()> {
    if copy.exists() {
        fs::remove_dir_all(copy)?;
    }
    fs::create_dir_all(copy.join("checkpoints"))?;
    for name in ["config.toml", "metrics.jsonl", &format!("checkpoints/step_{step}.safetensors")] {
        fs::copy(run.join(name), copy.join(name)).with_context(|| format!("cannot copy {name}"))?;
    }
    let mut record = read_json(&run.join("run.json"))?;
    if let Some(record) = record.as_object_mut() {
        record.remove("finished");
    }
    Ok(fs::write(copy.join("run.json"), serde_json::to_vec(&record)?)?)
}
