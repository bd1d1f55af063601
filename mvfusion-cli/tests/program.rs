//! The program as a user runs it: what it refuses, how it says so, and what it leaves behind.

use std::fs;
use std::path::Path;
use std::process::{Command, Output};

#[cfg(target_os = "linux")]
#[path = "program/disks.rs"]
mod disks;
#[path = "program/duration.rs"]
mod duration;
#[path = "program/evidence.rs"]
mod evidence;
#[path = "program/manuals.rs"]
mod manuals;
#[path = "program/output.rs"]
mod output;
#[cfg(unix)]
#[path = "program/prepare.rs"]
mod prepare;
#[path = "program/render.rs"]
mod render;
#[cfg(unix)]
#[path = "program/resume.rs"]
mod resume;
#[path = "program/scenes.rs"]
mod scenes;
#[cfg(unix)]
#[path = "program/strange.rs"]
mod strange;
#[cfg(unix)]
#[path = "program/sweep.rs"]
mod sweep;

/// Exit codes of the manual.
const FAILED: i32 = 1;
const USAGE: i32 = 2;

/// Settings that make a run of a few seconds which still passes through all stages.
const TINY: [&str; 9] = [
    "train.stages={geometry=2, deformation=2, refinement=2}",
    "train.log_interval=2",
    "train.batch_size=1",
    "model.width=8",
    "model.grid={features=2, resolution=[4, 4, 4, 4], multipliers=[1]}",
    "init.dynamic_points=60",
    "init.motion_points=60",
    "motion.samples=4",
    "eval.strips=2",
];

/// The program, which does not look for the LPIPS weights of whoever tests it.
fn program() -> Command {
    let mut command = Command::new(env!("CARGO_BIN_EXE_mvfusion"));
    command.env("MVFUSION_LPIPS", "none");
    command
}

