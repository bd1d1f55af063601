//! `cargo xtask mutate`: many damaged files for each reader, and a table of what came of them.
//!
//! The tests do the same with few files (`tests/tests/mutate/`).

use std::process::{Command, Stdio};

use anyhow::{Context, Result, ensure};
use clap::Args;

use crate::ci::TESTED;

/// Options of the chore.
#[derive(Debug, Args)]
pub struct MutateArguments {
    /// Only readers whose name contains this; `list` lists them.
    #[arg(long)]
    reader: Option<String>,
    /// Files of each reader.
    #[arg(long, default_value_t = 100_000)]
    files: u64,
    /// Time of each reader, however few files that are: 90s, 10m, 2h.
    #[arg(long, value_parser = seconds)]
    budget: Option<u64>,
    /// Number of the first file. The damage follows from the reader's name and the number.
    #[arg(long, default_value_t = 0)]
    first: u64,
}

/// Runs the test with these settings.
pub fn run(arguments: &MutateArguments) -> Result<()> {
    let mut cargo = tests();
    match arguments.reader.as_deref() {
        Some("list") => drop(cargo.arg("--list")),
        Some(name) => {
            // A filter that matches nothing is no failure of a test.
            let listed = tests().arg("--list").stderr(Stdio::inherit()).output().context("cannot start cargo")?;
            let is_known = String::from_utf8_lossy(&listed.stdout).lines().any(|line| line.contains(name));
            ensure!(is_known, "no reader's name contains `{name}`; `--reader list` lists them");
            cargo.arg(name);
        }
        None => {}
    }
    cargo.env("MUTATE_FILES", arguments.files.to_string()).env("MUTATE_FIRST", arguments.first.to_string());
    if let Some(seconds) = arguments.budget {
        cargo.env("MUTATE_SECONDS", seconds.to_string());
    }
    let status = cargo.status().context("cannot start cargo")?;
    ensure!(status.success(), "a reader failed");
    Ok(())
}

/// The test, which takes further arguments.
fn tests() -> Command {
    let mut cargo = Command::new(env!("CARGO"));
    cargo.args(["test", "--workspace", "--features", TESTED, "--test", "mutate", "--"]);
    cargo
}

/// A time with its unit.
fn seconds(text: &str) -> Result<u64, String> {
    let units = [("s", 1), ("m", 60), ("h", 3600)];
    let parsed = units.iter().find_map(|(unit, seconds)| {
        let number: u64 = text.strip_suffix(unit)?.parse().ok()?;
        number.checked_mul(*seconds)
    });
    parsed.ok_or_else(|| "a number with s, m or h, such as 10m".to_owned())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_budget_has_a_unit() {
        assert_eq!(["90s", "10m", "2h"].map(seconds), [Ok(90), Ok(600), Ok(7200)]);
        assert!(["10", "m", "", "-1s"].into_iter().all(|text| seconds(text).is_err()));
    }
}
