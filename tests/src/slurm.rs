//! A SLURM of one node that lives in a temporary folder, for tests of what submits jobs.
//!
//! Three daemons, all on the loopback interface, with a key, ports and files of their own: `munged` signs the messages,
//! `slurmctld` queues, `slurmd` starts the tasks. No installed service is used or disturbed.

mod files;

use std::env;
use std::ffi::OsStr;
use std::fs::{self, File};
use std::path::PathBuf;
use std::process::{Child, Command, Stdio};
use std::thread;
use std::time::{Duration, Instant};

use anyhow::{Context, Result, bail, ensure};
use tempfile::TempDir;

/// The programs that are needed here, and by what is tested.
const PROGRAMS: [&str; 9] =
    ["mungekey", "munged", "slurmctld", "slurmd", "sbatch", "scancel", "scontrol", "sinfo", "squeue"];

/// Debian's packages that have them.
const PACKAGES: &str = "slurm-wlm and munge";

/// Folders of daemons that the search path of a user may lack.
const DAEMON_FOLDERS: [&str; 2] = ["/usr/sbin", "/sbin"];

/// How the variables begin by which SLURM's commands take options, such as those of a job that runs the tests.
const VARIABLES: [&str; 5] = ["SLURM", "SBATCH_", "SQUEUE_", "SCANCEL_", "SINFO_"];

/// The variable that names the configuration.
const CONFIGURATION: &str = "SLURM_CONF";

/// How long the daemons may take to be ready, and to end.
const START: Duration = Duration::from_secs(60);
const FAREWELL: Duration = Duration::from_secs(10);

/// Time from one look to the next.
const PAUSE: Duration = Duration::from_millis(50);

/// Lines of each daemon's log that an error shows.
const TAIL: usize = 12;

/// A running SLURM, ended with all its jobs when dropped.
#[derive(Debug)]
pub struct Cluster {
    /// In the order of their start.
    daemons: Vec<(&'static str, Child)>,
    folder: TempDir,
}

impl Cluster {
    /// The reason why this machine cannot have one; `None` if it can.
    pub fn absent() -> Option<String> {
        if !cfg!(target_os = "linux") {
            return Some("SLURM's daemons need Linux".to_owned());
        }
        let missing: Vec<&str> = PROGRAMS.into_iter().filter(|program| find(program).is_none()).collect();
        if !missing.is_empty() {
            let missing = missing.join(", ");
            return Some(format!("no {missing} was found: install Debian's packages {PACKAGES}"));
        }
        // Anybody else's `slurmd` cannot start tasks.
        let user = Command::new("id").arg("-u").output();
        let is_root = user.is_ok_and(|output| output.stdout.trim_ascii() == b"0");
        (!is_root).then(|| "SLURM's daemons need root".to_owned())
    }

    /// Starts the daemons, and waits until the node takes jobs.
    ///
    /// # Errors
    /// If this machine cannot have one, or it is not ready in time; with the ends of the daemons' logs.
    pub fn start() -> Result<Self> {
        if let Some(reason) = Self::absent() {
            bail!(reason);
        }
        let mut cluster = Self { daemons: Vec::new(), folder: tempfile::tempdir()? };
        match cluster.bring_up() {
            Ok(()) => Ok(cluster),
            Err(error) => bail!("{error:#}\n{}", cluster.logs()),
        }
    }

    /// A command that speaks to this cluster and to no other.
    pub fn command(&self, program: impl AsRef<OsStr>) -> Command {
        let mut command = Command::new(program);
        for (name, _) in env::vars_os() {
            if VARIABLES.iter().any(|begin| name.as_encoded_bytes().starts_with(begin.as_bytes())) {
                command.env_remove(name);
            }
        }
        command.env(CONFIGURATION, self.path("slurm.conf"));
        command
    }

    /// Runs one of SLURM's commands, and returns what it prints.
    ///
    /// # Errors
    /// If it does not start, or fails; with what it says.
    pub fn ask(&self, program: &str, arguments: &[&str]) -> Result<String> {
        let path = find(program).with_context(|| format!("there is no {program}"))?;
        let output = self.command(path).args(arguments).stdin(Stdio::null()).output();
        let output = output.with_context(|| format!("cannot start {program}"))?;
        let said = String::from_utf8_lossy(&output.stderr);
        ensure!(output.status.success(), "{program} {arguments:?} fails: {}", said.trim());
        Ok(String::from_utf8(output.stdout)?)
    }

    /// The tasks of a job that wait, run or are ending, each as `JOB_TASK STATE`; none once all have ended.
    ///
    /// # Errors
    /// If `squeue` does not know the job.
    pub fn queue(&self, job: &str) -> Result<Vec<String>> {
        let lines = self.ask("squeue", &["--noheader", "--array", "--format=%i %T", &format!("--jobs={job}")])?;
        Ok(lines.lines().map(|line| line.trim().to_owned()).collect())
    }

