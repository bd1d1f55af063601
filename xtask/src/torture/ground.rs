//! A folder with trainings of seconds, and what can be asked of them.

use std::fs;
use std::path::{Path, PathBuf};
use std::process::{Child, Command, Output, Stdio};
use std::time::{Duration, Instant};

use anyhow::{Context, Result, bail, ensure};
use serde_json::Value;
use tempfile::TempDir;

/// A run of a second or two that passes through all stages.
const TINY: [&str; 2] = ["train.stages={geometry=20, deformation=20, refinement=60}", "train.log_interval=1"];

/// A small model, of which no pictures are written.
pub const SMALL: [&str; 8] = [
    "train.batch_size=1",
    "model.width=8",
    "model.grid={features=2, resolution=[4, 4, 4, 4], multipliers=[1]}",
    "init.dynamic_points=60",
    "init.motion_points=60",
    "motion.samples=4",
    "eval.strips=0",
    "eval.pictures=false",
];

/// The longest that anything may take.
const PATIENCE: Duration = Duration::from_secs(300);

/// What a run learned and what came of it: `params_sha256` and the metrics of the held-out views.
#[derive(Clone, Debug, PartialEq)]
pub struct Outcome {
    parameters: Value,
    test: Value,
}

/// The program, and a folder for its runs.
#[derive(Debug)]
pub struct Ground {
    program: PathBuf,
    folder: TempDir,
    /// The outcome of undisturbed runs with the seeds 1 and 2.
    pub reference: [Outcome; 2],
    /// How long such a run takes.
    pub duration: Duration,
}

impl Ground {
    /// A new folder. Trains the runs that others are compared with.
    pub fn new(program: &Path) -> Result<Self> {
        let folder = tempfile::tempdir().context("cannot make a folder")?;
        let started = Instant::now();
        let train = |seed: &str| {
            let run = folder.path().join(format!("reference-{seed}"));
            let mut command = Command::new(program);
            command.args(training(&run, seed)).current_dir(&folder);
            succeed(command)?;
            Outcome::of(&run)
        };
        let reference = [train("1")?, train("2")?];
        let duration = started.elapsed() / 2;
        Ok(Self { program: program.to_owned(), folder, reference, duration })
    }

    /// A folder for a run that does not exist.
    pub fn fresh(&self) -> Result<PathBuf> {
        let run = self.folder.path().join("run");
        if run.exists() {
            fs::remove_dir_all(&run)?;
        }
        Ok(run)
    }

    /// A command of the program, quiet.
    pub fn command(&self, arguments: &[String]) -> Command {
        let mut command = Command::new(&self.program);
        command.args(arguments).current_dir(&self.folder).stdout(Stdio::null()).stderr(Stdio::piped());
        command
    }

    /// Starts a training from its first step.
    pub fn begin(&self, run: &Path, seed: &str, more: &[&str]) -> Result<Child> {
        let more = more.iter().map(|&argument| argument.to_owned());
        Ok(self.command(&training(run, seed).into_iter().chain(more).collect::<Vec<_>>()).spawn()?)
    }

    /// Starts to go on with a training.
    pub fn resume(&self, run: &Path, more: &[&str]) -> Result<Child> {
        let run = run.display().to_string();
        let own = ["train", "--quiet", "--resume", &run].into_iter().chain(more.iter().copied());
        Ok(self.command(&own.map(str::to_owned).collect::<Vec<_>>()).spawn()?)
    }

    /// A finished run of seed 1 in a new folder.
    pub fn finished(&self) -> Result<PathBuf> {
        let run = self.fresh()?;
        succeed(self.command(&training(&run, "1")))?;
        Ok(run)
    }

    /// Runs a command on a run, which must succeed.
    pub fn ask(&self, command: &str, run: &Path, more: &[&str]) -> Result<()> {
        let run = run.display().to_string();
        let arguments = [command, &run].into_iter().chain(more.iter().copied()).map(str::to_owned);
        succeed(self.command(&arguments.collect::<Vec<_>>()))
    }
}

/// The arguments of a training.
fn training(run: &Path, seed: &str) -> Vec<String> {
    let run = run.display().to_string();
    let settings = TINY.into_iter().chain(SMALL).flat_map(|setting| ["--set", setting]);
    let own = ["train", "--quiet", "--out", &run, "--seed", seed];
    own.into_iter().chain(settings).map(str::to_owned).collect()
}

impl Outcome {
    /// The outcome of a finished run.
    pub fn of(run: &Path) -> Result<Self> {
        let results = read_json(&run.join("results.json"))?;
        let field = |name: &str| results.get(name).cloned().with_context(|| format!("results.json has no {name}"));
        let record = read_json(&run.join("run.json"))?;
        ensure!(record.get("finished").is_some(), "{} is not finished", run.display());
        Ok(Self { parameters: field("params_sha256")?, test: field("test")? })
    }
}

/// Reads a JSON file.
pub fn read_json(path: &Path) -> Result<Value> {
    let read = || Ok::<_, anyhow::Error>(serde_json::from_str(&fs::read_to_string(path)?)?);
    read().with_context(|| format!("cannot read {}", path.display()))
}

/// Steps that a run has logged.
pub fn logged(run: &Path) -> usize {
    fs::read_to_string(run.join("metrics.jsonl")).unwrap_or_default().matches('\n').count()
}

/// Whether a run has a checkpoint.
pub fn has_checkpoint(run: &Path) -> bool {
    let names = fs::read_dir(run.join("checkpoints")).into_iter().flatten().flatten().map(|entry| entry.file_name());
    names.filter_map(|name| name.into_string().ok()).any(|name| name.ends_with(".safetensors"))
}

/// Waits for the end of a child; an error after [`PATIENCE`].
pub fn end(mut child: Child) -> Result<Output> {
    let started = Instant::now();
    while child.try_wait()?.is_none() {
        if started.elapsed() > PATIENCE {
            child.kill()?;
            bail!("it did not end within {} s", PATIENCE.as_secs());
        }
        std::thread::sleep(Duration::from_millis(5));
    }
    Ok(child.wait_with_output()?)
}

/// What a child wrote to stderr.
pub fn said(output: &Output) -> String {
    String::from_utf8_lossy(&output.stderr).trim().to_owned()
}

/// Runs a command that must succeed.
pub fn succeed(mut command: Command) -> Result<()> {
    let output = end(command.stdout(Stdio::null()).stderr(Stdio::piped()).spawn()?)?;
    ensure!(output.status.success(), "{command:?} ended with {}: {}", output.status, said(&output));
    Ok(())
}

/// Sends a signal, such as `TERM`, to a child.
pub fn signal(child: &Child, name: &str) -> Result<()> {
    // The child may have ended by itself, so the result does not matter.
    Command::new("kill").args([&format!("-{name}"), &child.id().to_string()]).stderr(Stdio::null()).status()?;
    Ok(())
}
