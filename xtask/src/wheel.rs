//! The Python package as its users have it: a wheel that maturin builds, installed into a fresh virtual environment, and
//! its tests there. What is missing on this machine is skipped, and says so.

use std::env;
use std::fs;
use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};

use anyhow::{Context, Result, ensure};

use crate::ci::TESTED;
use crate::docs;

/// A Python that can start maturin (`-m maturin`) and make virtual environments.
const PYTHON: &str = "MVFUSION_PYTHON";
/// A folder with the wheels of what it depends on; without it, pip asks its index.
const WHEELS: &str = "MVFUSION_WHEELS";
/// The package, from the root.
const PACKAGE: &str = "mvfusion-cli/python";
/// What maturin starts instead of cargo, from the root.
const CARGO: &str = ".ci/cargo-of-tests";

/// Builds, installs and tests the wheel, where there is all that this takes.
pub fn check() -> Result<()> {
    let python = env::var_os(PYTHON).map_or_else(|| PathBuf::from("python3"), PathBuf::from);
    for (arguments, what) in [
        (["-m", "maturin", "--version"], "maturin (`pip install maturin`)"),
        (["-c", "import ensurepip, venv", ""], "the modules venv and ensurepip"),
    ] {
        if !succeeds(Command::new(&python).args(arguments)) {
            skipped(&format!("{} has not {what}; {PYTHON} names another Python", python.display()));
            return Ok(());
        }
    }
    if !cfg!(unix) {
        skipped(&format!("{CARGO} needs a shell"));
        return Ok(());
    }
    let folder = tempfile::tempdir().context("cannot make a folder for the wheel")?;
    let wheel = build(&python, folder.path())?;
    let fresh = folder.path().join("environment");
    run(Command::new(&python).args(["-m", "venv"]).arg(&fresh), "python -m venv")?;
    let python = fresh.join("bin/python");
    let mut install = Command::new(&python);
    install.args(["-m", "pip", "install", "--quiet", "--disable-pip-version-check", "--only-binary", ":all:"]);
    if let Some(found) = env::var_os(WHEELS) {
        install.args(["--no-index", "--find-links"]).arg(found);
    }
    // With matplotlib, for the notebook.
    run(install.arg(format!("{}[plot]", wheel.display())), "pip install")?;
    let program = env::current_exe().context("cannot tell the folder of programs")?.with_file_name("mvfusion");
    let mut tests = Command::new(&python);
    tests.args(["-m", "unittest", "discover", "--start-directory"]).arg(docs::root().join(PACKAGE).join("tests"));
    // Elsewhere, so that the package is that of the wheel.
    run(tests.current_dir(folder.path()).env("MVFUSION_PROGRAM", program), "the tests of the Python package")
}

/// The wheel, made of what the test build has compiled.
fn build(python: &Path, folder: &Path) -> Result<PathBuf> {
    let mut maturin = Command::new(python);
    maturin.args(["-m", "maturin", "build", "--profile", "dev", "--auditwheel", "skip"]);
    // 240 MB with the lines of a debugger, and gone in a minute.
    maturin.args(["--compression-method", "stored", "--manifest-path"]);
    maturin.arg(docs::root().join(PACKAGE).join("Cargo.toml")).arg("--out").arg(folder);
    maturin.env("CARGO", docs::root().join(CARGO));
    maturin.env("MVFUSION_CARGO", env!("CARGO")).env("MVFUSION_FEATURES", TESTED);
    run(&mut maturin, "maturin build")?;
    let entries = fs::read_dir(folder).context("cannot list the folder of the wheel")?;
    let wheel = entries.filter_map(Result::ok).map(|entry| entry.path());
    let mut wheel = wheel.filter(|path| path.extension().is_some_and(|ending| ending == "whl"));
    wheel.next().context("maturin has written no wheel")
}

fn run(command: &mut Command, name: &str) -> Result<()> {
    let status = command.status().with_context(|| format!("cannot start {name}"))?;
    ensure!(status.success(), "{name} failed: {status}");
    Ok(())
}

/// Whether a command can be started and succeeds, whatever it prints.
fn succeeds(command: &mut Command) -> bool {
    command.stdout(Stdio::null()).stderr(Stdio::null()).status().is_ok_and(|status| status.success())
}

fn skipped(reason: &str) {
    eprintln!("NOT CHECKED: the Python package, because {reason}");
}