    /// The numbers of all jobs that were ever submitted, one a task once it has started.
    ///
    /// # Errors
    /// If `squeue` fails.
    pub fn every_job(&self) -> Result<Vec<String>> {
        let lines = self.ask("squeue", &["--noheader", "--states=all", "--format=%A"])?;
        let mut jobs: Vec<String> = lines.lines().map(|line| line.trim().to_owned()).collect();
        jobs.sort();
        Ok(jobs)
    }

    /// The ends of the daemons' logs.
    pub fn logs(&self) -> String {
        let tail = |name: &str| {
            let text = fs::read_to_string(self.log(name)).unwrap_or_default();
            let lines: Vec<&str> = text.lines().collect();
            format!("{name} says:\n{}\n", lines[lines.len().saturating_sub(TAIL)..].join("\n"))
        };
        self.daemons.iter().map(|(name, _)| tail(name)).collect()
    }

    fn path(&self, name: &str) -> PathBuf {
        self.folder.path().join(name)
    }

    fn log(&self, daemon: &str) -> PathBuf {
        self.path(daemon).with_extension("log")
    }

    fn bring_up(&mut self) -> Result<()> {
        let key = self.path("munge.key");
        self.ask("mungekey", &["--create", &format!("--keyfile={}", key.display())])?;
        files::write(self.folder.path(), &self.ask("slurmd", &["-V"])?)?;
        let file = |option: &str, name: &str| format!("{option}={}", self.path(name).display());
        // The folder is closed to all others, of which munged complains: nobody else is to sign here.
        let options = [
            "--foreground".to_owned(),
            "--force".to_owned(),
            file("--key-file", "munge.key"),
            file("--socket", "munge.socket"),
            file("--pid-file", "munged.pid"),
            file("--seed-file", "munged.seed"),
        ];
        self.spawn("munged", &options)?;
        let socket = self.path("munge.socket");
        self.wait("the socket of munged", |_| socket.exists())?;
        self.spawn("slurmctld", &["-D".to_owned(), "-i".to_owned()])?;
        self.spawn("slurmd", &["-D".to_owned()])?;
        // A node that has not spoken yet is `unknown*`; one that differs from its configuration, `inval`.
        let is_idle = |cluster: &Self| {
            cluster.ask("sinfo", &["--noheader", "--format=%T"]).is_ok_and(|state| state.trim() == "idle")
        };
        self.wait("an idle node", is_idle)
    }

    /// Starts a daemon as a child that stays in the foreground.
    fn spawn(&mut self, name: &'static str, options: &[String]) -> Result<()> {
        let program = find(name).with_context(|| format!("there is no {name}"))?;
        let log = File::create(self.log(name))?;
        let mut command = self.command(program);
        command.args(options).stdin(Stdio::null()).stdout(log.try_clone()?).stderr(log);
        let child = command.spawn().with_context(|| format!("cannot start {name}"))?;
        self.daemons.push((name, child));
        Ok(())
    }

    /// Waits for something while all daemons live.
    fn wait(&mut self, what: &str, is_there: impl Fn(&Self) -> bool) -> Result<()> {
        let since = Instant::now();
        while !is_there(self) {
            for (name, child) in &mut self.daemons {
                if let Some(status) = child.try_wait()? {
                    bail!("{name} ended ({status}) before there was {what}");
                }
            }
            ensure!(since.elapsed() < START, "after {START:?} there is not yet {what}");
            thread::sleep(PAUSE);
        }
        Ok(())
    }
}

impl Drop for Cluster {
    fn drop(&mut self) {
        // Tasks would outlive the daemons. Where the cluster never came up there are none, and nobody to ask.
        if self.daemons.len() == 3 && self.ask("scancel", &["--user=root"]).is_ok() {
            let since = Instant::now();
            let has_tasks =
                |cluster: &Self| cluster.ask("squeue", &["--noheader"]).is_ok_and(|tasks| !tasks.is_empty());
            while has_tasks(self) && since.elapsed() < FAREWELL {
                thread::sleep(PAUSE);
            }
        }
        while let Some((_, mut child)) = self.daemons.pop() {
            end(&mut child);
        }
    }
}

/// Asks a daemon to end, and makes it if it does not.
fn end(child: &mut Child) {
    // Nobody has waited for it yet, so that its number is still its own. The shell has a `kill` of its own.
    let _ = Command::new("sh").args(["-c", r#"kill "$0""#, &child.id().to_string()]).stderr(Stdio::null()).status();
    let since = Instant::now();
    while matches!(child.try_wait(), Ok(None)) && since.elapsed() < FAREWELL {
        thread::sleep(PAUSE);
    }
    let _ = child.kill();
    let _ = child.wait();
}

/// Where a program lies.
fn find(program: &str) -> Option<PathBuf> {
    let folders = env::var_os("PATH").unwrap_or_default();
    let folders: Vec<PathBuf> = env::split_paths(&folders).chain(DAEMON_FOLDERS.map(PathBuf::from)).collect();
    folders.into_iter().map(|folder| folder.join(program)).find(|path| path.is_file())
}
