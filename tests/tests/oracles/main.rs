//! Comparison with reference numbers that were computed elsewhere.
//!
//! Every `.npz` file in `$MVFUSION_ORACLES/{oracle_gsplat,oracle_method,oracle_metrics}` is one trial a backend, named
//! `oracle::<backend>::<kind>::<file>`; without the folder each kind is one ignored trial. So are the pairs of pictures
//! in `oracle_metrics/metrics.json`. The project's own small oracle (`tests/oracles/own.npz`, made by `make.py` beside
//! it) always runs, and so do hard inputs ([`hard`]). The report of a run and the page that plays its scene are opened
//! in a real browser ([`report`], [`player`]), a sweep's cells are run by a real SLURM ([`cluster`]), scenes are made
//! of photos and videos by a real COLMAP ([`prepare`]), other files that the program writes are read by the readers of
//! others ([`foreign`]), and configurations are judged by their schema ([`schema`]). The texts of the GPU kernels are
//! counted, and compiled by a browser (`kernels`).
#![recursion_limit = "256"]

mod archive;
mod browser;
mod cameras;
mod captures;
mod clouds;
mod cluster;
mod composition;
mod densify;
mod foreign;
mod hard;
mod hexplane;
mod images;
#[cfg(feature = "wgpu")]
mod kernels;
mod kinds;
mod lenses;
mod losses;
mod lpips_weights;
mod metrics;
mod network;
mod own;
mod parity;
mod player;
mod prepare;
mod refinement;
mod report;
mod schedule;
mod schema;
mod splat;
mod statistics;
mod tiny;
mod training;
mod variants;
mod viewer;

use std::path::{Path, PathBuf};
use std::process::ExitCode;

use anyhow::{Context, Result, bail};
use libtest_mimic::{Arguments, Completion, Failed, Trial};
use mvfusion_tests::{Backend, every_backend, gpu_backends, is_there};

use archive::Archive;
use kinds::{Kind, kind_of};

/// The variable that names the folder of the oracles.
const FOLDER: &str = "MVFUSION_ORACLES";

fn main() -> ExitCode {
    // SAFETY: nothing has started a thread yet, so nobody reads the environment meanwhile.
    unsafe { std::env::set_var(mvfusion_cli::lpips::VARIABLE, "none") };
    let arguments = Arguments::from_args();
    let mut trials = Vec::new();
    // The longest trial is among these. It starts first, so that others run beside it.
    for backend in gpu_backends() {
        if is_there(backend) {
            trials.extend(training::trials(backend));
        } else {
            trials.push(ignored(format!("gpu::{}", backend.name), "no adapter was found".to_owned()));
        }
    }
    for backend in every_backend() {
        trials.extend(own::trials(backend));
        trials.extend(hard::trials(backend));
        trials.extend(parity::trials(backend));
        trials.extend(shared(backend));
        trials.extend(metrics::trials(backend));
    }
    trials.extend(captures::trials(root().as_deref()));
    trials.extend(report::trials(root().as_deref()));
    trials.extend(player::trials());
    trials.extend(prepare::trials(root().as_deref()));
    trials.extend(viewer::trials());
    trials.extend(cluster::trials());
    trials.extend(foreign::trials());
    trials.extend(schema::trials());
    trials.extend(lpips_weights::trials(root().as_deref()));
    #[cfg(feature = "wgpu")]
    trials.extend(kernels::trials());
    libtest_mimic::run(&arguments, trials).exit_code()
}

/// The folder that [`FOLDER`] names, if it is there.
fn root() -> Option<PathBuf> {
    std::env::var_os(FOLDER).map(PathBuf::from).filter(|root| root.is_dir())
}

/// The trials of the folder of oracles.
fn shared(backend: Backend) -> Vec<Trial> {
    let root = root();
    let files: Vec<(&str, PathBuf)> = match &root {
        Some(root) => kinds::FOLDERS.iter().flat_map(|folder| npz_files(&root.join(folder), folder)).collect(),
        None => Vec::new(),
    };
    let mut trials: Vec<Trial> = files.iter().map(|(folder, path)| trial(backend, folder, path)).collect();
    for kind in kinds::KINDS {
        let present =
            files.iter().any(|(folder, path)| kind_of(folder, &stem(path)).is_some_and(|k| k.name == kind.name));
        if !present {
            let reason = match &root {
                None => format!("{FOLDER} names no folder"),
                Some(_) => "the folder has no file of this kind".to_owned(),
            };
            trials.push(ignored(format!("oracle::{}::{}", backend.name, kind.name), reason));
        }
    }
    trials
}

/// The trial of a file.
fn trial(backend: Backend, folder: &'static str, path: &Path) -> Trial {
    let stem = stem(path);
    let kind = kind_of(folder, &stem);
    let name = format!("oracle::{}::{}::{stem}", backend.name, kind.map_or("unknown", |kind| kind.name));
    match kind {
        Some(Kind { needs: Some(other), .. }) if !beside(path, other).is_dir() => {
            ignored(name, format!("there is no folder {other}"))
        }
        Some(kind) => {
            let path = path.to_owned();
            Trial::test(name, move || check(kind, &path, backend).map_err(failed))
        }
        None => {
            let message = format!("no check knows the files named like {folder}/{stem}.npz");
            Trial::test(name, move || Err(message.into()))
        }
    }
}

/// Checks a file, and that the check has looked at all its outputs but those that are left out for a reason.
fn check(kind: &Kind, path: &Path, backend: Backend) -> Result<()> {
    let archive = Archive::open(path)?;
    (kind.check)(&archive, &(backend.device)()).with_context(|| path.display().to_string())?;
    let left_out = |name: &str| kind.left_out.iter().any(|(part, _reason)| name.contains(part));
    let unseen = archive.unseen(|name| !name.starts_with("in.") && !left_out(name));
    if !unseen.is_empty() {
        bail!("{}: {} outputs were not compared: {unseen:?}", path.display(), unseen.len());
    }
    Ok(())
}

/// Another folder of the oracles than the one of a file.
fn beside(path: &Path, folder: &str) -> PathBuf {
    path.parent().and_then(Path::parent).unwrap_or(Path::new(".")).join(folder)
}

fn failed(error: anyhow::Error) -> Failed {
    format!("{error:#}").into()
}

/// A trial that shows as ignored, however it is asked for.
fn ignored(name: String, reason: String) -> Trial {
    Trial::ignorable_test(name, || Ok(Completion::ignored_with(reason)))
}

/// The `.npz` files of a folder, sorted; none if it cannot be listed.
fn npz_files(folder: &Path, name: &'static str) -> Vec<(&'static str, PathBuf)> {
    let entries = std::fs::read_dir(folder).into_iter().flatten().flatten();
    let mut paths: Vec<PathBuf> =
        entries.map(|entry| entry.path()).filter(|path| path.extension().is_some_and(|e| e == "npz")).collect();
    paths.sort();
    paths.into_iter().map(|path| (name, path)).collect()
}

fn stem(path: &Path) -> String {
    path.file_stem().unwrap_or_default().to_string_lossy().into_owned()
}