fn mvfusion(folder: &Path, arguments: &[&str]) -> Output {
    program()
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
fn a_number_that_an_option_cannot_use_is_refused_with_an_example() {
    misused(&["train", "--threads", "0"], &["--threads", "1 or more, such as 4"]);
    misused(&["train", "--image-cache", "lots"], &["--image-cache", "512MB"]);
}

#[test]
fn a_misspelt_grid_is_a_usage_error_that_names_the_nearest() {
    for command in [["sweep", "component-small"].as_slice(), &["sweep", "show", "component-small"]] {
        refuses(command, USAGE, &["`components-small`?", "claim-small"]);
    }
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
    refuses(&["report", "no/run/here"], FAILED, &["no/run/here"]);
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
    fs::write(run.join("run.json"), r#"{ "burn": "1", "preset": "quickstart" }"#).expect("written");
    fs::write(run.join("results.json"), "precious").expect("written");
    let output = mvfusion(folder.path(), &["train"]);
    let said = text(&output.stderr);
    assert_eq!(output.status.code(), Some(FAILED), "{said}");
    assert!(said.contains("runs/quickstart-0") && said.contains("--force") && said.contains("--out"), "{said}");
    assert_eq!(fs::read_to_string(run.join("results.json")).expect("still there"), "precious");
}

#[test]
fn a_run_that_fails_at_its_first_step_takes_its_folder_with_it() {
    let folder = tempfile::tempdir().expect("folder");
    let made = mvfusion(folder.path(), &["synth", "scene", "--layout", "neu3d", "--size", "32x24", "--frames", "3"]);
    assert!(made.status.success(), "{}", text(&made.stderr));
    // The headers are sound, and the images are decoded during training.
    for camera in fs::read_dir(folder.path().join("scene")).expect("listed") {
        let Ok(images) = fs::read_dir(camera.expect("listed").path().join("images")) else { continue };
        for image in images {
            let path = image.expect("listed").path();
            let bytes = fs::read(&path).expect("read");
            fs::write(&path, &bytes[..bytes.len() - 100]).expect("cut");
        }
    }
    let settings = ["--data", "scene", "--out", "run", "--image-cache", "1B", "--set", "init.motion_points=0"];
    let output = train_tiny(folder.path(), &settings);
    let said = text(&output.stderr);
    assert_eq!(output.status.code(), Some(FAILED), "{said}");
    assert!(said.contains("cannot read the image") && !said.contains("panicked"), "{said}");
    assert!(!folder.path().join("run").exists());
}

#[test]
fn a_run_leaves_all_its_files_and_can_be_evaluated_again() {
    let folder = tempfile::tempdir().expect("folder");
    let output = train_tiny(folder.path(), &["--seed", "7", "--set", "train.checkpoint_interval=4"]);
    let table = text(&output.stdout);
    assert!(output.status.success(), "{}", text(&output.stderr));
    for word in [
        "composed",
        "static",
        "dynamic region (true masks)",
        "movers (true masks)",
        "dynamic - still",
        "mask IoU",
        "Gaussians",
        "runs/quickstart-7",
        "strips/",
        "report.html",
    ] {
        assert!(table.contains(word), "`{word}` is missing: {table}");
    }
    let run = folder.path().join("runs/quickstart-7");
    check_files(&run);
    check_results(&run);

    let again = mvfusion(folder.path(), &["eval", "runs/quickstart-7", "--speed-frames", "2"]);
    let said = text(&again.stdout);
    assert!(again.status.success(), "{}", text(&again.stderr));
    assert!(said.contains("The metrics equal those of runs/quickstart-7/results.json."), "{said}");
    assert!(said.contains("without MFTA, at 160x120 over 2 frames"), "{said}");

    check_replacements(folder.path(), &run);
    let report = fs::read(run.join("report.html")).expect("read");
    fs::remove_file(run.join("report.html")).expect("removed");
    let made = mvfusion(folder.path(), &["report", "runs/quickstart-7"]);
    assert!(made.status.success() && text(&made.stdout) == "runs/quickstart-7/report.html\n", "{}", text(&made.stderr));
    assert!(fs::read(run.join("report.html")).expect("read") == report, "made again, the report is another");

    let config = run.join("config.toml");
    let printed = mvfusion(folder.path(), &["config", "--config", config.to_str().expect("UTF-8")]);
    assert_eq!(text(&printed.stdout), fs::read_to_string(config).expect("read"));
}

/// Replaces the modules' outputs, and checks what is printed and written.
fn check_replacements(folder: &Path, run: &Path) {
    let replaced = mvfusion(folder, &["eval", "runs/quickstart-7", "--replace", "all", "--write"]);
    let said = text(&replaced.stdout);
    assert!(replaced.status.success(), "{}", text(&replaced.stderr));
    for word in ["as trained", "mvg=constant", "mfta=shuffled", "of the feature's norm", "entropy"] {
        assert!(said.contains(word), "`{word}` is missing: {said}");
    }
    let read = |name: &str| {
        let text = fs::read_to_string(run.join(name)).expect("read");
        serde_json::from_str::<serde_json::Value>(&text).expect("JSON")
    };
    let (results, replacements) = (read("results.json"), read("replacements.json"));
    assert_eq!(replacements["test"], results["test"], "the first row is the run as it is");
    assert_eq!(replacements["replaced"].as_array().map(Vec::len), Some(6));
    let norm = results["refinement"]["mvg"]["norm"].as_f64().expect("a number");
    assert!(norm > 0.0, "{}", results["refinement"]);
    let report = fs::read_to_string(run.join("report.html")).expect("read");
    assert!(report.contains("MFTA shuffled"), "the report shows the replacements");
}

#[test]
fn only_known_outputs_can_be_replaced() {
    for (replacement, words) in
        [("mvg=zero", "constant, mean and shuffled"), ("mga=mean", "mvg and mfta"), ("mvg", "mvg=constant")]
    {
        misused(&["eval", "run", "--replace", replacement], &[words]);
    }
}

#[test]
fn another_protocol_has_a_folder_of_its_own() {
    let folder = tempfile::tempdir().expect("folder");
    assert!(train_tiny(folder.path(), &["--out", "run", "--quiet"]).status.success());
    let own = fs::read(folder.path().join("run/results.json")).expect("read");
    let eval = ["eval", "run", "--protocol", "nerfbaselines", "--speed-frames", "1", "--write", "--quiet"];
    let first = text(&mvfusion(folder.path(), &eval).stdout);
    assert!(first.contains("There is no run/protocols/nerfbaselines/results.json"), "{first}");
    assert!(first.contains("absent (alex, vgg): no folder of weights was given"), "{first}");
    let read = |path: &str| {
        let text = fs::read_to_string(folder.path().join(path)).expect("read");
        serde_json::from_str::<serde_json::Value>(&text).expect("JSON")
    };
    let results = read("run/protocols/nerfbaselines/results.json");
    assert!(results["protocol"].as_str().is_some_and(|said| said.starts_with("nerfbaselines")), "{results}");
    assert_eq!(results["lpips"]["vgg"]["absent"], "no folder of weights was given");
    assert!(results["test"]["composed"].get("lpips_alex").is_none(), "never a made-up metric");
    assert_eq!(results["speed"]["frames"], 1);
    assert!(results["train"]["seconds"].is_number(), "the time of training is taken over");
    let composed = &results["test"]["composed"];
    assert_eq!((&results["ours_6"]["PSNR"], &results["ours_6"]["SSIM"]), (&composed["psnr"], &composed["ssim_valid"]));
    let views = read("run/protocols/nerfbaselines/per_view.json");
    assert_eq!(views["ours_6"]["PSNR"]["00003.png"], views["test"]["00003.png"]["composed"]["psnr"]);
    for hash in ["params_sha256", "config_sha256", "predictions_sha256", "photos_sha256"] {
        let now = results[hash].as_str().expect("a hash");
        assert_eq!((now.len(), now), (64, read("run/results.json")[hash].as_str().expect("a hash")), "{hash}");
    }
    let second = text(&mvfusion(folder.path(), &eval).stdout);
    assert!(second.contains("The metrics equal those of run/protocols/nerfbaselines/results.json."), "{second}");
    assert_eq!(fs::read(folder.path().join("run/results.json")).expect("read"), own, "ours are left alone");
}

#[test]
fn weights_that_cannot_be_used_are_found_before_training() {
    let folder = tempfile::tempdir().expect("folder");
    refuses(&["train", "--lpips-weights", "no/weights", "--quiet"], FAILED, &["no/weights", "--lpips-weights"]);
    let path = folder.path().to_str().expect("UTF-8");
    let none = ["--lpips-weights", path, "found no lpips_alex_f32.safetensors and no lpips_vgg_f32.safetensors"];
    refuses(&["train", "--lpips-weights", path, "--quiet"], FAILED, &none);
    refuses(&["eval", "no/run/here", "--lpips-weights", path], FAILED, &none);
    fs::write(folder.path().join("lpips_vgg_f32.safetensors"), "nonsense").expect("written");
    refuses(&["train", "--lpips-weights", path, "--quiet"], FAILED, &["lpips_vgg_f32.safetensors"]);
    let setting = format!("eval.lpips_weights={path}");
    refuses(&["train", "--set", &setting, "--quiet"], FAILED, &["lpips_vgg_f32.safetensors"]);
}

#[test]
fn a_run_is_exported_once_and_again_only_when_told_so_and_training_starts_from_it() {
    let folder = tempfile::tempdir().expect("folder");
    let trained = train_tiny(folder.path(), &["--out", "run", "--quiet"]);
    assert!(trained.status.success(), "{}", text(&trained.stderr));
    let export =
        |more: &[&str]| mvfusion(folder.path(), &[["export", "run", "--out", "out"].as_slice(), more].concat());
    let exported = export(&["--format", "ply,splat,inria,glb,4dgs", "--frames", "2"]);
    let said = text(&exported.stdout);
    assert!(exported.status.success(), "{}", text(&exported.stderr));
    assert!(said.contains("static.ply") && said.contains("Gaussians") && said.contains("out"), "{said}");
    assert_eq!(said.matches(" against `mvfusion render`").count(), 4, "{said}");
    let files = ["static.ply", "dynamic.ply", "scene.splat", "scene.glb", "scene.4dgs", "frames/frame0002.ply"];
    for file in files.into_iter().chain(["cameras.json", "cfg_args"]) {
        assert!(folder.path().join("out").join(file).is_file(), "{file} is missing");
    }
    let written = |file: &str| fs::read(folder.path().join(file)).expect("read");
    assert_eq!(written("out/static.ply"), written("run/point_cloud/iteration_6/static.ply"));
    assert_eq!(written("out/dynamic.ply"), written("run/point_cloud/iteration_6/dynamic.ply"));

    let again = export(&[]);
    assert_eq!(again.status.code(), Some(FAILED));
    assert!(text(&again.stderr).contains("--force"), "{}", text(&again.stderr));
    assert!(folder.path().join("out/frames/frame0002.ply").is_file(), "the export stays as it was");
    assert!(export(&["--force"]).status.success());
    let names = fs::read_dir(folder.path().join("out")).expect("listed").count();
    assert_eq!(names, 3, "static.ply, dynamic.ply and cameras.json alone are left");

    let files = ["init.static_ply=out/static.ply", "init.dynamic_ply=out/dynamic.ply"];
    let settings: Vec<&str> = files.iter().flat_map(|&setting| ["--set", setting]).collect();
    let further = train_tiny(folder.path(), &[settings.as_slice(), &["--out", "further", "--quiet"]].concat());
    assert!(further.status.success(), "{}", text(&further.stderr));
}

#[test]
fn what_cannot_be_exported_is_refused() {
    let out = ["--out", "out"];
    refuses(&[["export", "no/run/here"].as_slice(), &out].concat(), FAILED, &["no/run/here"]);
    let empty = tempfile::tempdir().expect("folder");
    let path = empty.path().to_str().expect("UTF-8");
    refuses(&[["export", path].as_slice(), &out].concat(), FAILED, &[path, "it is not a run"]);
    for time in ["1.5", "-0.1", "NaN", "soon"] {
        misused(&["export", path, "--out", "out", &format!("--time={time}")], &[time, "from 0 to 1"]);
    }
    for frames in ["0", "108001"] {
        misused(&["export", path, "--out", "out", "--frames", frames], &["--frames", "from 1 to 108000"]);
    }
    misused(&["export", path, "--out", "out", "--format", "obj"], &["obj", "splat"]);
    misused(&["export", path, "--out", "out", "--shared-static"], &["--frames"]);
    misused(&["export", path, "--out", "out", "--precision", "exact"], &["fine", "coarse"]);
    misused(&["export", path], &["--out"]);
    for unused in [["--samples", "3"], ["--precision", "fine"]] {
        refuses(&[["export", path].as_slice(), &out, &unused].concat(), USAGE, &[unused[0], "--format 4dgs"]);
        misused(&[["export", path, "--html"].as_slice(), &unused].concat(), &["--html", unused[0]]);
    }
    misused(&["prepare", "in", "--out", "scene", "--camera-model", "FOO"], &["FOO", "--camera-model"]);
    refuses(&[["export", path].as_slice(), &out, &["--format", "4dgs", "--time", "0.5"]].concat(), USAGE, &["--time"]);
    let foreign = empty.path().join("foreign.html");
    fs::write(&foreign, "<!DOCTYPE html>").expect("written");
    let html = format!("--html={}", foreign.display());
    refuses(&["export", path, &html, "--force"], FAILED, &["foreign.html", "was not written by", "--html=FILE"]);
}

/// Runs a command that the parser of the command line must refuse with these words; it adds a hint as a further
/// paragraph.
fn misused(arguments: &[&str], words: &[&str]) {
    let folder = tempfile::tempdir().expect("folder");
    let output = mvfusion(folder.path(), arguments);
    let said = text(&output.stderr);
    assert_eq!(output.status.code(), Some(USAGE), "{arguments:?}: {said}");
    assert!(words.iter().all(|word| said.contains(word)), "{words:?}: {said}");
    assert_eq!(fs::read_dir(folder.path()).expect("listed").count(), 0, "{arguments:?} left something behind");
}

#[test]
fn a_file_of_gaussians_that_cannot_be_used_is_found_before_training() {
    refuses(&["train", "--quiet", "--set", "init.static_ply=no/such.ply"], FAILED, &["no/such.ply"]);
    let folder = tempfile::tempdir().expect("folder");
    let file = folder.path().join("points.ply");
    let points =
        "ply\nformat ascii 1.0\nelement vertex 0\nproperty float x\nproperty float y\nproperty float z\nend_header\n";
    fs::write(&file, points).expect("written");
    let setting = format!("init.dynamic_ply={}", file.display());
    refuses(&["train", "--quiet", "--set", &setting], FAILED, &["points.ply", "`f_dc_0`"]);
    let branches = ["--preset", "quickstart-4dgs", "--set", "init.static_ply=a.ply"];
    refuses(
        &[["train", "--quiet"].as_slice(), &branches].concat(),
        USAGE,
        &["`init.static_ply`", "`init.dynamic_ply`"],
    );
}

fn check_files(run: &Path) {
    for file in [
        "config.toml",
        "run.json",
        "per_view.json",
        "scene.json",
        "checkpoints/step_4.safetensors",
        "checkpoints/final.safetensors",
        "point_cloud/iteration_6/static.ply",
        "point_cloud/iteration_6/dynamic.ply",
        "renders/test/gt/00000.png",
        "renders/test/true_background/00023.png",
        "renders/test/true_mask/00023.png",
        "renders/test/masked_static/00023.png",
        "renders/test/masked_dynamic/00023.png",
        "renders/test/motion/00023.png",
        "renders/test/depth/00023.png",
        "strips/panels.json",
        "strips/00000.png",
        "strips/00023.png",
        "report.html",
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
        "/test/dynamic_minus_still_psnr",
        "/test/movers/psnr",
        "/test/movers/ssim",
        "/test/mask_iou",
        "/gaussians/static",
        "/gaussians/dynamic",
        "/train/seconds",
        "/eval/seconds",
        "/params_sha256",
        "/device",
        "/threads",
    ] {
        assert!(results.pointer(pointer).is_some_and(|metric| !metric.is_null()), "{pointer} is missing: {json}");
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
