//! The cells of a sweep as one job array of SLURM.
//!
//! SLURM queues, places, limits and repeats; this file only writes what it asks for. The ids stand in the script
//! itself, of which `sbatch` keeps a copy, and each cell has its order in a file of its own: a later submission does
//! not change what an array that still waits will run.

use std::path::Path;
use std::process::Command;

use anyhow::{Context, bail};

use super::folder::SweepFolder;
use super::index::{Cell, Index};
use crate::failure::UsageError;
use crate::{atomic, device, run};

/// Folder of the script and of what SLURM says.
const FOLDER: &str = "slurm";

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
        let asks_for_gpu = |option: &String| ["--gpu", "--gres", "-G"].iter().any(|start| option.starts_with(start));
        if device::wants_gpu(self.device)? && !self.options.iter().any(asks_for_gpu) {
            directives.push("--gres=gpu:1".to_owned());
        }
        directives.extend(self.options.iter().cloned());
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

    #[test]
    fn a_word_for_the_shell_keeps_its_quotes() {
        assert_eq!(quoted("it's $x"), r"'it'\''s $x'");
        assert_eq!(plain("my grid,\n2"), "my-grid--2");
    }
}
