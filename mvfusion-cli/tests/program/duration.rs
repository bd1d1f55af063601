//! The time of a training, as `check` predicts it.

use std::fs;

use super::{TINY, mvfusion, text};

/// Writes a small scene and checks it with the settings of the tiny run.
fn checked(more: &[&str]) -> (serde_json::Value, String) {
    let folder = tempfile::tempdir().expect("folder");
    let made = mvfusion(folder.path(), &["synth", "scene", "--layout", "neu3d", "--size", "32x24", "--frames", "3"]);
    assert!(made.status.success(), "{}", text(&made.stderr));
    let settings = TINY.iter().flat_map(|setting| ["--set", setting]);
    let check = ["check", "scene", "--json", "--no-picture"].into_iter().chain(settings).chain(more.iter().copied());
    let output = mvfusion(folder.path(), &check.collect::<Vec<_>>());
    let said = text(&output.stderr);
    assert!(output.status.success(), "{said}");
    assert_eq!(fs::read_dir(folder.path()).expect("listed").count(), 1, "only the scene is there");
    (serde_json::from_slice(&output.stdout).expect("JSON"), said)
}

#[test]
fn check_predicts_the_time_of_every_stage_and_of_the_evaluation() {
    let (report, said) = checked(&["--device", "cpu", "--threads", "1"]);
    assert!(said.contains("--no-time"), "{said}");
    let time = &report["time"];
    let number = |value: &serde_json::Value| value.as_f64().expect("a number");
    let stages = time["stages"].as_array().expect("a list");
    let names: Vec<&str> = stages.iter().filter_map(|stage| stage["stage"].as_str()).collect();
    assert_eq!(names, ["geometry", "deformation", "refinement"]);
    let training: f64 = stages.iter().map(|stage| number(&stage["steps"]) * number(&stage["seconds_per_step"])).sum();
    let sum = number(&time["start"]) + training + number(&time["evaluation"]);
    assert!((number(&time["seconds"]) - sum).abs() < 1e-9 * sum, "{time}");
    assert!(stages.iter().all(|stage| number(&stage["dynamic"]) > 0.0 && number(&stage["static"]) > 0.0), "{time}");
    assert_eq!((time["threads"].as_u64(), time["device"].is_string()), (Some(1), true));
}

#[test]
fn nothing_is_trained_where_no_prediction_is_asked_for() {
    let (report, said) = checked(&["--no-time"]);
    assert!(report.get("time").is_none() && report["can_train"] == true, "{report}");
    assert!(!said.contains("predict"), "{said}");
}

#[test]
fn a_time_that_cannot_be_predicted_is_a_note() {
    let (report, said) = checked(&["--set", "eval.lpips_weights=\"no/weights\""]);
    assert!(report.get("time").is_none() && report["can_train"] == true, "{report}");
    assert!(said.contains("the time is not predicted") && said.contains("no/weights"), "{said}");
}
