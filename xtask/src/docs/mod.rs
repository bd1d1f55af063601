//! Checks of the documentation: Markdown whose faults a reader would see, and lists that are written from the sources.

mod configuration;
mod examples;
mod features;
mod generated;
mod links;
mod markdown;
mod packages;
mod tables;

use std::fmt;
use std::fs;
use std::path::{Path, PathBuf};
use std::process::Command;

use anyhow::{Context, Result, bail, ensure};
use clap::Args;

use self::examples::Example;
use self::links::Repository;

/// What `cargo xtask docs` is told.
#[derive(Debug, Args)]
pub struct DocsArguments {
    /// Write the generated lists before the checks.
    #[arg(long)]
    write: bool,
}

/// What is wrong in a file, and what to do about it.
#[derive(Clone, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub struct Fault {
    /// From the root of the repository.
    pub path: PathBuf,
    /// From one.
    pub line: usize,
    /// The fault, a colon, the remedy.
    pub message: String,
}

impl fmt::Display for Fault {
    fn fmt(&self, formatter: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(formatter, "{}:{}: {}", self.path.display(), self.line, self.message)
    }
}

/// Writes the generated lists if that is asked for, and checks.
pub fn run(arguments: &DocsArguments) -> Result<()> {
    if arguments.write {
        for path in generated::write(root())? {
            eprintln!("written: {}", path.display());
        }
    }
    check()
}

/// Checks every Markdown file and every generated list, and names all faults.
pub fn check() -> Result<()> {
    let root = root();
    let mut faults = generated::faults(root)?;
    faults.extend(Repository::read(root, files(root)?)?.faults());
    faults.sort();
    for fault in &faults {
        eprintln!("{fault}");
    }
    ensure!(faults.is_empty(), "{} faults in the documentation, listed above", faults.len());
    Ok(())
}

/// The examples of all packages.
pub fn examples(root: &Path) -> Result<Vec<Example>> {
    examples::find(root, &packages::all(root)?)
}

/// The folder of the workspace.
pub fn root() -> &'static Path {
    Path::new(concat!(env!("CARGO_MANIFEST_DIR"), "/.."))
}

/// The files that a commit of everything would hold, from the root. New ones need no `git add` to be linked to.
fn files(root: &Path) -> Result<Vec<PathBuf>> {
    let listing = Command::new("git")
        .args(["ls-files", "-z", "--cached", "--others", "--exclude-standard"])
        .current_dir(root)
        .output()
        .context("cannot start git, which lists the files to check: install it")?;
    if !listing.status.success() {
        bail!("git cannot list the files of {}: {}", root.display(), String::from_utf8_lossy(&listing.stderr).trim());
    }
    let listing = String::from_utf8(listing.stdout).context("a file's name is not UTF-8")?;
    // A deleted file is listed until its deletion is committed.
    Ok(listing.split_terminator('\0').map(PathBuf::from).filter(|path| root.join(path).is_file()).collect())
}

/// The text of a file, given from the root.
fn text(root: &Path, path: &Path) -> Result<String> {
    fs::read_to_string(root.join(path)).with_context(|| format!("cannot read {}", path.display()))
}
