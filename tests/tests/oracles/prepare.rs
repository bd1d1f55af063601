//! Scenes that `mvfusion prepare` makes of real photos and videos with a real COLMAP, against known poses.
//!
//! Each trial, `prepare::<footage>`, needs the program `colmap` and a folder in `$MVFUSION_ORACLES`, and is ignored
//! without them. COLMAP runs in one thread with a fixed seed, so that it finds the same poses each time on one machine.
//! Processors round differently: one frame of a video in which few points are matched may be a degree off on one of
//! them and not on another.

use std::collections::BTreeMap;
use std::fs;
use std::path::{Path, PathBuf};
use std::process::Command;

use anyhow::{Context, Result, ensure};
use libtest_mimic::{Completion, Trial};
use mvfusion_data::{Camera, ReadOptions, Scene, VideoWriter, can_write_videos, open};
use mvfusion_tests::{PoseError, PoseErrors};
use serde_json::Value;

use crate::failed;
use crate::tiny::{mvfusion, text};

/// Number of photos: COLMAP compares each pair.
const PHOTOS: usize = 16;

/// Bounds of a good camera's errors.
const GOOD: PoseError = PoseError { degrees: 1.0, share: 0.02 };

/// Bounds of every camera that was placed.
const POOR: PoseError = PoseError { degrees: 5.0, share: 0.1 };

/// Length of the axes that are aligned, see [`PoseErrors::of`]. The few cameras of the rig stand nearly on a line, so that
/// only their directions say how it is turned around that line.
const AXIS: f64 = 0.1;
const RIG_AXIS: f64 = 1.0;

/// A check of a folder of footage, which works in another folder.
type Check = fn(&Path, &Path) -> Result<()>;

/// The trials: footage, its folder, and the check.
const TRIALS: [(&str, &str, Check); 3] = [
    ("photos_with_masks", "fox_clutter", photos_are_placed),
    ("video", "fox_clutter", frames_are_placed),
    ("rig_with_sound", "neu3d_flame_steak_still", rig_is_placed_and_synchronised),
];

/// All trials.
pub fn trials(root: Option<&Path>) -> Vec<Trial> {
    let trial = |(what, folder, check): (&'static str, &str, Check)| {
        let source = root.map(|root| root.join(folder)).filter(|path| path.is_dir());
        let reason = format!("there is no folder {folder}");
        Trial::ignorable_test(format!("prepare::{what}"), move || {
            let Some(source) = source else { return Ok(Completion::ignored_with(reason)) };
            if let Some(reason) = absent() {
                return Ok(Completion::ignored_with(reason));
            }
            let work = tempfile::tempdir()?;
            check(&source, work.path()).map_err(failed)?;
            Ok(Completion::Completed)
        })
    };
    TRIALS.map(trial).into()
}

/// The reason why this machine cannot run the trials; `None` if it can.
fn absent() -> Option<String> {
    let has_colmap = Command::new("colmap").arg("-h").output().is_ok();
    match (has_colmap, can_write_videos()) {
        (true, true) => None,
        (false, _) => Some("there is no program colmap".to_owned()),
        (true, false) => Some("there is no program ffmpeg".to_owned()),
    }
}

/// Prepares with a seed and one thread, and reads the scene.
fn prepared(input: &Path, out: &Path, more: &[&str]) -> Result<Scene> {
    let line = ["prepare", text(input)?, "--out", text(out)?, "--threads", "1", "--seed", "1", "--gpu", "off"];
    let said = mvfusion(&[&line[..], more].concat())?;
    ensure!(said.contains("placed ") && out.join("check.png").is_file(), "no report of the scene: {said}");
    Ok(open(out, &ReadOptions::default())?)
}

/// The cameras of all views, by a name that is made of the view's.
fn cameras(scene: &Scene, name: impl Fn(&str) -> String) -> BTreeMap<String, Camera> {
    scene.train.iter().chain(&scene.test).map(|view| (name(&view.name), view.camera)).collect()
}

/// Checks that at least `least` cameras were placed near their known poses, and none far off.
fn check(found: &BTreeMap<String, Camera>, known: &BTreeMap<String, Camera>, least: usize, axis: f64) -> Result<()> {
    let errors = PoseErrors::of(found, known, axis);
    eprintln!("{}", errors.describe());
    ensure!(errors.below(GOOD) >= least, "fewer than {least} cameras are within {GOOD:?}: {}", errors.describe());
    ensure!(errors.below(POOR) == errors.cameras.len(), "a camera is not within {POOR:?}: {}", errors.describe());
    Ok(())
}

