//! The program as a user runs it: what it refuses, how it says so, and what it leaves behind.

use std::fs;
use std::path::Path;
use std::process::{Command, Output};

/// Exit codes of the manual.
const FAILED: i32 = 1;
const USAGE: i32 = 2;

/// Settings that make a run of a few seconds which still passes through all stages.
const TINY: [&str; 8] = [
    "train.stages={geometry=2, deformation=2, refinement=2}",
    "train.log_interval=2",
    "train.batch_size=1",
    "model.width=8",
    "model.grid={features=2, resolution=[4, 4, 4, 4], multipliers=[1]}",
    "init.dynamic_points=60",
    "motion.samples=4",
    "eval.strips=2",
];

fn mvfusion(folder: &Path, arguments: &[&str]) -> Output {
    Command::new(env!("CARGO_BIN_EXE_mvfusion"))
        .args(arguments)
        .current_dir(folder)
        .env_remove("RUST_LOG")
        // Mesa's OpenGL complains of its absence on the program's stderr.
        .env("XDG_RUNTIME_DIR", folder)
        .output()
        .expect("the program starts")
}

fn train_tiny(folder: &Path, more: &[&str]) -> Output {
    let settings = TINY.iter().flat_map(|setting| ["--set", setting]);
    mvfusion(folder, &["train"].into_iter().chain(settings).chain(more.iter().copied()).collect::<Vec<_>>())
}

fn text(bytes: &[u8]) -> String {
    String::from_utf8(bytes.to_vec()).expect("the program writes UTF-8")
}

/// Runs a command that must fail with this code, in one paragraph that holds these words, leaving nothing behind.
fn refuses(arguments: &[&str], code: i32, words: &[&str]) {
    let folder = tempfile::tempdir().expect("folder");
    let output = mvfusion(folder.path(), arguments);
    let said = text(&output.stderr);
    assert_eq!(output.status.code(), Some(code), "{arguments:?}: {said}");
    assert!(said.starts_with("error: ") && !said.contains("panicked"), "{said}");
    assert!(!said.trim_end().contains("\n\n"), "more than a paragraph: {said}");
    for word in words {
        assert!(said.contains(word), "`{word}` is missing: {said}");
    }
    assert_eq!(output.stdout, b"");
    assert_eq!(fs::read_dir(folder.path()).expect("listed").count(), 0, "{arguments:?} left something behind");
}

#[test]
fn an_unknown_key_is_a_usage_error_that_names_the_nearest() {
    refuses(&["train", "--set", "train.scael=0.1"], USAGE, &["`train.scael`", "`train.scale`"]);
    refuses(&["config", "--set", "train.scael=0.1"], USAGE, &["`train.scale`"]);
}

#[test]
fn a_bad_value_is_a_usage_error_that_says_what_would_be_right() {
    refuses(&["train", "--set", "model.width=wide"], USAGE, &["`model.width`", "whole number", "\"wide\""]);
    refuses(&["train", "--set", "train.scale=0"], USAGE, &["`train.scale`"]);
    refuses(&["train", "--set", "train.scale"], USAGE, &["--set"]);
}

#[test]
fn an_unknown_preset_is_a_usage_error_that_lists_them() {
    refuses(&["train", "--preset", "quickstrat"], USAGE, &["`quickstrat`", "`quickstart`", "neu3d"]);
}

#[test]
fn an_impossible_device_is_a_usage_error() {
    refuses(&["train", "--device", "tpu"], USAGE, &["`tpu`", "auto, cpu, flex, ndarray"]);
    for (device, built) in [("wgpu:1", cfg!(feature = "wgpu")), ("cuda", cfg!(feature = "cuda"))] {
        if !built {
            refuses(&["train", "--device", device], USAGE, &["build with `--features", "`--device cpu`"]);
        }
    }
}

#[test]
fn a_config_file_that_is_not_there_is_a_usage_error() {
    refuses(&["train", "--config", "none.toml"], USAGE, &["none.toml"]);
}

#[test]
fn a_missing_data_folder_is_a_failure_that_names_it() {
    refuses(&["train", "--data", "no/scene/here", "--quiet"], FAILED, &["no/scene/here"]);
    refuses(&["eval", "no/run/here"], FAILED, &["no/run/here"]);
}

#[test]
fn missing_masks_are_found_before_training() {
    refuses(&["train", "--set", "eval.dynamic_masks=no/masks", "--quiet"], FAILED, &["no/masks"]);
}

#[test]
fn an_empty_data_folder_is_a_failure_that_names_it() {
    let data = tempfile::tempdir().expect("folder");
    let path = data.path().to_str().expect("UTF-8");
    refuses(&["train", "--data", path, "--quiet"], FAILED, &[path, "poses_bounds.npy"]);
}

#[test]
fn a_folder_that_cannot_be_made_is_a_failure_before_any_work() {
    let folder = tempfile::tempdir().expect("folder");
    let file = folder.path().join("file");
    fs::write(&file, "x").expect("written");
    let out = file.join("run");
    refuses(&["train", "--quiet", "--out", out.to_str().expect("UTF-8")], FAILED, &["is a file", "--out"]);
}

#[test]
fn a_run_is_not_overwritten_unless_told_so() {
    let folder = tempfile::tempdir().expect("folder");
    let run = folder.path().join("runs/quickstart-0");
    fs::create_dir_all(&run).expect("made");
    fs::write(run.join("results.json"), "precious").expect("written");
    let output = mvfusion(folder.path(), &["train"]);
    let said = text(&output.stderr);
    assert_eq!(output.status.code(), Some(FAILED), "{said}");
    assert!(said.contains("runs/quickstart-0") && said.contains("--force") && said.contains("--out"), "{said}");
    assert_eq!(fs::read_to_string(run.join("results.json")).expect("still there"), "precious");
}

