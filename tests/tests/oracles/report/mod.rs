//! The report of a run in a real browser: nothing is wrong, every picture is there, sliders move, colours and widths
//! suit.
//!
//! The trials, `report::browser::<what>`, train for a few steps with the program's own command and open what it wrote.
//! They are ignored where no browser is found. Pages with a known fault show that each check can fail.

mod faults;
mod film;
mod inspection;
pub mod pixels;

use std::path::{Path, PathBuf};

use anyhow::{Result, ensure};
use libtest_mimic::Trial;

use crate::browser::Browser;
use crate::tiny::{text, train};
use crate::{failed, ignored};

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
            report_is_sound("capture", &["--data", text(&folder)?, "--set", "scene.downscale=4"])
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
