//! Records which revision of the sources the program is built from, if that is known.
//!
//! The revision is the last commit that changed a source of the program, so builds of equal sources are equal, and a
//! commit that changes nothing else (documents, tests) compiles nothing again. The script runs again only if a source
//! has changed. A package from a registry has its revision in a file, and elsewhere none is recorded.

use std::env;
use std::fs;
use std::path::{Path, PathBuf};
use std::process::Command;

/// What the program is made of, in the root of the repository: all that is compiled or compiled in. Tests and documents
/// are not among them.
const SOURCES: [&str; 15] = [
    "Cargo.toml",
    "Cargo.lock",
    "kernels/Cargo.toml",
    "kernels/src",
    "mvfusion-data/Cargo.toml",
    "mvfusion-data/src",
    "mvfusion-render/Cargo.toml",
    "mvfusion-render/src",
    "mvfusion-model/Cargo.toml",
    "mvfusion-model/src",
    "mvfusion-cli/Cargo.toml",
    "mvfusion-cli/build.rs",
    "mvfusion-cli/src",
    "mvfusion-cli/presets",
    "mvfusion-cli/sweeps",
];

/// Written by `cargo package`.
const OF_PACKAGE: &str = ".cargo_vcs_info.json";

fn main() {
    println!("cargo::rerun-if-changed=build.rs");
    let here = PathBuf::from(env::var_os("CARGO_MANIFEST_DIR").unwrap_or_default());
    let revision = match fs::read_to_string(here.join(OF_PACKAGE)) {
        Ok(text) => of_package(&text),
        Err(_) => of_repository(&here),
    };
    if let Some(Revision { commit, is_dirty }) = revision {
        println!("cargo::rustc-env=MVFUSION_GIT_COMMIT={commit}");
        println!("cargo::rustc-env=MVFUSION_GIT_DIRTY={is_dirty}");
    }
}

struct Revision {
    commit: String,
    /// Whether sources differ from the commit.
    is_dirty: bool,
}

/// The revision in `{"git": {"sha1": "…", "dirty": true}, …}`.
fn of_package(text: &str) -> Option<Revision> {
    let (_, rest) = text.split_once("\"sha1\"")?;
    let commit: String =
        rest.chars().skip_while(|c| !c.is_ascii_hexdigit()).take_while(char::is_ascii_hexdigit).collect();
    Some(Revision { commit: commit_name(commit)?, is_dirty: text.contains("\"dirty\": true") })
}

/// The revision of the repository that this crate is a part of.
fn of_repository(here: &Path) -> Option<Revision> {
    let root = here.parent()?;
    // The crate may lie in a foreign repository, whose commits say nothing about it.
    let place = git(here, &["rev-parse", "--show-prefix"])?;
    let is_tracked = git(here, &["ls-files", "--error-unmatch", "Cargo.toml"]).is_some();
    if place.trim_end_matches('/') != "mvfusion-cli" || !is_tracked {
        return None;
    }
    SOURCES.iter().for_each(|source| watch(&root.join(source)));
    let with_sources = |arguments: &[&str]| {
        let arguments: Vec<&str> = arguments.iter().chain(&["--"]).chain(&SOURCES).copied().collect();
        git(root, &arguments)
    };
    let commit = commit_name(with_sources(&["log", "-1", "--format=%H"])?)?;
    let is_dirty = !with_sources(&["status", "--porcelain"])?.is_empty();
    Some(Revision { commit, is_dirty })
}

/// Asks cargo to run this script again when a file changes. For one that does not exist it would do so every time.
fn watch(path: &Path) {
    if path.exists() {
        println!("cargo::rerun-if-changed={}", path.display());
    }
}

/// A commit, if it is the name of one.
fn commit_name(text: String) -> Option<String> {
    (text.len() >= 40 && text.chars().all(|c| c.is_ascii_hexdigit())).then_some(text)
}

/// What git says; `None` if there is no git, or nothing to say.
fn git(folder: &Path, arguments: &[&str]) -> Option<String> {
    // It must not write to the repository, not even its index.
    let output = Command::new("git").arg("--no-optional-locks").args(arguments).current_dir(folder).output().ok()?;
    let text = String::from_utf8(output.stdout).ok()?;
    output.status.success().then(|| text.trim().to_owned())
}
