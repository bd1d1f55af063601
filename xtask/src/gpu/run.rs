//! The list, run where the GPU is.

use std::fmt::Write;
use std::fs::{self, File};
use std::path::{Path, PathBuf};
use std::process::{Child, Command, Stdio};
use std::thread;
use std::time::{Duration, Instant};

use anyhow::{Context, Result};
use clap::Args;
use serde::Serialize;
use serde_json::Value;

use super::list::{Entry, Program, list};

/// Time from one look at a process to the next.
const PAUSE: Duration = Duration::from_millis(50);

/// The last lines of an answer that the table quotes.
const LAST_LINES: usize = 12;

/// Where and how to run.
#[derive(Debug, Args)]
pub struct RunArguments {
    /// Folder with the programs [default: that of this program]
    #[arg(long)]
    programs: Option<PathBuf>,
    /// Folder of the results.
    #[arg(long, default_value = "results")]
    out: PathBuf,
    /// The device, as `mvfusion devices` names it.
    #[arg(long, default_value = "wgpu:0")]
    device: String,
    /// Small sizes, for a software driver.
    #[arg(long)]
    rehearse: bool,
    /// Only the entries with these names.
    #[arg(long, value_delimiter = ',')]
    only: Vec<String>,
    /// End after so many minutes, with what there is.
    #[arg(long, default_value_t = 30)]
    minutes: u64,
}

/// What came of an entry.
#[derive(Debug, Serialize)]
struct Answer {
    name: &'static str,
    command: String,
    /// What would pass, in words.
    passes: &'static str,
    outcome: Outcome,
    seconds: f64,
    /// The last lines that were said.
    said: Vec<String>,
    /// The figures that the program wrote as JSON.
    #[serde(skip_serializing_if = "Value::is_null")]
    figures: Value,
}

/// How a program ended.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
#[serde(rename_all = "snake_case")]
enum Outcome {
    Passed,
    Failed,
    /// It ran past its time and was ended.
    TimedOut,
    /// It is not on this machine.
    Missing,
    /// There was no time for it.
    NotRun,
}

impl Outcome {
    fn word(self) -> &'static str {
        match self {
            Self::Passed => "passed",
            Self::Failed => "**failed**",
            Self::TimedOut => "**timed out**",
            Self::Missing => "not on this machine",
            Self::NotRun => "no time left",
        }
    }
}

/// Runs the list. Failures are results, not errors of this chore.
pub(super) fn run(arguments: &RunArguments) -> Result<()> {
    let programs = match &arguments.programs {
        Some(folder) => folder.clone(),
        None => std::env::current_exe()?.parent().context("this program lies in a folder")?.to_owned(),
    };
    let programs = fs::canonicalize(&programs).with_context(|| format!("there is no folder {}", programs.display()))?;
    fs::create_dir_all(&arguments.out).with_context(|| format!("cannot make {}", arguments.out.display()))?;
    let until = Instant::now() + Duration::from_secs(60 * arguments.minutes);
    let entries = list(&arguments.device, arguments.rehearse);
    let wanted = |entry: &Entry| arguments.only.is_empty() || arguments.only.iter().any(|name| name == entry.name);
    let mut answers = Vec::new();
    for entry in entries.into_iter().filter(wanted) {
        eprintln!("== {}", entry.name);
        answers.push(answer(&entry, &programs, &arguments.out, until)?);
        write(&arguments.out, &arguments.device, &answers)?;
    }
    Ok(())
}

/// Runs an entry within the folder of the results.
fn answer(entry: &Entry, programs: &Path, out: &Path, until: Instant) -> Result<Answer> {
    let program = match entry.program {
        Program::Mvfusion => programs.join("mvfusion"),
        Program::Oracles => programs.join("oracles"),
        Program::Xtask => programs.join("xtask"),
        Program::Machine(name) => name.into(),
    };
    let started = Instant::now();
    let log = out.join(format!("{}.txt", entry.name));
    let file = File::create(&log).with_context(|| format!("cannot write {}", log.display()))?;
    let outcome = if started >= until {
        Outcome::NotRun
    } else {
        let mut command = Command::new(&program);
        command.args(&entry.arguments).envs(entry.environment.iter().copied()).current_dir(out);
        command.stdin(Stdio::null()).stdout(file.try_clone()?).stderr(file);
        match command.spawn() {
            Ok(child) => ended(child, entry.limit.min(until - started))?,
            Err(_) => Outcome::Missing,
        }
    };
    let text = String::from_utf8_lossy(&fs::read(&log)?).into_owned();
    let lines: Vec<&str> = text.lines().collect();
    let name = program.file_name().unwrap_or_default().to_string_lossy().into_owned();
    let variables = entry.environment.iter().map(|(name, value)| format!("{name}={value} ")).collect::<String>();
    Ok(Answer {
        name: entry.name,
        command: format!("{variables}{name} {}", entry.arguments.join(" ")),
        passes: entry.passes,
        outcome,
        seconds: started.elapsed().as_secs_f64(),
        said: lines[lines.len().saturating_sub(LAST_LINES)..].iter().map(|&line| line.to_owned()).collect(),
        figures: figures(entry, out),
    })
}