#[test]
fn a_run_that_diverges_takes_its_folder_with_it() {
    let folder = tempfile::tempdir().expect("folder");
    let output = train_tiny(folder.path(), &["--set", "loss.main=inf"]);
    let said = text(&output.stderr);
    assert_eq!(output.status.code(), Some(FAILED), "{said}");
    assert!(said.contains("loss is not finite") && !said.contains("panicked"), "{said}");
    assert_eq!(fs::read_dir(folder.path()).expect("listed").count(), 0);
}

#[test]
fn a_run_leaves_all_its_files_and_can_be_evaluated_again() {
    let folder = tempfile::tempdir().expect("folder");
    let output = train_tiny(folder.path(), &["--seed", "7", "--set", "train.checkpoint_interval=4"]);
    let table = text(&output.stdout);
    assert!(output.status.success(), "{}", text(&output.stderr));
    for word in ["composed", "static", "dynamic region", "mask IoU", "Gaussians", "runs/quickstart-7", "strips/"] {
        assert!(table.contains(word), "`{word}` is missing: {table}");
    }
    let run = folder.path().join("runs/quickstart-7");
    check_files(&run);
    check_results(&run);

    let again = mvfusion(folder.path(), &["eval", "runs/quickstart-7"]);
    let said = text(&again.stdout);
    assert!(again.status.success(), "{}", text(&again.stderr));
    assert!(said.contains("The figures are those of results.json."), "{said}");

    let config = run.join("config.toml");
    let printed = mvfusion(folder.path(), &["config", "--config", config.to_str().expect("UTF-8")]);
    assert_eq!(text(&printed.stdout), fs::read_to_string(config).expect("read"));
}

fn check_files(run: &Path) {
    for file in [
        "config.toml",
        "run.json",
        "per_view.json",
        "checkpoints/step_4.safetensors",
        "checkpoints/final.safetensors",
        "point_cloud/iteration_6/static.ply",
        "point_cloud/iteration_6/dynamic.ply",
        "renders/test/gt/00000.png",
        "renders/test/true_background/00023.png",
        "renders/test/true_mask/00023.png",
        "renders/test/motion/00023.png",
        "strips/00000.png",
        "strips/00023.png",
    ] {
        assert!(run.join(file).is_file(), "{file} is missing");
    }
    let metrics = fs::read_to_string(run.join("metrics.jsonl")).expect("read");
    let steps: Vec<u64> = metrics
        .lines()
        .map(|line| serde_json::from_str::<serde_json::Value>(line).expect("JSON")["step"].as_u64().expect("step"))
        .collect();
    assert_eq!(steps, [2, 4, 6]);
}

fn check_results(run: &Path) {
    let json = fs::read_to_string(run.join("results.json")).expect("read");
    let results: serde_json::Value = serde_json::from_str(&json).expect("JSON");
    for pointer in [
        "/protocol",
        "/test/composed/psnr",
        "/test/composed/ssim",
        "/test/static/psnr",
        "/test/static/ssim",
        "/test/dynamic_region/psnr",
        "/test/mask_iou",
        "/gaussians/static",
        "/gaussians/dynamic",
        "/train/seconds",
        "/eval/seconds",
        "/params_sha256",
        "/device",
        "/threads",
    ] {
        assert!(results.pointer(pointer).is_some_and(|figure| !figure.is_null()), "{pointer} is missing: {json}");
    }
    assert_eq!(results["train"]["steps"], 6);
    assert_eq!(results["seed"], 7);
}

#[test]
fn the_manual_page_names_layers_files_and_exit_codes() {
    let folder = tempfile::tempdir().expect("folder");
    let page = text(&mvfusion(folder.path(), &["train", "--help"]).stdout);
    for word in ["Examples:", "Configuration:", "Exit codes:", "results.json", "--set", "--force", "quickstart"] {
        assert!(page.contains(word), "`{word}` is missing");
    }
    let presets = text(&mvfusion(folder.path(), &["presets"]).stdout);
    assert!(presets.contains("quickstart") && presets.contains("neu3d"));
}

#[test]
fn devices_are_listed_and_one_that_is_not_there_is_refused_with_those_that_are() {
    let folder = tempfile::tempdir().expect("folder");
    let output = mvfusion(folder.path(), &["devices"]);
    let listed = text(&output.stdout);
    assert_eq!(output.status.code(), Some(0), "{}", text(&output.stderr));
    for (feature, name) in [(cfg!(feature = "flex"), "flex "), (cfg!(feature = "ndarray"), "ndarray ")] {
        assert_eq!(listed.lines().any(|line| line.starts_with(name)), feature, "{listed}");
    }
    let gpus: Vec<&str> =
        listed.lines().filter(|line| line.starts_with("wgpu:") || line.starts_with("cuda:")).collect();
    assert_eq!(gpus.is_empty(), listed.contains("no GPU"), "{listed}");
    let there = gpus.first().and_then(|line| line.split(' ').next()).unwrap_or("no GPU");
    refuses(&["train", "--device", "wgpu:99"], USAGE, &["`--device wgpu", there]);
}

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
        let checked = mvfusion(folder.path(), &["check", layout, "--json"]);
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
    assert!(text(&output.stderr).contains("training could not start"), "{}", text(&output.stderr));
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
}
