//! The folder for a machine with a GPU.

use std::fs;
use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};

use anyhow::{Context, Result, ensure};
use clap::Args;
use serde_json::Value;

use crate::docs;

/// The largest archive, in bytes: what such machines take.
const LARGEST: u64 = 64 << 20;

/// The oracles that GPUs are compared with.
const ORACLES: [&str; 3] = ["oracle_gsplat", "oracle_method", "oracle_metrics"];

/// Where Linux has the loader of Vulkan, which finds the card's driver.
const LOADERS: [&str; 2] = ["/usr/lib/x86_64-linux-gnu/libvulkan.so.1", "/usr/lib64/libvulkan.so.1"];

/// Starts the list, with the loader beside it, and NVIDIA's driver where no other is known.
const RUN: &str = r#"#!/bin/sh
# Asks the GPU of this machine everything, and writes results/gpu.json and results/gpu.md. If the driver's file is
# elsewhere, name it in VK_DRIVER_FILES.
here="$(cd "$(dirname "$0")" && pwd)"
export LD_LIBRARY_PATH="$here/lib${LD_LIBRARY_PATH:+:$LD_LIBRARY_PATH}"
export MVFUSION_ORACLES="$here/data"
if [ -z "$VK_DRIVER_FILES" ] && ! ls /usr/share/vulkan/icd.d/*.json /etc/vulkan/icd.d/*.json >/dev/null 2>&1; then
    export VK_DRIVER_FILES="$here/lib/nvidia_icd.json" VK_ICD_FILENAMES="$here/lib/nvidia_icd.json"
fi
exec "$here/xtask" gpu run --programs "$here" "$@"
"#;

/// The words of [`RUN`] by which a folder of this chore is known.
const MARK: &str = "gpu run --programs";

const NVIDIA: &str =
    r#"{"file_format_version": "1.0.0", "ICD": {"library_path": "libGLX_nvidia.so.0", "api_version": "1.3.0"}}"#;

/// What to pack.
#[derive(Debug, Args)]
pub struct PackArguments {
    /// Folder with the oracles.
    // Without them, nearly every oracle would be ignored there.
    #[arg(long, value_name = "DIR")]
    oracles: PathBuf,
    /// Folder to make, in the place of an earlier one; the archive lies beside it.
    #[arg(long, default_value = "target/gpu")]
    out: PathBuf,
    /// Features of the programs.
    #[arg(long, default_value = "flex,vulkan")]
    features: String,
    /// Profile of the programs; symbols are left out in any case.
    #[arg(long, default_value = "release")]
    profile: String,
}

/// Builds and packs.
pub(super) fn run(arguments: &PackArguments) -> Result<()> {
    let out = &arguments.out;
    for name in ORACLES {
        let folder = arguments.oracles.join(name);
        ensure!(folder.is_dir(), "there is no folder {}", folder.display());
    }
    make_room(out)?;
    let built = [
        build(arguments, &["build", "--workspace", "--bin", "mvfusion", "--bin", "xtask"])?,
        build(arguments, &["test", "--workspace", "--test", "oracles", "--no-run"])?,
    ];
    for folder in ["", "lib", "data"] {
        fs::create_dir_all(out.join(folder)).with_context(|| format!("cannot make {}", out.join(folder).display()))?;
    }
    // First, so that the folder is known as ours even if what follows fails.
    write(&out.join("run.sh"), RUN)?;
    for program in ["mvfusion", "xtask", "oracles"] {
        let path = built.iter().find_map(|built| program_of(built, program));
        let path = path.with_context(|| format!("cargo did not build `{program}`"))?;
        copy(&path, &out.join(program))?;
    }
    for name in ORACLES {
        copy_folder(&arguments.oracles.join(name), &out.join("data").join(name))?;
    }
    if let Some(loader) = LOADERS.iter().map(Path::new).find(|path| path.exists()) {
        copy(loader, &out.join("lib/libvulkan.so.1"))?;
    }
    write(&out.join("lib/nvidia_icd.json"), NVIDIA)?;
    let archive = archive(out)?;
    let bytes = fs::metadata(&archive)?.len();
    say(&format!("{}: {:.1} MiB\n", archive.display(), bytes as f64 / f64::from(1 << 20)));
    ensure!(bytes <= LARGEST, "the archive has {bytes} bytes, {LARGEST} at most");
    Ok(())
}

/// Removes an earlier folder of this chore, because all that lies in the folder is packed. Another one must be empty.
fn make_room(out: &Path) -> Result<()> {
    if fs::read_to_string(out.join("run.sh")).is_ok_and(|text| text.contains(MARK)) {
        return fs::remove_dir_all(out).with_context(|| format!("cannot remove {}", out.display()));
    }
    let is_empty = |folder: &Path| Ok::<_, std::io::Error>(fs::read_dir(folder)?.next().is_none());
    let is_free = !out.exists() || is_empty(out).with_context(|| format!("cannot list {}", out.display()))?;
    ensure!(is_free, "{} is not empty, and this chore has not made it: name another folder", out.display());
    Ok(())
}

#[expect(clippy::print_stdout, reason = "this is what the chore is for")]
fn say(text: &str) {
    print!("{text}");
}

/// Runs cargo, and returns its messages.
fn build(arguments: &PackArguments, command: &[&str]) -> Result<Vec<Value>> {
    let profile = &arguments.profile;
    let mut cargo = Command::new(env!("CARGO"));
    // Build scripts that start `rustc` in their own folder would get the compiler of a toolchain file there. A start by
    // `cargo xtask` has the variable already.
    if let (None, Some(toolchain)) = (std::env::var_os("RUSTUP_TOOLCHAIN"), option_env!("RUSTUP_TOOLCHAIN")) {
        cargo.env("RUSTUP_TOOLCHAIN", toolchain);
    }
    cargo.current_dir(docs::root()).args(command).args(["--features", &arguments.features, "--profile", profile]);
    cargo.args([
        "--config",
        &format!("profile.{profile}.strip=\"symbols\""),
        "--message-format",
        "json-render-diagnostics",
    ]);
    let output = cargo.stderr(Stdio::inherit()).output().context("cannot start cargo")?;
    ensure!(output.status.success(), "`cargo {}` failed", command.join(" "));
    let lines = String::from_utf8_lossy(&output.stdout);
    lines.lines().map(|line| serde_json::from_str(line).context("cargo sent a message that is not JSON")).collect()
}

/// The path of a built program.
fn program_of(messages: &[Value], name: &str) -> Option<PathBuf> {
    let of = |message: &Value| {
        let is_it = message["target"]["name"] == name && message["reason"] == "compiler-artifact";
        message["executable"].as_str().filter(|_| is_it).map(PathBuf::from)
    };
    messages.iter().find_map(of)
}

fn copy(from: &Path, to: &Path) -> Result<()> {
    fs::copy(from, to).with_context(|| format!("cannot copy {} to {}", from.display(), to.display()))?;
    Ok(())
}

fn copy_folder(from: &Path, to: &Path) -> Result<()> {
    fs::create_dir_all(to).with_context(|| format!("cannot make {}", to.display()))?;
    for entry in fs::read_dir(from).with_context(|| format!("cannot read {}", from.display()))? {
        let entry = entry?;
        let target = to.join(entry.file_name());
        if entry.file_type()?.is_dir() { copy_folder(&entry.path(), &target)? } else { copy(&entry.path(), &target)? }
    }
    Ok(())
}

fn write(path: &Path, text: &str) -> Result<()> {
    fs::write(path, text).with_context(|| format!("cannot write {}", path.display()))
}

/// Packs a folder by the system's `tar`. Programs of this size need the smaller format, and a dictionary of the size of
/// all three programs, which share most of their code.
fn archive(folder: &Path) -> Result<PathBuf> {
    let archive = folder.with_extension("tar.xz");
    let name = folder.file_name().context("the folder has a name")?;
    let parent = folder.parent().filter(|parent| !parent.as_os_str().is_empty()).unwrap_or(Path::new("."));
    let status = Command::new("tar")
        .env("XZ_OPT", "--lzma2=preset=6,dict=192MiB")
        .arg("--create")
        .arg("--xz")
        .arg("--file")
        .arg(&archive)
        .arg("--directory")
        .arg(parent)
        .arg(name)
        .status();
    ensure!(status.context("cannot start tar")?.success(), "tar failed");
    Ok(archive)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn only_a_folder_of_this_chore_makes_room() {
        assert!(RUN.contains(MARK));
        let parent = tempfile::tempdir().expect("a folder");
        let out = parent.path().join("gpu");
        make_room(&out).expect("there is none");
        fs::create_dir(&out).expect("made");
        make_room(&out).expect("it is empty");
        fs::write(out.join("run.sh"), "#!/bin/sh\n").expect("written");
        let error = make_room(&out).expect_err("it belongs to somebody else").to_string();
        assert!(error.contains("not empty"), "{error}");
        fs::write(out.join("run.sh"), RUN).expect("written");
        make_room(&out).expect("it is ours");
        assert!(!out.exists());
    }
}