/// Waits for a program, and ends it after its time.
fn ended(mut child: Child, limit: Duration) -> Result<Outcome> {
    let until = Instant::now() + limit;
    loop {
        match child.try_wait()? {
            Some(status) if status.success() => return Ok(Outcome::Passed),
            Some(_) => return Ok(Outcome::Failed),
            None if Instant::now() < until => thread::sleep(PAUSE),
            None => {
                child.kill()?;
                child.wait()?;
                return Ok(Outcome::TimedOut);
            }
        }
    }
}

/// The figures that an entry left as JSON: of a benchmark, or of a training.
fn figures(entry: &Entry, out: &Path) -> Value {
    let of_bench = out.join(format!("{}.json", entry.name));
    let of_run = out.join(entry.name).join("results.json");
    let read = |path: &Path| serde_json::from_str(&fs::read_to_string(path).ok()?).ok();
    read(&of_bench).or_else(|| read(&of_run)).unwrap_or(Value::Null)
}

fn write(out: &Path, device: &str, answers: &[Answer]) -> Result<()> {
    let json = serde_json::to_string_pretty(answers)?;
    for (name, text) in [("gpu.json", json), ("gpu.md", table(device, answers))] {
        let path = out.join(name);
        fs::write(&path, text).with_context(|| format!("cannot write {}", path.display()))?;
    }
    Ok(())
}

fn table(device: &str, answers: &[Answer]) -> String {
    let mut text =
        format!("# What {device} answered\n\n| entry | outcome | seconds | passes if |\n|---|---|---|---|\n");
    let mut add = |line: String| {
        // Proof: writing to a string does not fail.
        writeln!(text, "{line}").expect("a string");
    };
    for answer in answers {
        let Answer { name, outcome, seconds, passes, .. } = answer;
        add(format!("| {name} | {} | {seconds:.1} | {passes} |", outcome.word()));
    }
    for answer in answers {
        add(format!("\n## {}\n`{}`\n```\n{}\n```", answer.name, answer.command, answer.said.join("\n")));
    }
    text
}

#[cfg(test)]
mod tests {
    use super::*;

    fn entry(program: &'static str, arguments: &[&str], limit: Duration) -> Entry {
        Entry {
            name: "try",
            program: Program::Machine(program),
            arguments: arguments.iter().map(|&argument| argument.to_owned()).collect(),
            environment: Vec::new(),
            limit,
            passes: "it ends",
        }
    }

    #[test]
    fn every_outcome_is_told_apart() {
        let folder = tempfile::tempdir().expect("a folder");
        let soon = Instant::now() + Duration::from_secs(60);
        let outcome = |entry: &Entry, until| answer(entry, folder.path(), folder.path(), until).expect("answered");
        let second = Duration::from_secs(1);
        assert_eq!(outcome(&entry("true", &[], second), soon).outcome, Outcome::Passed);
        assert_eq!(outcome(&entry("false", &[], second), soon).outcome, Outcome::Failed);
        assert_eq!(outcome(&entry("sleep", &["60"], Duration::from_millis(1)), soon).outcome, Outcome::TimedOut);
        assert_eq!(outcome(&entry("no-such-program", &[], second), soon).outcome, Outcome::Missing);
        assert_eq!(outcome(&entry("true", &[], second), Instant::now()).outcome, Outcome::NotRun);
        let said = outcome(&entry("echo", &["words"], second), soon);
        assert_eq!((said.said, said.command.as_str()), (vec!["words".to_owned()], "echo words"));
    }
}
