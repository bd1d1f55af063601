//! Licences, sources and duplicates of the crates that we build on, and known holes in them, by `cargo deny` and
//! `.cargo/deny.toml`. What cannot be checked on this machine is skipped, and says so.

use std::process::{Command, Stdio};

use anyhow::{Context, Result, ensure};

/// Runs all checks that this machine can run.
pub fn check() -> Result<()> {
    if !succeeds(&["deny", "--version"])? {
        skipped("everything", "cargo-deny is not installed (`cargo install --locked cargo-deny`)");
        return Ok(());
    }
    // Those of other systems, too, whose licences are read from their sources.
    if !succeeds(&["fetch", "--locked"])? {
        skipped("everything", "the registry cannot be reached");
        return Ok(());
    }
    run(&["licenses", "bans", "sources"])?;
    if !succeeds(&["deny", "fetch", "db"])? {
        skipped("advisories", "their database cannot be fetched");
        return Ok(());
    }
    run(&["advisories"])
}

fn run(checks: &[&str]) -> Result<()> {
    let status = cargo(&["deny", "check", "--hide-inclusion-graph"]).args(checks).status();
    let status = status.context("cannot start cargo deny")?;
    ensure!(status.success(), "`cargo deny check {}` failed", checks.join(" "));
    Ok(())
}

/// Whether a command of cargo succeeds, whatever it prints.
fn succeeds(arguments: &[&str]) -> Result<bool> {
    let status = cargo(arguments).stdout(Stdio::null()).stderr(Stdio::null()).status();
    Ok(status.context("cannot start cargo")?.success())
}

fn cargo(arguments: &[&str]) -> Command {
    let mut cargo = Command::new(env!("CARGO"));
    cargo.args(arguments);
    cargo
}

fn skipped(what: &str, reason: &str) {
    eprintln!("NOT CHECKED: {what}, because {reason}");
}
