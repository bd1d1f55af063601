//! The cells of a sweep as one job array of SLURM.
//!
//! SLURM queues, places, limits and repeats; this file only writes what it asks for. The ids stand in the script
//! itself, of which `sbatch` keeps a copy, and each cell has its order in a file of its own: a later submission does
//! not change which cells an array that still waits will run, nor how they train.

use std::path::Path;
use std::process::Command;
use std::time::Duration;

use anyhow::{Context, bail};

use super::folder::{State, SweepFolder};
use super::index::{Cell, Index};
use crate::failure::UsageError;
use crate::{atomic, device, run};

/// Folder of the script and of what SLURM says.
const FOLDER: &str = "slurm";

/// What a value of `--gres` or `--tres-per-...` holds that decides about GPUs: a whole one, a share of one, nothing.
const GPU_WORDS: [&str; 4] = ["gpu", "mps", "shard", "none"];

/// Pause before cells that other tasks work on are looked at again; each look asks the file system of all nodes.
const PAUSE: Duration = Duration::from_secs(2);

/// How cells are handed to SLURM.
#[derive(Clone, Debug)]
pub struct Slurm<'a> {
    /// The sweep's folder, which all nodes share.
    pub folder: &'a SweepFolder,
    /// The sweep.
    pub index: &'a Index,
    /// `--device` of each cell.
    pub device: &'a str,
    /// Cells at the same time; as many as SLURM likes if absent.
    pub jobs: Option<usize>,
    /// CPUs, and threads, of each.
    pub threads: usize,
    /// Further options of sbatch, such as `--partition=gpu`.
    pub options: &'a [String],
}

impl Slurm<'_> {
    /// The batch script of an array of cells.
    ///
    /// # Errors
    /// [`UsageError`] for a device or an option that is none; if this program or the folder has a name that is no text.
    pub fn script(&self, cells: &[&Cell]) -> anyhow::Result<String> {
        let program = std::env::current_exe()?;
        let (program, folder, logs) = (text(&program)?, text(self.folder.path())?, self.folder.cells());
        let directives: String =
            self.directives(cells.len())?.iter().map(|directive| format!("#SBATCH {directive}\n")).collect();
        let ids: String = cells.iter().map(|cell| format!(" \\\n    {}", cell.id)).collect();
        let (program, folder, logs) = (quoted(program), quoted(folder), quoted(text(&logs)?));
        let (device, threads) = (quoted(self.device), self.threads);
        Ok(format!(
            "#!/bin/sh\n\
             {directives}\
             # The cells, a line each; the task's number picks one.\n\
             set --{ids}\n\
             shift \"$SLURM_ARRAY_TASK_ID\"\n\
             exec >>{logs}/\"$1\".log 2>&1\n\
             exec {program} sweep run-cell --out {folder} --cell \"$1\" --device {device} --threads {threads}\n"
        ))
    }

    /// What is asked of SLURM for each of so many tasks.
    fn directives(&self, count: usize) -> anyhow::Result<Vec<String>> {
        if let Some(option) = self.options.iter().find(|option| !option.starts_with('-') || option.contains('\n')) {
            let advice = "write --sbatch=--KEY=VALUE";
            return Err(UsageError::new(format!("`--sbatch {option}` is no option of sbatch; {advice}.")).into());
        }
        let limit = self.jobs.map_or(String::new(), |jobs| format!("%{jobs}"));
        let folder = text(self.folder.path())?.replace('%', "%%");
        let mut directives = vec![
            format!("--job-name=mvfusion-{}", plain(&self.index.name)),
            format!("--array=0-{}{limit}", count.saturating_sub(1)),
            format!("--output=\"{folder}/{FOLDER}/%A_%a.log\""),
            format!("--cpus-per-task={}", self.threads),
            // A task that SLURM stops for another's sake, or whose node fails, starts again.
            "--requeue".to_owned(),
            "--open-mode=append".to_owned(),
        ];
        match device::wants_gpu(self.device)? {
            true => directives.extend(with_gpu(self.options)),
            false => directives.extend(self.options.iter().cloned()),
        }
        Ok(directives)
    }

    /// Writes the script and submits it; returns the job's number. With `wait`, after the last task has ended.
    ///
    /// # Errors
    /// If there is no `sbatch`, or it refuses.
    pub fn submit(&self, cells: &[&Cell], wait: bool) -> anyhow::Result<String> {
        let path = run::place(self.folder.path(), &[FOLDER, "array.sh"])?;
        atomic::write(&path, self.script(cells)?.as_bytes())?;
        let mut sbatch = Command::new("sbatch");
        sbatch.arg("--parsable").args(wait.then_some("--wait")).arg(&path);
        let output = sbatch.output().with_context(|| {
            format!("cannot start sbatch; --launcher slurm needs SLURM's commands. The script is {}", path.display())
        })?;
        let said = |bytes: &[u8]| String::from_utf8_lossy(bytes).trim().to_owned();
        // `--parsable` prints the number, and on some clusters a semicolon and the cluster's name.
        let number = said(&output.stdout).split(';').next().unwrap_or_default().to_owned();
        // With --wait the exit code is that of the tasks, which the caller looks at himself.
        if number.is_empty() || !(output.status.success() || wait) {
            bail!("sbatch refuses {}: {}", path.display(), said(&output.stderr));
        }
        Ok(number)
    }

    /// Waits until no process works on any of these cells: an array can end before a task of an earlier one does.
    ///
    /// # Errors
    /// If the folder cannot be used any more.
    pub fn wait_for(&self, cells: &[&Cell]) -> anyhow::Result<()> {
        // All of them anew each time: while one is waited for, an earlier array may have begun another.
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
    // Of several `--gres` SLURM takes the last alone.
    let others = |(place, option): (usize, &String)| Some((place, resources(option)?.to_owned()));
    let last = options.iter().enumerate().rev().find_map(others);
    match last {
        Some((place, others)) => options[place] = format!("--gres=gpu:1,{others}"),
        None => options.insert(0, "--gres=gpu:1".to_owned()),
    }
    options
}

/// Whether an option says how many GPUs a task has. A partition may be called `gpu`, and promises none.
fn decides_about_gpus(option: &str) -> bool {
    let (name, value) = option.split_once(['=', ' ']).unwrap_or((option, ""));
    let value = value.to_ascii_lowercase();
    let lists_resources = name == "--gres" || name.starts_with("--tres-per-");
    let is_of_gpus = name.starts_with("--gpus") || name.starts_with("-G");
    is_of_gpus || (lists_resources && GPU_WORDS.iter().any(|word| value.contains(word)))
}

/// The value of `--gres`, if an option is that.
fn resources(option: &str) -> Option<&str> {
    option.strip_prefix("--gres")?.strip_prefix(['=', ' ']).map(str::trim)
}

fn text(path: &Path) -> anyhow::Result<&str> {
    path.to_str().with_context(|| format!("{} is not valid UTF-8; rename it", path.display()))
}

/// A name that SLURM takes as one word.
fn plain(name: &str) -> String {
    name.chars()
        .map(|letter| if letter.is_ascii_alphanumeric() || "-_.".contains(letter) { letter } else { '-' })
        .collect()
}

/// A word for the shell.
fn quoted(word: &str) -> String {
    format!("'{}'", word.replace('\'', r"'\''"))
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
        assert_eq!(quoted("it's $x"), r"'it'\''s $x'");
        assert_eq!(plain("my grid,\n2"), "my-grid--2");
    }
}
