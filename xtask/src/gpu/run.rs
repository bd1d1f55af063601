//! The list, run where the GPU is.

use std::fs::{self, File};
use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};
use std::time::{Duration, Instant};

use anyhow::{Context, Result, ensure};
use clap::Args;
use mvfusion_cli::interrupt::Signals;
use mvfusion_cli::run::{RESULTS, checkpoints};
use serde_json::Value;

use super::answer::{Answer, write};
use super::list::{Entry, Goal, Program, list};
use super::outcome::{Outcome, Tests};
use super::process;

/// The last lines of what was said that an answer quotes.
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
    /// The first device of a backend, as `mvfusion devices` names it.
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

/// Runs the list. Failures are results, not errors of this chore.
pub(super) fn run(arguments: &RunArguments) -> Result<()> {
    refuse_others(&arguments.device)?;
    let programs = match &arguments.programs {
        Some(folder) => folder.clone(),
        None => std::env::current_exe()?.parent().context("this program lies in a folder")?.to_owned(),
    };
    let programs = fs::canonicalize(&programs).with_context(|| format!("there is no folder {}", programs.display()))?;
    fs::create_dir_all(&arguments.out).with_context(|| format!("cannot make {}", arguments.out.display()))?;
    let until = Instant::now() + Duration::from_secs(60 * arguments.minutes);
    let signals = Signals::watch().context("cannot watch for signals")?;
    let entries = list(&arguments.device, arguments.rehearse);
    let wanted = |entry: &Entry| arguments.only.is_empty() || arguments.only.iter().any(|name| name == entry.name);
    let mut answers = Vec::new();
    for entry in entries.into_iter().filter(wanted) {
        eprintln!("== {}", entry.name);
        answers.push(answer(&entry, &programs, &arguments.out, until, &signals)?);
        write(&arguments.out, &arguments.device, arguments.rehearse, &answers)?;
    }
    Ok(())
}

/// Refuses all devices but the first of a backend, because the oracles take no other: half of the answers would be of
/// another GPU.
fn refuse_others(device: &str) -> Result<()> {
    let index = device.split_once(':').map_or("0", |(_, index)| index);
    ensure!(
        index == "0",
        "the oracles take the first GPU of a backend, so all is asked of that one, not of `{device}`: give index 0, \
         and let the driver show the wanted GPU alone"
    );
    Ok(())
}

/// Runs an entry within the folder of the results.
fn answer(entry: &Entry, programs: &Path, out: &Path, until: Instant, signals: &Signals) -> Result<Answer> {
    let program = match entry.program {
        Program::Mvfusion => programs.join("mvfusion"),
        Program::Oracles => programs.join("oracles"),
        Program::Xtask => programs.join("xtask"),
        Program::Machine(name) => name.into(),
    };
    let started = Instant::now();
    let log = out.join(format!("{}.txt", entry.name));
    let file = File::create(&log).with_context(|| format!("cannot write {}", log.display()))?;
    let end = if started >= until {
        Err(Outcome::NotRun)
    } else {
        remove_made(entry, out)?;
        let mut command = Command::new(&program);
        command.args(&entry.arguments).envs(entry.environment.iter().copied()).current_dir(out);
        command.stdin(Stdio::null()).stdout(file.try_clone()?).stderr(file);
        process::lead_a_group(&mut command);
        match command.spawn() {
            Ok(child) => {
                let is_enough = || entry.goal == Goal::Checkpoint && has_checkpoint(entry, out);
                Ok(process::ended(child, entry.limit.min(until - started), signals, is_enough)?)
            }
            Err(_) => Err(Outcome::Missing),
        }
    };
    let seconds = started.elapsed().as_secs_f64();
    let said = String::from_utf8_lossy(&fs::read(&log)?).into_owned();
    let outcome = match end {
        Ok(end) => Outcome::of(&entry.goal, end, &said),
        Err(outcome) => outcome,
    };
    let lines: Vec<&str> = said.lines().collect();
    let name = program.file_name().unwrap_or_default().to_string_lossy().into_owned();
    let variables = entry.environment.iter().map(|(name, value)| format!("{name}={value} ")).collect::<String>();
    Ok(Answer {
        name: entry.name,
        command: format!("{variables}{name} {}", entry.arguments.join(" ")),
        look_for: entry.look_for,
        outcome,
        seconds,
        tests: if entry.goal == Goal::Tests { Tests::of(&said) } else { None },
        said: lines[lines.len().saturating_sub(LAST_LINES)..].iter().map(|&line| line.to_owned()).collect(),
        figures: if outcome == Outcome::Ended { figures(entry, out) } else { Value::Null },
    })
}

