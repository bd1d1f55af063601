//! Continuous integration: formatting, lints, tests, the other feature sets.

use std::process::Command;
use std::time::Instant;

use anyhow::{Context, Result, ensure};

/// The feature set of the one test build: every CPU backend.
const TESTED: &str = "flex,ndarray";

/// Runs every check and stops at the first that fails.
pub fn run() -> Result<()> {
    step("format", &["fmt", "--all", "--check"], &[])?;
    step("lint", &["clippy", "--workspace", "--all-targets", "--features", TESTED, "--", "--deny", "warnings"], &[])?;
    step("test", &["test", "--workspace", "--features", TESTED], &[])?;
    step(
        "document",
        &["doc", "--workspace", "--no-deps", "--features", TESTED],
        &[("RUSTDOCFLAGS", "--deny warnings")],
    )?;
    step("check the default features", &["check", "--workspace"], &[])?;
    step("check ndarray alone", &["check", "--workspace", "--no-default-features", "--features", "ndarray"], &[])
}

fn step(name: &str, arguments: &[&str], environment: &[(&str, &str)]) -> Result<()> {
    eprintln!("== {name}: cargo {}", arguments.join(" "));
    let started = Instant::now();
    let status = Command::new(env!("CARGO"))
        .args(arguments)
        .envs(environment.iter().copied())
        .status()
        .with_context(|| format!("cannot start cargo for `{name}`"))?;
    ensure!(status.success(), "`cargo {}` failed", arguments.join(" "));
    eprintln!("== {name}: {:.0} s", started.elapsed().as_secs_f64());
    Ok(())
}
