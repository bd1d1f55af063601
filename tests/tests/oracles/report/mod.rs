//! The report of a run in a real browser: nothing is wrong, every picture is there, sliders move, colours and widths
//! suit.
//!
//! The trials, `report::browser::<what>`, train for a few steps with the program's own command and open what it wrote.
//! They are ignored where no browser is found. Pages with a known fault show that each check can fail.

mod browser;
mod devtools;
mod faults;
mod inspection;

use std::ffi::OsString;
use std::path::{Path, PathBuf};

use anyhow::{Context, Result, bail, ensure};
use clap::Parser;
use libtest_mimic::Trial;
use mvfusion_cli::args::{Command, TrainArgs};
use mvfusion_cli::progress::Talk;
use mvfusion_cli::{Cli, command};

use crate::{failed, ignored};
use browser::Browser;

/// Settings of a run that passes through all stages in seconds.
const TINY: [&str; 8] = [
    "train.stages={geometry=3, deformation=2, refinement=3}",
    "train.log_interval=1",
    "train.batch_size=1",
    "model.width=8",
    "model.grid={features=2, resolution=[4, 4, 4, 4], multipliers=[1]}",
    "init.dynamic_points=60",
    "motion.samples=4",
    "eval.strips=2",
];

/// The real capture that is trained on, by its folder.
const CAPTURE: &str = "panoptic_neu3d";

/// All trials; those of real captures need the folder of oracles.
pub fn trials(root: Option<&Path>) -> Vec<Trial> {
    let capture = root.map(|root| root.join(CAPTURE)).filter(|folder| folder.is_dir());
    let mut trials = vec![
        trial("video", || report_is_sound("video", &["--set", "scene.kind=video"])),
        trial("casual", || report_is_sound("casual", &["--set", "scene.kind=casual"])),
    ];
    trials.push(match capture {
        Some(folder) => trial("capture", move || {
            let data = folder.to_str().context("a path that is text")?;
            report_is_sound("capture", &["--data", data, "--set", "scene.downscale=4"])
        }),
        None => ignored("report::browser::capture".to_owned(), format!("there is no folder {CAPTURE}")),
    });
    trials.extend(faults::FAULTS.map(|fault| trial(fault.name, move || fault.is_noticed())));
    trials
}

/// A trial that needs a browser.
fn trial(what: &str, check: impl FnOnce() -> Result<()> + Send + 'static) -> Trial {
    let name = format!("report::browser::{what}");
    match Browser::find() {
        Some(_) => Trial::test(name, || check().map_err(failed)),
        None => ignored(name, "no browser was found: set CHROME, or install chromium".to_owned()),
    }
}

/// Trains, and looks the report over. The screenshot stays in the folder of the build's temporary files.
fn report_is_sound(name: &str, scene: &[&str]) -> Result<()> {
    let folder = tempfile::tempdir()?;
    let run = folder.path().join("run");
    let said = train(&run, scene)?;
    let report = run.join("report.html");
    ensure!(said.contains(&report.display().to_string()), "training does not say where the report lies: {said}");
    // Elsewhere and alone, so that it cannot lean on the run's files.
    let alone = tempfile::tempdir()?;
    let page = alone.path().join("sent to a colleague.html");
    std::fs::copy(&report, &page)?;
    drop(folder);
    let screenshot = PathBuf::from(env!("CARGO_TARGET_TMPDIR")).join(format!("report-{name}.png"));
    inspection::inspect(&page, Some(&screenshot))
}

/// Runs `mvfusion train` within this process, and returns what it said.
fn train(run: &Path, scene: &[&str]) -> Result<String> {
    let settings = TINY.iter().flat_map(|setting| ["--set", setting]).chain(scene.iter().copied());
    let line = ["mvfusion", "train", "--device", "cpu"].into_iter().chain(settings).map(OsString::from);
    let out = ["--out".into(), run.as_os_str().to_owned()];
    let mut said = Vec::new();
    command::train(&parsed(line.chain(out))?, Talk::Silent, &mut said)?;
    Ok(String::from_utf8(said)?)
}

fn parsed(line: impl Iterator<Item = OsString>) -> Result<TrainArgs> {
    match Cli::try_parse_from(line)?.command {
        Command::Train(args) => Ok(args),
        _ => bail!("another command"),
    }
}
