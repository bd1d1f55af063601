//! Continuous integration: formatting, documents, dependencies, lints, tests, examples, the Python package, the other
//! feature sets.

use std::collections::BTreeMap;
use std::path::PathBuf;
use std::process::{Command, Stdio};
use std::time::Instant;

use anyhow::{Context, Result, ensure};
use serde_json::Value;

use crate::{deny, docs, torture, wheel};

/// The feature set of the one test build: every CPU backend, the GPU through wgpu, the decoder of videos, and NVIDIA's
/// compilers.
pub const TESTED: &str = "flex,ndarray,wgpu,h264,ptx";

/// Runs every check and stops at the first that fails.
pub fn run() -> Result<()> {
    step("format", &["fmt", "--all", "--check"], &[])?;
    timed("documents", docs::check)?;
    timed("dependencies", deny::check)?;
    step("lint", &["clippy", "--workspace", "--all-targets", "--features", TESTED, "--", "--deny", "warnings"], &[])?;
    step("test", &["test", "--workspace", "--features", TESTED], &[])?;
    #[cfg(feature = "ptx")]
    timed("registers", crate::ptx::check)?;
    #[cfg(not(feature = "ptx"))]
    eprintln!("== registers: skipped, because this build has not the feature `ptx`");
    timed("examples", run_examples)?;
    timed("Python package", wheel::check)?;
    timed("torture", torture::run_short)?;
    step(
        "document",
        &["doc", "--workspace", "--no-deps", "--features", TESTED],
        &[("RUSTDOCFLAGS", "--deny warnings")],
    )?;
    step("check the default features", &["check", "--workspace"], &[])?;
    // CubeCL's build script fetches an LLVM for CUDA, unless it is told that only documentation, or a check, is wanted.
    let features = ["check", "--workspace", "--no-default-features", "--features", "ndarray,cuda-cpp,vulkan,metal"];
    step("check cuda, vulkan and metal, and ndarray without flex", &features, &[("DOCS_RS", "1")])
}

fn step(name: &str, arguments: &[&str], environment: &[(&str, &str)]) -> Result<()> {
    timed(&format!("{name}: cargo {}", arguments.join(" ")), || {
        let mut cargo = Command::new(env!("CARGO"));
        let status = cargo.args(arguments).envs(environment.iter().copied()).status();
        let status = status.with_context(|| format!("cannot start cargo for `{name}`"))?;
        ensure!(status.success(), "`cargo {}` failed", arguments.join(" "));
        Ok(())
    })
}

fn timed(name: &str, work: impl FnOnce() -> Result<()>) -> Result<()> {
    eprintln!("== {name}");
    let started = Instant::now();
    work()?;
    let name = name.split(':').next().unwrap_or(name);
    eprintln!("== {name}: {:.0} s", started.elapsed().as_secs_f64());
    Ok(())
}

/// Runs every example as the tests have built it; `cargo run -p …` would build the libraries again, for the features of
/// one package.
fn run_examples() -> Result<()> {
    let examples = docs::examples(docs::root())?;
    if examples.is_empty() {
        return Ok(());
    }
    let built = built_examples()?;
    for example in examples {
        let (name, path) = (&example.name, example.path.display());
        let program = built.get(name).with_context(|| {
            format!("{path} was not built: its `required-features` must be among those of the tests ({TESTED})")
        })?;
        eprintln!("-- {name}");
        // What an example writes to its folder goes with the folder.
        let folder = tempfile::tempdir().context("cannot make a folder to run the example in")?;
        let status = Command::new(program).current_dir(&folder).status();
        let status = status.with_context(|| format!("cannot start {}", program.display()))?;
        ensure!(status.success(), "the example {path} failed: {status}");
    }
    Ok(())
}

/// The programs of the examples, by name.
fn built_examples() -> Result<BTreeMap<String, PathBuf>> {
    let arguments =
        ["build", "--workspace", "--examples", "--features", TESTED, "--message-format", "json-render-diagnostics"];
    let output = Command::new(env!("CARGO")).args(arguments).stderr(Stdio::inherit()).output();
    let output = output.context("cannot start cargo for the examples")?;
    ensure!(output.status.success(), "`cargo {}` failed", arguments.join(" "));
    let mut built = BTreeMap::new();
    for line in String::from_utf8_lossy(&output.stdout).lines() {
        let message: Value = serde_json::from_str(line).context("cargo sent a message that is not JSON")?;
        let is_example =
            message["target"]["kind"].as_array().is_some_and(|kinds| kinds.iter().any(|kind| kind == "example"));
        if let (true, Some(name), Some(program)) =
            (is_example, message["target"]["name"].as_str(), message["executable"].as_str())
        {
            built.insert(name.to_owned(), program.into());
        }
    }
    Ok(built)
}
