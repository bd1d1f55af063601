//! The cells of a sweep as one job array of SLURM.
//!
//! SLURM handles queueing, placement, limits and restarts; this module only writes the request. The ids are in the
//! script itself, of which `sbatch` keeps a copy, and each cell has its task in a separate file. A later submission
//! therefore changes neither the cells of an array that is still waiting, nor their training.

use std::path::Path;
use std::process::Command;
use std::time::Duration;

use anyhow::{Context, bail};

use super::folder::{State, SweepFolder};
use super::index::{Cell, Index};
use crate::failure::UsageError;
use crate::interrupt::for_shell;
use crate::{atomic, device, run};

/// Folder of the script and of SLURM's output.
const FOLDER: &str = "slurm";

/// Words in a value of `--gres` or `--tres-per-...` that decide about GPUs: a whole GPU, a share of one, or none.
const GPU_WORDS: [&str; 4] = ["gpu", "mps", "shard", "none"];

/// Time between two checks of cells that run in other tasks. Each check accesses the shared file system.
const PAUSE: Duration = Duration::from_secs(2);

/// How cells are submitted to SLURM.
#[derive(Clone, Debug)]
pub struct Slurm<'a> {
    /// The sweep folder, which all nodes share.
    pub folder: &'a SweepFolder,
    /// The sweep.
    pub index: &'a Index,
    /// `--device` of each cell.
    pub device: &'a str,
    /// Maximum number of cells at the same time; no limit if absent.
    pub jobs: Option<usize>,
    /// CPUs, and threads, of each cell.
    pub threads: usize,
    /// Further options of sbatch, such as `--partition=gpu`.
    pub options: &'a [String],
}

impl Slurm<'_> {
    /// The batch script of an array of cells.
    ///
    /// # Errors
    /// [`UsageError`] for an unknown device or an invalid option. If the path of this program or of the folder is not
    /// valid UTF-8.
    pub fn script(&self, cells: &[&Cell]) -> anyhow::Result<String> {
        let program = std::env::current_exe()?;
        let (program, folder, logs) = (text(&program)?, text(self.folder.path())?, self.folder.cells());
        let directives: String =
            self.directives(cells.len())?.iter().map(|directive| format!("#SBATCH {directive}\n")).collect();
        let ids: String = cells.iter().map(|cell| format!(" \\\n    {}", cell.id)).collect();
        let (program, folder, logs) = (for_shell(program), for_shell(folder), for_shell(text(&logs)?));
        let (device, threads) = (for_shell(self.device), self.threads);
        Ok(format!(
            "#!/bin/sh\n\
             {directives}\
             # The cells, one per line; the task id selects one.\n\
             set --{ids}\n\
             shift \"$SLURM_ARRAY_TASK_ID\"\n\
             exec >>{logs}/\"$1\".log 2>&1\n\
             exec {program} sweep run-cell --out {folder} --cell \"$1\" --device {device} --threads {threads}\n"
        ))
    }

    /// The directives for an array with this number of tasks.
    fn directives(&self, count: usize) -> anyhow::Result<Vec<String>> {
        if let Some(option) = self.options.iter().find(|option| !option.starts_with('-') || option.contains('\n')) {
            let advice = "write --sbatch=--KEY=VALUE";
            return Err(UsageError::new(format!("`--sbatch {option}` is not an option of sbatch; {advice}.")).into());
        }
        let limit = self.jobs.map_or(String::new(), |jobs| format!("%{jobs}"));
        let folder = text(self.folder.path())?.replace('%', "%%");
        let mut directives = vec![
            format!("--job-name=mvfusion-{}", plain(&self.index.name)),
            format!("--array=0-{}{limit}", count.saturating_sub(1)),
            format!("--output=\"{folder}/{FOLDER}/%A_%a.log\""),
            format!("--cpus-per-task={}", self.threads),
            // A task that SLURM preempts, or whose node fails, starts again.
            "--requeue".to_owned(),
            "--open-mode=append".to_owned(),
            // At its time limit, a task has a minute to save a checkpoint.
            "--signal=B:TERM@60".to_owned(),
        ];
        match device::wants_gpu(self.device)? {
            true => directives.extend(with_gpu(self.options)),
            false => directives.extend(self.options.iter().cloned()),
        }
        Ok(directives)
    }

    /// Writes and submits the script. Returns the job id, with `wait` only after the last task has ended.
    ///
    /// # Errors
    /// If `sbatch` is missing, or rejects the script.
    pub fn submit(&self, cells: &[&Cell], wait: bool) -> anyhow::Result<String> {
        let path = run::place(self.folder.path(), &[FOLDER, "array.sh"])?;
        atomic::write(&path, self.script(cells)?.as_bytes())?;
        let mut sbatch = Command::new("sbatch");
        sbatch.arg("--parsable").args(wait.then_some("--wait")).arg(&path);
        let output = sbatch.output().with_context(|| {
            format!("cannot start sbatch; --launcher slurm needs SLURM's commands. The script is {}", path.display())
        })?;
        let said = |bytes: &[u8]| String::from_utf8_lossy(bytes).trim().to_owned();
        // `--parsable` prints the job id, and on some clusters a semicolon and the name of the cluster.
        let number = said(&output.stdout).split(';').next().unwrap_or_default().to_owned();
        // With --wait, the exit code is that of the tasks, which the caller checks itself.
        if number.is_empty() || !(output.status.success() || wait) {
            bail!("sbatch rejected {}: {}", path.display(), said(&output.stderr));
        }
        Ok(number)
    }

    /// Waits until none of these cells is running. A task of an earlier array may outlast the new array.
    ///
    /// # Errors
    /// If the folder can no longer be used.
    pub fn wait_for(&self, cells: &[&Cell]) -> anyhow::Result<()> {
        // Checks all of them each time, because an earlier array may have started another cell in the meantime.
        let is_at_work = |cell: &&Cell| Ok(self.folder.state(&cell.id, &self.index.wanted)? == State::Running);
        while cells.iter().map(is_at_work).collect::<anyhow::Result<Vec<bool>>>()?.contains(&true) {
            std::thread::sleep(PAUSE);
        }
        Ok(())
    }
}

