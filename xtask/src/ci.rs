//! Continuous integration: formatting, lints, tests, the other feature sets.

use std::process::Command;
use std::time::Instant;

use anyhow::{Context, Result, ensure};

/// The feature set of the one test build: every CPU backend, and the GPU through wgpu.
const TESTED: &str = "flex,ndarray,wgpu";

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
    // CubeCL's build script fetches an LLVM for CUDA, unless it is told that only documentation, or a check, is wanted.
    let features = ["check", "--workspace", "--no-default-features", "--features", "ndarray,cuda,vulkan,metal"];
    step("check cuda, vulkan and metal, and ndarray without flex", &features, &[("DOCS_RS", "1")])
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
