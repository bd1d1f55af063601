//! A tiny sweep with a cluster to run it, and what can be asked of both.

use std::collections::BTreeMap;
use std::env;
use std::fs;
use std::path::{Path, PathBuf};
use std::process::{Command, Output};
use std::thread;
use std::time::{Duration, Instant};

use anyhow::{Context, Result, bail, ensure};
use mvfusion_tests::Cluster;
use serde_json::Value;
use tempfile::TempDir;

/// A sweep that is small enough for a test.
#[derive(Clone, Copy, Debug)]
pub struct Sweep {
    seeds: &'static str,
    stages: &'static str,
    /// The settings of the variant `long`.
    long: &'static str,
    /// Cells at a time.
    jobs: &'static str,
    /// Its number of cells: two variants, and the seeds.
    pub cells: usize,
}

/// Two cells of seconds and two that last long enough to be caught at work; the first is one of these.
pub const UNEQUAL: Sweep = Sweep {
    seeds: "[1, 2]",
    stages: "{ geometry = 2, deformation = 2, refinement = 2 }",
    long: "{ train.stages.geometry = 150 }",
    jobs: "2",
    cells: 4,
};

/// Six cells that last long enough to be caught at work twice.
pub const LONG: Sweep = Sweep {
    seeds: "[1, 2, 3]",
    stages: "{ geometry = 20, deformation = 20, refinement = 60 }",
    long: "{}",
    jobs: "6",
    cells: 6,
};

impl Sweep {
    /// The grid.
    fn toml(self) -> String {
        let Self { seeds, stages, long, .. } = self;
        format!(
            r#"
title = "Tiny"
preset = "quickstart"
seeds = {seeds}

[set]
train.stages = {stages}
train.log_interval = 2
train.batch_size = 1
model.width = 8
model.grid = {{ features = 2, resolution = [4, 4, 4, 4], multipliers = [1] }}
init.dynamic_points = 60
init.motion_points = 60
init.photo_points = 60
motion.samples = 4
eval.strips = 0
eval.pictures = false

[[scenes]]
name = "video"

[[variants]]
name = "long"
set = {long}

[[variants]]
name = "w/o MFTA"
set = {{ motion.mfta = false }}
"#
        )
    }
}

/// What the program says before a job's number.
const JOB: &str = "job ";

/// How long anything may take, as a duration and as `timeout` wants it.
const PATIENCE: Duration = Duration::from_secs(300);
const PATIENCE_SECONDS: &str = "300";

/// Time from one look to the next.
const PAUSE: Duration = Duration::from_millis(100);

/// A cluster, and a folder with the grid.
pub struct Ground {
    /// The cluster.
    pub cluster: Cluster,
    sweep: Sweep,
    folder: TempDir,
}

impl Ground {
    /// Starts the cluster.
    pub fn new(sweep: Sweep) -> Result<Self> {
        let folder = tempfile::tempdir()?;
        fs::write(folder.path().join("tiny.toml"), sweep.toml())?;
        Ok(Self { cluster: Cluster::start()?, sweep, folder })
    }

    /// A file in the folder.
    pub fn path(&self, name: &str) -> PathBuf {
        self.folder.path().join(name)
    }

    /// Runs the program; one that hangs is ended.
    pub fn mvfusion(&self, arguments: &[&str]) -> Result<Output> {
        let mut command: Command = self.cluster.command("timeout");
        command.arg(PATIENCE_SECONDS).arg(program()?).args(arguments).current_dir(self.folder.path());
        // Mesa's OpenGL complains of the folder's absence.
        command.env_remove("RUST_LOG").env("XDG_RUNTIME_DIR", self.folder.path());
        Ok(command.output()?)
    }

    /// Submits the sweep; a device among the further arguments takes the place of the CPU.
    pub fn sweep(&self, more: &[&str]) -> Result<Output> {
        let Sweep { jobs, .. } = self.sweep;
        let usual = ["sweep", "tiny.toml", "--out", "out", "--launcher", "slurm", "--jobs", jobs, "--threads", "1"];
        let device: &[&str] = if more.contains(&"--device") { &[] } else { &["--device", "cpu"] };
        let output = self.mvfusion(&[&usual, device, more].concat())?;
        said(&output)?;
        Ok(output)
    }

    /// The cells in their order.
    pub fn ids(&self) -> Result<Vec<String>> {
        let index = json(&self.path("out/sweep.json"))?;
        let cells = index["cells"].as_array().context("sweep.json has no cells")?;
        let ids: Vec<String> = cells.iter().filter_map(|cell| Some(cell["id"].as_str()?.to_owned())).collect();
        ensure!(ids.len() == self.sweep.cells, "the sweep has {} cells", ids.len());
        Ok(ids)
    }