/// Options of sbatch with a request for a GPU, unless they decide about GPUs themselves.
fn with_gpu(options: &[String]) -> Vec<String> {
    let mut options = options.to_vec();
    if options.iter().any(|option| decides_about_gpus(option)) {
        return options;
    }
    // SLURM uses only the last of several `--gres`.
    let others = |(place, option): (usize, &String)| Some((place, resources(option)?.to_owned()));
    let last = options.iter().enumerate().rev().find_map(others);
    match last {
        Some((place, others)) => options[place] = format!("--gres=gpu:1,{others}"),
        None => options.insert(0, "--gres=gpu:1".to_owned()),
    }
    options
}

/// Whether an option decides how many GPUs a task has. A partition named `gpu` does not.
fn decides_about_gpus(option: &str) -> bool {
    let (name, value) = option.split_once(['=', ' ']).unwrap_or((option, ""));
    let value = value.to_ascii_lowercase();
    let lists_resources = name == "--gres" || name.starts_with("--tres-per-");
    let is_of_gpus = name.starts_with("--gpus") || name.starts_with("-G");
    is_of_gpus || (lists_resources && GPU_WORDS.iter().any(|word| value.contains(word)))
}

/// The value of `--gres`, if the option is one.
fn resources(option: &str) -> Option<&str> {
    option.strip_prefix("--gres")?.strip_prefix(['=', ' ']).map(str::trim)
}

fn text(path: &Path) -> anyhow::Result<&str> {
    path.to_str().with_context(|| format!("{} is not valid UTF-8; rename it", path.display()))
}

/// A name that SLURM reads as one word.
fn plain(name: &str) -> String {
    name.chars()
        .map(|letter| if letter.is_ascii_alphanumeric() || "-_.".contains(letter) { letter } else { '-' })
        .collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    /// What SLURM is asked for by options that are given and a device that needs a GPU.
    fn asked(options: &[&str]) -> Vec<String> {
        with_gpu(&options.iter().map(|&option| option.to_owned()).collect::<Vec<_>>())
    }

    #[test]
    fn a_gpu_is_asked_for_unless_an_option_decides_about_gpus() {
        for option in [
            "--gres=gpu:a100:2",
            "--gres gpu:1",
            "--gres=lscratch:10,GPU:1",
            "--gres=shard:4",
            "--gres=none",
            "--gpus=1",
            "--gpus-per-node=1",
            "--tres-per-task=gres/gpu:1",
            "--tres-per-job=gres/GPU=1",
            "-G1",
            "-G 2",
            "-G=2",
        ] {
            assert_eq!(asked(&[option, "--time=10"]), [option, "--time=10"]);
        }
        for option in
            ["--partition=gpu", "-p gpu", "--cpus-per-gpu=4", "--gpu-bind=closest", "--tres-per-task=cpu=8", "--time=1"]
        {
            assert_eq!(asked(&[option]), ["--gres=gpu:1", option]);
        }
        assert_eq!(asked(&[]), ["--gres=gpu:1"]);
    }

    #[test]
    fn other_resources_are_asked_for_together_with_the_gpu() {
        assert_eq!(asked(&["--gres=lscratch:10", "--time=1"]), ["--gres=gpu:1,lscratch:10", "--time=1"]);
        assert_eq!(asked(&["--gres lscratch:10"]), ["--gres=gpu:1,lscratch:10"]);
        assert_eq!(asked(&["--gres=a:1", "--gres=b:2"]), ["--gres=a:1", "--gres=gpu:1,b:2"]);
        // Of flags for binding nothing is to be added.
        assert_eq!(asked(&["--gres-flags=enforce-binding"]), ["--gres=gpu:1", "--gres-flags=enforce-binding"]);
    }

    #[test]
    fn a_word_for_the_shell_keeps_its_quotes() {
        assert_eq!(for_shell("it's $x"), r#""it's "'$x'"#);
        assert_eq!(plain("my grid,\n2"), "my-grid--2");
    }
}