/// Photos of the fox with people in front of it, in the order in which they were taken.
fn photos(fox: &Path) -> Vec<PathBuf> {
    (0..PHOTOS).map(|index| fox.join("images").join(format!("2clutter{index:03}.JPG"))).collect()
}

fn photos_are_placed(fox: &Path, work: &Path) -> Result<()> {
    let input = work.join("photos");
    fs::create_dir(&input)?;
    for photo in photos(fox) {
        fs::copy(&photo, input.join(photo.file_name().context("a name")?))?;
    }
    let masks = fox.join("masks_truth");
    let scene = prepared(&input, &work.join("scene"), &["--masks", text(&masks)?])?;
    let known = cameras(&open(fox, &ReadOptions::default())?, str::to_owned);
    check(&cameras(&scene, str::to_owned), &known, PHOTOS, AXIS)
}

/// Each photo is on for as long as a window, sharp in one of its frames and blurred in the others.
fn frames_are_placed(fox: &Path, work: &Path) -> Result<()> {
    const EACH: usize = 3;
    let (video, mut writer) = (work.join("walk.mp4"), None);
    for photo in photos(fox) {
        let sharp = image::open(&photo)?.into_rgb8();
        let blurred = image::imageops::blur(&sharp, 2.0);
        let size = sharp.dimensions();
        let writer = match &mut writer {
            Some(writer) => writer,
            none => none.insert(VideoWriter::create(&video, size, 30.0)?),
        };
        for frame in [&blurred, &sharp, &blurred] {
            writer.add(frame)?;
        }
    }
    writer.context("a video")?.finish()?;
    let scene = prepared(&video, &work.join("scene"), &["--fps", "10"])?;
    let record: Value = serde_json::from_slice(&fs::read(work.join("scene/prepare.json"))?)?;
    let wanted: Vec<usize> = (0..PHOTOS).map(|photo| EACH * photo + 1).collect();
    ensure!(record["frames"] == serde_json::json!(wanted), "these frames are not the sharp ones: {}", record["frames"]);
    let photo = |name: &str| {
        let index: usize = name.trim_start_matches("frame_").parse().unwrap_or(usize::MAX);
        format!("2clutter{:03}", index / EACH)
    };
    let known = cameras(&open(fox, &ReadOptions::default())?, str::to_owned);
    check(&cameras(&scene, photo), &known, PHOTOS * 9 / 10, AXIS)
}

/// Videos of one moment each, whose sounds begin at different times of one noise.
fn rig_is_placed_and_synchronised(rig: &Path, work: &Path) -> Result<()> {
    const LATER: f64 = 0.3;
    let input = work.join("rig");
    fs::create_dir(&input)?;
    let scene = open(rig, &ReadOptions::default())?;
    let known = cameras(&scene, |name| name.split('/').next().unwrap_or(name).to_owned());
    for (index, name) in known.keys().enumerate() {
        let start = if index == 1 { LATER } else { 0.0 };
        film(&rig.join(name).join("images/0000.jpg"), start, &input.join(format!("{name}.mp4")))?;
    }
    let out = work.join("scene");
    let scene = prepared(&input, &out, &["--sync", "sound"])?;
    let record: Value = serde_json::from_slice(&fs::read(out.join("prepare.json"))?)?;
    for (index, camera) in record["cameras"].as_array().context("cameras")?.iter().enumerate() {
        let offset = camera["offset"]["seconds"].as_f64().context("an offset")?;
        let wanted = if index == 1 { LATER } else { 0.0 };
        ensure!((offset - wanted).abs() < 0.01, "the offset of camera {index} is {offset} s and not {wanted} s");
    }
    let found = cameras(&scene, |name| name.split('/').next().unwrap_or(name).to_owned());
    check(&found, &known, known.len(), RIG_AXIS)
}

/// A video of two seconds that shows one image, and sounds like a noise from a time on.
fn film(image: &Path, start: f64, video: &Path) -> Result<()> {
    let sound = format!("[1:a]atrim=start={start},asetpts=PTS-STARTPTS[a]");
    let status = Command::new("ffmpeg")
        .args(["-v", "error", "-loop", "1", "-r", "10", "-i", text(image)?])
        .args(["-f", "lavfi", "-i", "anoisesrc=seed=7:duration=4:sample_rate=16000", "-filter_complex", &sound])
        .args(["-map", "0:v", "-map", "[a]", "-t", "2", "-vf", "crop=trunc(iw/2)*2:trunc(ih/2)*2", "-r", "10"])
        .args(["-c:v", "libx264", "-crf", "12", "-pix_fmt", "yuv420p", text(video)?])
        .status()?;
    ensure!(status.success(), "ffmpeg made no video of {}", image.display());
    Ok(())
}
