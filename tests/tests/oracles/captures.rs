//! Real captures: what the readers make of files that other people wrote.
//!
//! Each trial, `capture::<scene>::<what>`, needs a folder in `$MVFUSION_ORACLES`, and is ignored where there is none.

mod ball;
mod observations;

use std::path::Path;

use anyhow::{Context, Result, ensure};
use libtest_mimic::Trial;
use mvfusion_data::inspect::{Pictures, Severity, inspect};
use mvfusion_data::{Camera, ReadOptions, Scene, View, open};

use crate::{failed, ignored};

/// Largest median distance of a point from where the photos show it, pixels.
const REPROJECTION: f64 = 1.5;

/// Least agreement of a frame that was decoded from a video with the same frame as a picture, dB.
const SAME_FRAME: f64 = 30.0;

/// Least correlation of the points' colours with the photos'.
const COLOURS: f64 = 0.5;

/// A check of a folder.
type Check = fn(&Path) -> Result<()>;

/// The trials: folder, what is checked, and how.
const TRIALS: [(&str, &str, Check); 9] = [
    ("panoptic_neu3d", "is_sound", is_sound),
    ("panoptic_neu3d", "the_ball_is_where_its_track_says", ball_reprojects),
    ("panoptic_neu3d", "videos_show_what_their_frames_show", videos_equal_frames),
    ("pose2sim_neu3d", "is_sound", is_sound),
    ("neu3d_flame_steak_still", "is_sound", is_sound),
    ("dnerf_mutant", "is_sound", is_sound),
    ("fox_clutter", "is_sound", is_sound),
    ("fox_clutter", "points_are_where_they_were_seen", observations_reproject),
    ("fox_clutter", "both_layouts_are_one_scene", layouts_agree),
];

/// All trials.
pub fn trials(root: Option<&Path>) -> Vec<Trial> {
    let trial = |(folder, what, check): (&str, &str, Check)| {
        let name = format!("capture::{folder}::{what}");
        match root.map(|root| root.join(folder)).filter(|path| path.is_dir()) {
            Some(path) => Trial::test(name, move || check(&path).map_err(failed)),
            None => ignored(name, format!("there is no folder {folder}")),
        }
    };
    TRIALS.map(trial).into()
}

fn read(folder: &Path) -> Result<Scene> {
    Ok(open(folder, &ReadOptions::default())?)
}

/// Nothing is wrong with the scene, and its points lie on what they show.
fn is_sound(folder: &Path) -> Result<()> {
    let (inspection, _) = inspect(folder, &ReadOptions::default(), Pictures::Decoded);
    let bad: Vec<_> = inspection.problems.iter().filter(|problem| problem.severity != Severity::Note).collect();
    ensure!(bad.is_empty(), "{bad:?}");
    let summary = inspection.summary.context("the scene was read")?;
    // Random points have no colours to compare.
    if let Some(agreement) = summary.colour_agreement {
        ensure!(agreement > COLOURS, "the points' colours agree with the photos by {agreement} alone");
    }
    Ok(())
}

fn observations_reproject(folder: &Path) -> Result<()> {
    let scene = read(folder)?;
    let distances = observations::distances(&folder.join("sparse/0"), &scene)?;
    ensure!(distances.len() > 1000, "only {} observations", distances.len());
    let median = median(distances);
    ensure!(median < REPROJECTION, "the median distance is {median} pixels");
    Ok(())
}

fn ball_reprojects(folder: &Path) -> Result<()> {
    let distances = ball::distances(&read(folder)?)?;
    ensure!(distances.len() > 50, "the ball was found {} times", distances.len());
    let median = median(distances);
    ensure!(median < REPROJECTION, "the median distance is {median} pixels");
    Ok(())
}

/// The photo collection and the published layout of one capture. The latter has no points.
fn layouts_agree(folder: &Path) -> Result<()> {
    let (one, other) = (read(folder)?, read(&folder.join("official"))?);
    for (part, a, b) in [("training", &one.train, &other.train), ("held-out", &one.test, &other.test)] {
        ensure!(a.len() == b.len(), "{} and {} {part} views", a.len(), b.len());
        // The names differ; the pictures are the same files, byte by byte.
        let decoded = b.iter().map(|view| Ok((view.image.rgb()?, view))).collect::<Result<Vec<_>>>()?;
        for view in a {
            let picture = view.image.rgb()?;
            let twin = decoded.iter().find(|(other, _)| *other == picture).map(|(_, twin)| *twin);
            let twin = twin.with_context(|| format!("{} is not in the other layout", view.name))?;
            let off = difference(&view.camera, &twin.camera);
            ensure!(off < 1e-3, "the cameras of {} and {} differ by {off}", view.name, twin.name);
        }
    }
    Ok(())
}

/// Largest difference of two cameras' numbers; lengths in pixels as shares of the width.
fn difference(a: &Camera, b: &Camera) -> f64 {
    let numbers = |camera: &Camera| {
        let width = camera.width as f64;
        let lens = [camera.fx, camera.fy, camera.cx, camera.cy].map(|v| v / width);
        lens.into_iter().chain(camera.rotation.to_cols_array()).chain(camera.translation.to_array()).collect::<Vec<_>>()
    };
    numbers(a).iter().zip(numbers(b)).map(|(a, b)| (a - b).abs()).fold(0.0, f64::max)
}

/// A copy of the scene without extracted frames shows the same.
fn videos_equal_frames(folder: &Path) -> Result<()> {
    let bare = tempfile::tempdir()?;
    for entry in std::fs::read_dir(folder)? {
        let path = entry?.path();
        if path.extension().is_some_and(|extension| ["mp4", "npy", "ply"].iter().any(|kept| extension == *kept)) {
            std::fs::copy(&path, bare.path().join(path.file_name().context("a name")?))?;
        }
    }
    let (frames, video) = (read(folder)?, read(bare.path())?);
    for (part, a, b) in [("training", &frames.train, &video.train), ("held-out", &frames.test, &video.test)] {
        ensure!(a.len() == b.len(), "{} and {} {part} views", a.len(), b.len());
    }
    for (frame, decoded) in frames.test.iter().chain(&frames.train).zip(video.test.iter().chain(&video.train)) {
        ensure!(frame.camera == decoded.camera && frame.time == decoded.time, "{}: another camera", frame.name);
        let agreement = psnr(frame, decoded)?;
        ensure!(agreement > SAME_FRAME, "{} and {} agree by {agreement} dB alone", frame.name, decoded.name);
    }
    Ok(())
}

fn psnr(a: &View, b: &View) -> Result<f64> {
    let (a, b) = (a.image.rgb()?, b.image.rgb()?);
    let squared = a.iter().zip(b.iter()).map(|(&a, &b)| (f64::from(a) - f64::from(b)).powi(2)).sum::<f64>();
    Ok(-10.0 * (squared / a.len() as f64 / 255.0 / 255.0).log10())
}

fn median(mut values: Vec<f64>) -> f64 {
    values.sort_by(f64::total_cmp);
    values[values.len() / 2]
}