/// Removes what an earlier run of an entry made, so that it does not pass for the answer of this one.
fn remove_made(entry: &Entry, out: &Path) -> Result<()> {
    let Some(path) = entry.makes().map(|name| out.join(name)) else { return Ok(()) };
    let removed = if path.is_dir() {
        fs::remove_dir_all(&path)
    } else if path.exists() {
        fs::remove_file(&path)
    } else {
        Ok(())
    };
    removed.with_context(|| format!("cannot remove {}", path.display()))
}

/// Whether the training of an entry can be killed and resumed: it has a checkpoint that is not the last.
fn has_checkpoint(entry: &Entry, out: &Path) -> bool {
    let found = entry.makes().and_then(|run| checkpoints(&out.join(run)).ok());
    found.is_some_and(|all| all.iter().any(|checkpoint| checkpoint.step.is_some()))
}

/// The figures that an entry left as JSON: of a benchmark, or of a training.
fn figures(entry: &Entry, out: &Path) -> Value {
    let read = || -> Option<Value> {
        let made = out.join(entry.makes()?);
        let path = if made.is_dir() { made.join(RESULTS) } else { made };
        serde_json::from_str(&fs::read_to_string(path).ok()?).ok()
    };
    read().unwrap_or(Value::Null)
}

#[cfg(test)]
mod tests {
    use super::*;

    const MINUTE: Duration = Duration::from_secs(60);

    fn entry(program: &'static str, arguments: &[&str], limit: Duration) -> Entry {
        Entry {
            name: "try",
            program: Program::Machine(program),
            arguments: arguments.iter().map(|&argument| argument.to_owned()).collect(),
            environment: Vec::new(),
            limit,
            goal: Goal::End,
            look_for: "it ends",
        }
    }

    /// A script that is said to make a file or a folder of this name.
    fn script(text: &str, makes: &str) -> Entry {
        entry("sh", &["-c", text, "--out", makes], MINUTE)
    }

    fn answered(entry: &Entry, folder: &Path) -> Answer {
        answer(entry, folder, folder, Instant::now() + MINUTE, &Signals::default()).expect("answered")
    }

    #[test]
    fn every_outcome_is_told_apart() {
        let folder = tempfile::tempdir().expect("a folder");
        let outcome = |entry: &Entry| answered(entry, folder.path()).outcome;
        assert_eq!(outcome(&entry("true", &[], MINUTE)), Outcome::Ended);
        assert_eq!(outcome(&entry("false", &[], MINUTE)), Outcome::Failed);
        assert_eq!(outcome(&entry("sleep", &["60"], Duration::from_millis(1))), Outcome::TimedOut);
        assert_eq!(outcome(&entry("no-such-program", &[], MINUTE)), Outcome::Missing);
        assert_eq!(outcome(&Entry { goal: Goal::Tests, ..entry("true", &[], MINUTE) }), Outcome::NoTestRan);
        let said = answered(&entry("echo", &["words"], MINUTE), folder.path());
        assert_eq!((said.said, said.command.as_str()), (vec!["words".to_owned()], "echo words"));
        let (late, path) = (entry("true", &[], MINUTE), folder.path());
        let late = answer(&late, path, path, Instant::now(), &Signals::default()).expect("answered");
        assert_eq!(late.outcome, Outcome::NotRun);
    }

    #[test]
    fn a_training_is_killed_once_it_has_a_checkpoint() {
        let folder = tempfile::tempdir().expect("a folder");
        let training = "mkdir -p run/checkpoints; touch run/checkpoints/step_3.safetensors";
        let killed = |text: &str| Entry { goal: Goal::Checkpoint, ..script(text, "run") };
        let outcome = |text: &str| answered(&killed(text), folder.path()).outcome;
        assert_eq!(outcome(&format!("{training}; sleep 60")), Outcome::Killed);
        assert_eq!(outcome("mkdir run"), Outcome::NotKilled, "the folder was removed");
    }

    #[test]
    fn figures_are_those_of_this_run() {
        let folder = tempfile::tempdir().expect("a folder");
        let figures = |text: &str| answered(&script(text, "try.json"), folder.path()).figures;
        assert_eq!(figures("echo 7 > try.json"), 7);
        assert_eq!(figures("true"), Value::Null, "those of an earlier run were removed");
        assert_eq!(figures("echo 7 > try.json; false"), Value::Null);
        let training = script("mkdir run && echo 8 > run/results.json", "run");
        assert_eq!([(); 2].map(|()| answered(&training, folder.path()).figures), [8, 8]);
    }

    #[test]
    fn only_the_first_device_is_asked() {
        for device in ["wgpu:0", "cuda:0", "flex"] {
            refuse_others(device).expect("a first device");
        }
        refuse_others("wgpu:1").expect_err("the oracles would take wgpu:0");
    }
}
