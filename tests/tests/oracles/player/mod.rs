//! The page of `mvfusion export --html` in a real browser: its pixels against `mvfusion render`, and what readers do.
//!
//! The trials, `player::browser::<what>`, train for some steps with the program's own command and open what it exports.
//! They are ignored where no browser is found.

mod reader;
mod stage;

use std::path::{Path, PathBuf};

use anyhow::{Context, Result, ensure};
use image::RgbImage;
use libtest_mimic::Trial;
use mvfusion_cli::config as configs;
use mvfusion_data::{Scene, View, distinct_cameras};
use mvfusion_model::evaluation::psnr;
use tempfile::TempDir;

use crate::browser::Browser;
use crate::tiny::{SharedRun, mvfusion, text, train};
use crate::{failed, ignored};
use stage::Stage;

/// Least PSNR of the page against the rasteriser, dB. Steps of the page's numbers leave 47 or more.
const LEAST_PSNR: f64 = 40.0;
/// Least PSNR of two frames that show the same, dB.
const SAME: f64 = 60.0;
/// Cameras and times that are compared.
const CAMERAS: usize = 3;
const TIMES: [f64; 3] = [0.0, 0.41, 0.9];
/// Enough steps for Gaussians that have moved and masks that differ.
const STEPS: &str = "train.stages={geometry=60, deformation=60, refinement=30}";

/// The layers of a model of two branches.
const BLENDED: [&str; 4] = ["composed", "static", "dynamic", "mask"];

/// All trials.
pub fn trials() -> Vec<Trial> {
    vec![
        trial("video", || looks_like_the_render(&video()?, &BLENDED)),
        trial("lifetimes", || {
            let folder = tempfile::tempdir()?;
            let settings = ["--set", "scene.kind=motion", "--set", "model.lifetime=true"];
            looks_like_the_render(&trained(&folder, &settings)?, &BLENDED)
        }),
        trial("one_branch", || {
            let folder = tempfile::tempdir()?;
            // `SMALL_MODEL` looks for what moves, which a model of one branch refuses.
            let settings = ["--preset", "quickstart-4dgs", "--set", "init.motion_points=0"];
            looks_like_the_render(&trained(&folder, &settings)?, &["composed"])
        }),
        trial("reader", || readers_find_their_way(&video()?)),
    ]
}

/// A trial that needs a browser.
fn trial(what: &str, check: impl FnOnce() -> Result<()> + Send + 'static) -> Trial {
    let name = format!("player::browser::{what}");
    match Browser::find() {
        Some(_) => Trial::test(name, || check().map_err(failed)),
        None => ignored(name, "no browser was found: set CHROME, or install chromium".to_owned()),
    }
}

/// The run of a video.
fn video() -> Result<PathBuf> {
    static RUN: SharedRun = SharedRun::new();
    RUN.folder(|run| train(run, &["--set", STEPS, "--set", "scene.kind=video"]))
}

/// A run with these settings in a folder.
fn trained(folder: &TempDir, settings: &[&str]) -> Result<PathBuf> {
    let run = folder.path().join("run");
    train(&run, &[&["--set", STEPS], settings].concat())?;
    Ok(run)
}

/// Exports a run, and compares the page with the renders of the same cameras and times, and with all layers of one.
fn looks_like_the_render(run: &Path, layers: &[&str]) -> Result<()> {
    let folder = tempfile::tempdir()?;
    let said = mvfusion(&["export", text(run)?, "--device", "cpu", "--html"])?;
    let page = run.join("scene.html");
    ensure!(said.contains(&page.display().to_string()) && said.contains("PSNR"), "the export says: {said}");
    // Elsewhere and alone, so that it cannot lean on the run's files.
    let alone = tempfile::tempdir()?;
    let moved = alone.path().join("a scene.html");
    std::fs::copy(&page, &moved)?;

    let scene = scene_of(run)?;
    let mut stage = Stage::open(&moved)?;
    let mut has_moved = false;
    for view in views(&scene) {
        let mut frames = Vec::new();
        for time in TIMES {
            let wanted = render(run, view, time, "composed", folder.path())?;
            frames.push((stage.picture(&view.camera, time)?, wanted));
        }
        for (time, (found, wanted)) in TIMES.iter().zip(&frames) {
            let ratio = decibels(found, wanted);
            ensure!(ratio > LEAST_PSNR, "{} at {time}: {ratio} dB", view.name);
            // The time of the page moves what moves.
            for (_, other) in frames.iter().filter(|(_, other)| decibels(wanted, other) < SAME) {
                ensure!(ratio > decibels(found, other), "{} at {time} looks like another time", view.name);
                has_moved = true;
            }
        }
    }
    ensure!(has_moved, "nothing moves in this test");
    let (view, time) = (views(&scene)[0], TIMES[1]);
    for layer in layers {
        let wanted = render(run, view, time, layer, folder.path())?;
        stage.connection().evaluate(&format!("mvfusion.setLayer('{layer}')"))?;
        let ratio = decibels(&stage.picture(&view.camera, time)?, &wanted);
        ensure!(ratio > LEAST_PSNR, "the layer {layer}: {ratio} dB");
    }
    stage.is_silent()
}

/// The PSNR of two images in dB; infinite if they are equal.
fn decibels(found: &RgbImage, wanted: &RgbImage) -> f64 {
    psnr(found, wanted).unwrap_or(f64::INFINITY)
}

/// Exports a run, and does what readers do.
fn readers_find_their_way(run: &Path) -> Result<()> {
    let folder = tempfile::tempdir()?;
    let page = folder.path().join("page.html");
    let export = ["export", text(run)?, "--device", "cpu", &format!("--html={}", text(&page)?), "--size", "2MB"];
    mvfusion(&export)?;
    // A page of ours is known as such.
    mvfusion(&[&export[..], &["--force"]].concat())?;
    reader::inspect(&page)
}

/// The scene of a run.
fn scene_of(run: &Path) -> Result<Scene> {
    Ok(configs::read(&run.join("config.toml"))?.open_scene()?)
}

/// Views of different cameras, spread over the scene.
fn views(scene: &Scene) -> Vec<&View> {
    let views = distinct_cameras(scene.test.iter().chain(&scene.train));
    (0..CAMERAS).map(|index| views[index * (views.len() - 1) / (CAMERAS - 1)]).collect()
}

/// What `mvfusion render` shows.
fn render(run: &Path, view: &View, time: f64, layer: &str, folder: &Path) -> Result<RgbImage> {
    let out = folder.join("render");
    let (run, out_name, time) = (text(run)?, text(&out)?.to_owned(), time.to_string());
    let arguments = ["render", run, "--device", "cpu", "--views", "still", "--frames", "1", "--camera", &view.name];
    let more = ["--time", &time, "--layers", layer, "--format", "png", "--force", "--out", &out_name];
    mvfusion(&[&arguments[..], &more[..]].concat())?;
    let path = out.join(layer).join("00000.png");
    Ok(image::open(&path).with_context(|| format!("cannot open {}", path.display()))?.into_rgb8())
}