    /// The cells that the last script runs, in its order.
    pub fn submitted(&self) -> Result<Vec<String>> {
        let (ids, script) = (self.ids()?, fs::read_to_string(self.path("out/slurm/array.sh"))?);
        let words = script.split_whitespace().filter(|word| ids.iter().any(|id| id == word));
        Ok(words.map(str::to_owned).collect())
    }

    /// A file of each cell's run in a sweep's folder, as JSON; `Null` where there is none that can be read.
    pub fn of_each_cell(&self, sweep: &str, name: &str) -> Result<Vec<Value>> {
        let cells = self.path(sweep).join("cells");
        Ok(self.ids()?.into_iter().map(|id| json(&cells.join(id).join(name)).unwrap_or_default()).collect())
    }

    /// The lines that each cell has logged.
    pub fn logged(&self) -> Result<Vec<usize>> {
        let log = |id: String| self.path("out/cells").join(id).join("metrics.jsonl");
        let lines = |log: PathBuf| fs::read_to_string(log).unwrap_or_default().lines().count();
        Ok(self.ids()?.into_iter().map(log).map(lines).collect())
    }

    /// The state of each cell in the program's words, which stand before the cell's id.
    pub fn states(&self) -> Result<BTreeMap<String, String>> {
        let said = said(&self.mvfusion(&["sweep", "status", "out"])?)?;
        let state = |id: String| {
            let state = said.lines().find_map(|line| line.split_once(&id)).map(|(state, _)| state.trim().to_owned());
            Ok((id.clone(), state.with_context(|| format!("no state of {id}: {said}"))?))
        };
        self.ids()?.into_iter().map(state).collect()
    }

    /// When each cell that has finished was begun.
    pub fn finished(&self) -> Result<BTreeMap<String, String>> {
        let began = |id: String| {
            let record = json(&self.path("out/cells").join(&id).join("run.json")).ok()?;
            record.get("finished")?.as_str()?;
            Some((id, record["started"].as_str()?.to_owned()))
        };
        Ok(self.ids()?.into_iter().filter_map(began).collect())
    }

    /// Waits for something, not for ever.
    pub fn wait(&self, what: &str, is_there: impl Fn() -> Result<bool>) -> Result<()> {
        let since = Instant::now();
        while !is_there()? {
            ensure!(since.elapsed() < PATIENCE, "after {PATIENCE:?} there is not yet {what}");
            thread::sleep(PAUSE);
        }
        Ok(())
    }

    /// What there is to know after a failure.
    pub fn story(&self) -> String {
        let queue = self.cluster.ask("squeue", &["--states=all", "--array"]).unwrap_or_else(|error| error.to_string());
        let entries = fs::read_dir(self.path("out/slurm")).into_iter().flatten().flatten().map(|entry| entry.path());
        let logs = entries.filter(|path| path.extension().is_some_and(|extension| extension == "log"));
        let log = |path: PathBuf| format!("{}:\n{}\n", path.display(), fs::read_to_string(&path).unwrap_or_default());
        format!("{queue}\n{}{}", logs.map(log).collect::<String>(), self.cluster.logs())
    }
}

/// Where the build leaves the program: a test lies in a folder beside it.
pub fn program() -> Result<PathBuf> {
    let test = env::current_exe()?;
    let folder = test.parent().and_then(Path::parent).context("the test lies in a folder")?;
    Ok(folder.join(format!("mvfusion{}", env::consts::EXE_SUFFIX)))
}

/// What the program printed; an error with its words if it failed.
pub fn said(output: &Output) -> Result<String> {
    if !output.status.success() {
        bail!("mvfusion fails ({}): {}", output.status, String::from_utf8_lossy(&output.stderr));
    }
    Ok(String::from_utf8(output.stdout.clone())?)
}

/// The number of the job that the program says.
pub fn job(output: &Output) -> Result<String> {
    let said = said(output)?;
    let after = said.lines().find_map(|line| line.strip_prefix(JOB)).with_context(|| format!("no job: {said}"))?;
    let number: String = after.chars().take_while(char::is_ascii_digit).collect();
    ensure!(!number.is_empty(), "no number of a job: {said}");
    Ok(number)
}

fn json(path: &Path) -> Result<Value> {
    let text = fs::read_to_string(path).with_context(|| format!("cannot read {}", path.display()))?;
    Ok(serde_json::from_str(&text)?)
}
