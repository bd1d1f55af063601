//! Scenes that `synth` writes, and what `check` says of scenes.

use std::fs;

use super::{FAILED, USAGE, mvfusion, text, train_tiny};

/// The layouts that `synth` writes, and the format as which `check` must recognise each.
const LAYOUTS: [(&str, &str); 10] = [
    ("neu3d", "neu3d"),
    ("panoptic", "panoptic"),
    ("nerfstudio", "nerfstudio"),
    ("multipleview", "multipleview"),
    ("dnerf", "dnerf"),
    ("hypernerf", "hypernerf"),
    ("colmap", "colmap"),
    ("onthego", "onthego"),
    ("onthego-colmap", "colmap"),
    ("robustnerf", "colmap"),
];

#[test]
fn every_layout_that_is_written_is_found_sound() {
    let folder = tempfile::tempdir().expect("folder");
    for (layout, format) in LAYOUTS {
        let small = ["--size", "64x48", "--frames", "4", "--photos", "8"];
        let written = mvfusion(folder.path(), &[["synth", layout, "--layout", layout].as_slice(), &small].concat());
        assert!(written.status.success(), "{layout}: {}", text(&written.stderr));
        let checked = mvfusion(folder.path(), &["check", layout, "--json", "--no-time"]);
        assert!(checked.status.success(), "{layout}: {}", text(&checked.stderr));
        let report: serde_json::Value = serde_json::from_slice(&checked.stdout).expect("JSON");
        assert_eq!(report["format"], format, "{layout}");
        assert_eq!(report["can_train"], true, "{layout}");
        let problems = report["problems"].as_array().expect("a list");
        // The layout's own held-out frames are trained on as well, and nothing else is worth a warning.
        let is_known = |problem: &&serde_json::Value| layout == "multipleview" && problem["subject"] == "split";
        let bad = problems.iter().filter(|problem| problem["severity"] != "note").find(|problem| !is_known(problem));
        assert!(bad.is_none(), "{layout}: {bad:?}");
        assert!(report["memory"]["start"].as_f64().is_some_and(|bytes| bytes > 1e6), "{layout}");
        let picture = folder.path().join(format!("check-{layout}.png"));
        assert!(image::open(&picture).is_ok_and(|sheet| sheet.width() > 64), "{layout}");
    }
}

#[test]
fn what_is_no_scene_is_refused_by_check_with_all_that_was_tried() {
    let folder = tempfile::tempdir().expect("folder");
    fs::write(folder.path().join("notes.txt"), "nothing").expect("written");
    let output = mvfusion(folder.path(), &["check", "."]);
    assert_eq!(output.status.code(), Some(FAILED));
    let said = text(&output.stdout);
    for format in ["COLMAP", "D-NeRF", "Neu3D", "HyperNeRF", "Panoptic", "MultipleView", "On-the-go", "nerfstudio"] {
        assert!(said.contains(format), "{format}: {said}");
    }
    assert!(text(&output.stderr).contains("training cannot start"), "{}", text(&output.stderr));
}

#[test]
fn a_broken_picture_is_found_by_check_before_training_is() {
    let folder = tempfile::tempdir().expect("folder");
    let small = ["--size", "48x36", "--frames", "3"];
    mvfusion(folder.path(), &[["synth", "scene", "--layout", "neu3d"].as_slice(), &small].concat());
    let frame = folder.path().join("scene/cam02/images/0001.png");
    let bytes = fs::read(&frame).expect("read");
    fs::write(&frame, &bytes[..bytes.len() / 2]).expect("written");
    let output = mvfusion(folder.path(), &["check", "scene"]);
    assert_eq!(output.status.code(), Some(FAILED));
    assert!(text(&output.stdout).contains("0001.png"), "{}", text(&output.stdout));
    let output = train_tiny(folder.path(), &["--data", "scene"]);
    assert_eq!(output.status.code(), Some(FAILED));
    assert!(text(&output.stderr).contains("0001.png"), "{}", text(&output.stderr));
    assert!(!folder.path().join("runs").exists(), "a run was begun");
}

#[test]
fn nothing_is_overwritten_by_synth() {
    let folder = tempfile::tempdir().expect("folder");
    fs::create_dir(folder.path().join("full")).expect("made");
    fs::write(folder.path().join("full/notes.txt"), "mine").expect("written");
    let output = mvfusion(folder.path(), &["synth", "full", "--layout", "colmap"]);
    assert_eq!(output.status.code(), Some(FAILED));
    assert!(text(&output.stderr).contains("not empty"), "{}", text(&output.stderr));
    assert_eq!(fs::read_dir(folder.path().join("full")).expect("listed").count(), 1);
}

#[test]
fn synth_writes_the_scene_that_is_asked_for() {
    let folder = tempfile::tempdir().expect("folder");
    let write = |scene: &str, layout: &str| {
        let small = ["--layout", layout, "--size", "32x24", "--frames", "2", "--photos", "4"];
        mvfusion(folder.path(), &[["synth", scene, "--scene", scene].as_slice(), &small].concat())
    };
    for scene in ["video", "motion"] {
        let output = write(scene, "neu3d");
        assert!(output.status.success(), "{}", text(&output.stderr));
    }
    let frame = |scene: &str| fs::read(folder.path().join(scene).join("cam02/images/0001.png")).expect("read");
    assert_ne!(frame("video"), frame("motion"));
    let output = write("casual", "neu3d");
    assert_eq!(output.status.code(), Some(FAILED));
    assert!(text(&output.stderr).contains("for videos"), "{}", text(&output.stderr));
    assert!(!folder.path().join("casual").exists(), "a scene was begun");
}

#[test]
fn an_unknown_layout_is_a_usage_error_that_lists_them() {
    let folder = tempfile::tempdir().expect("folder");
    let output = mvfusion(folder.path(), &["synth", "x", "--layout", "betamax"]);
    let said = text(&output.stderr);
    assert_eq!(output.status.code(), Some(USAGE), "{said}");
    assert!(said.contains("betamax") && said.contains("hypernerf"), "{said}");
    assert_eq!(fs::read_dir(folder.path()).expect("listed").count(), 0);
}

#[test]
fn check_finds_what_train_would_refuse() {
    let folder = tempfile::tempdir().expect("folder");
    let small = ["--size", "48x36", "--frames", "3"];
    mvfusion(folder.path(), &[["synth", "scene", "--layout", "neu3d"].as_slice(), &small].concat());
    let masks = ["--set", "eval.dynamic_masks=no/masks"];
    let output = mvfusion(folder.path(), &[["check", "scene", "--quick"].as_slice(), &masks].concat());
    assert_eq!(output.status.code(), Some(FAILED));
    assert!(text(&output.stdout).contains("no/masks"), "{}", text(&output.stdout));
    assert_eq!(train_tiny(folder.path(), &[["--data", "scene"], masks].concat()).status.code(), Some(FAILED));
    let gaussians = ["--set", "init.static_ply=no/such.ply", "--json"];
    let output = mvfusion(folder.path(), &[["check", "scene", "--quick"].as_slice(), &gaussians].concat());
    assert_eq!(output.status.code(), Some(FAILED));
    assert!(text(&output.stderr).contains("no/such.ply"), "{}", text(&output.stderr));
    assert!(text(&output.stdout).contains("\"can_train\": false"), "{}", text(&output.stdout));
}
