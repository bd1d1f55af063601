//! Interrupted and killed trainings, and what comes of them.

use std::fs;
use std::path::Path;
use std::process::{Child, Command, Stdio};
use std::time::{Duration, Instant};

use serde_json::Value;

use super::{TINY, USAGE, mvfusion, program, text};

/// Enough steps that a signal arrives in the middle.
const STEPS: &str = "train.stages={geometry=6, deformation=6, refinement=12}";

/// The longest that a test waits for something.
const PATIENCE: Duration = Duration::from_secs(120);

pub(super) fn arguments<'a>(more: &[&'a str]) -> Vec<&'a str> {
    let settings = TINY.into_iter().chain([STEPS, "train.log_interval=1"]).flat_map(|setting| ["--set", setting]);
    ["train", "--quiet"].into_iter().chain(settings).chain(more.iter().copied()).collect()
}

fn started(folder: &Path, more: &[&str]) -> Child {
    program()
        .args(arguments(more))
        .current_dir(folder)
        .stderr(Stdio::piped())
        .stdout(Stdio::null())
        .spawn()
        .expect("the program starts")
}

pub(super) fn wait_until(what: &str, is_so: impl Fn() -> bool) {
    let started = Instant::now();
    while !is_so() {
        assert!(started.elapsed() < PATIENCE, "waited for this in vain: {what}");
        std::thread::sleep(Duration::from_millis(5));
    }
}

/// Waits until a run has logged this many steps.
pub(super) fn wait_for_step(run: &Path, steps: usize) {
    let logged = || fs::read_to_string(run.join("metrics.jsonl")).unwrap_or_default().lines().count();
    wait_until(&format!("step {steps} of {}", run.display()), || logged() >= steps);
}

pub(super) fn signal(child: &Child, name: &str) {
    let sent = Command::new("kill").args([name, &child.id().to_string()]).status().expect("`kill` starts");
    assert!(sent.success());
}

/// What a run learned and what came of it.
pub(super) fn outcome(run: &Path) -> (Value, Value) {
    let text = fs::read_to_string(run.join("results.json")).expect("the run is finished");
    let results: Value = serde_json::from_str(&text).expect("JSON");
    (results["params_sha256"].clone(), results["test"].clone())
}

/// The steps of `metrics.jsonl`.
pub(super) fn steps(run: &Path) -> Vec<u64> {
    let text = fs::read_to_string(run.join("metrics.jsonl")).expect("a log");
    let step = |line: &str| serde_json::from_str::<Value>(line).expect("JSON")["step"].as_u64().expect("a step");
    text.lines().map(step).collect()
}

#[cfg(all(feature = "flex", feature = "ndarray"))]
#[test]
fn a_run_goes_on_on_its_own_device_unless_another_one_is_asked_for() {
    let folder = tempfile::tempdir().expect("folder");
    let place = folder.path();
    let device = || {
        let results = fs::read(place.join("part/results.json")).expect("the run is finished");
        serde_json::from_slice::<Value>(&results).expect("JSON")["device"].clone()
    };
    assert!(mvfusion(place, &arguments(&["--out", "part", "--device", "ndarray"])).status.success());
    let longer = |steps: &str, more: &[&str]| {
        let stage = format!("train.stages.refinement={steps}");
        let output = mvfusion(place, &[&["train", "--resume", "part", "--set", &stage][..], more].concat());
        assert!(output.status.success(), "{}", text(&output.stderr));
        text(&output.stderr)
    };
    longer("13", &[]);
    assert_eq!(device(), "ndarray");
    let said = longer("14", &["--device", "flex"]);
    assert!(said.contains("was trained on `ndarray` and goes on on `flex`"), "{said}");
    assert_eq!(device(), "flex");
}

#[test]
fn a_run_that_was_terminated_and_killed_ends_as_if_nothing_had_been() {
    let folder = tempfile::tempdir().expect("folder");
    let place = folder.path();
    assert!(mvfusion(place, &arguments(&["--out", "whole"])).status.success());

    // Terminated: it saves, and says how to go on.
    let child = started(place, &["--out", "part", "--set", "train.tensorboard=true"]);
    wait_for_step(&place.join("part"), 2);
    signal(&child, "-TERM");
    let output = child.wait_with_output().expect("it ends");
    let said = text(&output.stderr);
    assert_eq!(output.status.code(), Some(143), "{said}");
    assert!(said.contains("of 24, and saved. Continue with: mvfusion train --resume part"), "{said}");

    // What is there can be looked at.
    let eval = mvfusion(place, &["eval", "part", "--speed-frames", "0"]);
    assert!(eval.status.success() && text(&eval.stderr).contains("unfinished"), "{}", text(&eval.stderr));

    // Another method is refused, with both values.
    let other = mvfusion(place, &["train", "--resume", "part", "--set", "loss.main=2.5"]);
    let said = text(&other.stderr);
    assert_eq!(other.status.code(), Some(USAGE), "{said}");
    assert!(said.contains("`loss.main` = 2.5: the run has 1.0"), "{said}");

    // Killed: the newest checkpoint is there.
    let mut child = program()
        .args(["train", "--quiet", "--resume", "part", "--set", "train.checkpoint_interval=3", "--threads", "1"])
        .current_dir(place)
        .spawn()
        .expect("the program starts");
    wait_for_step(&place.join("part"), 16);
    child.kill().expect("it is running");
    child.wait().expect("it ends");

    let rest = mvfusion(place, &["train", "--resume", "part"]);
    assert!(rest.status.success(), "{}", text(&rest.stderr));
    // Event files, of which each process writes one, change nothing.
    assert_eq!(fs::read_dir(place.join("part/tensorboard")).expect("listed").count(), 3);
    assert!(!place.join("whole/tensorboard").exists());
    assert_eq!(outcome(&place.join("part")), outcome(&place.join("whole")));
    assert_eq!(steps(&place.join("part")), (1..=24).collect::<Vec<_>>());

    let again = mvfusion(place, &["train", "--resume", "part"]);
    assert_eq!(again.status.code(), Some(USAGE));
    assert!(text(&again.stderr).contains("is finished: there is nothing to resume"));

    // A finished run can be trained longer, not shorter.
    let lengthened = |steps: &str| {
        mvfusion(place, &["train", "--quiet", "--resume", "part", "--set", &format!("train.stages.refinement={steps}")])
    };
    let shorter = lengthened("11");
    assert_eq!(shorter.status.code(), Some(USAGE));
    assert!(text(&shorter.stderr).contains("`train.stages.refinement` = 11: the run has 12"));
    let longer = lengthened("14");
    assert!(longer.status.success(), "{}", text(&longer.stderr));
    assert_eq!(steps(&place.join("part")), (1..=26).collect::<Vec<_>>());
    assert_ne!(outcome(&place.join("part")), outcome(&place.join("whole")));

    // Its weights begin another run.
    let config = ["--config", "whole/config.toml", "--set", "train.stages={geometry=1, deformation=1, refinement=1}"];
    let tuned = mvfusion(place, &[&["train", "--init-from", "whole", "--out", "tuned"][..], &config].concat());
    assert!(tuned.status.success(), "{}", text(&tuned.stderr));
    let record: Value =
        serde_json::from_slice(&fs::read(place.join("tuned/run.json")).expect("a record")).expect("JSON");
    assert_eq!(record["init_from"]["params_sha256"], outcome(&place.join("whole")).0);
    // A file with Gaussians is needed once.
    fs::copy(place.join("whole/point_cloud/iteration_24/static.ply"), place.join("room.ply")).expect("copied");
    let begun = mvfusion(place, &arguments(&["--out", "begun", "--set", "init.static_ply=room.ply"]));
    assert!(begun.status.success(), "{}", text(&begun.stderr));
    fs::remove_file(place.join("room.ply")).expect("removed");
    let longer = mvfusion(place, &["train", "--resume", "begun", "--set", "train.stages.refinement=13"]);
    assert!(longer.status.success(), "{}", text(&longer.stderr));
    let other = mvfusion(place, &["train", "--init-from", "whole", "--out", "other"]);
    let said = text(&other.stderr);
    assert!(!other.status.success() && said.contains("--config whole/config.toml uses its own"), "{said}");
    assert!(!place.join("other").exists());
}

#[test]
fn a_run_that_was_terminated_while_it_was_evaluated_says_how_to_go_on() {
    let folder = tempfile::tempdir().expect("folder");
    let run = folder.path().join("run");
    // Hundreds of views, so that the signal arrives among them.
    let child = started(folder.path(), &["--out", "run", "--set", "eval.training_views=true"]);
    let exported = run.join("point_cloud/iteration_24/dynamic.ply");
    wait_until("the last step", || exported.is_file());
    signal(&child, "-TERM");
    let output = child.wait_with_output().expect("it ends");
    let said = text(&output.stderr);
    assert_eq!(output.status.code(), Some(143), "{said}");
    assert!(said.contains("after step 24 of 24, and saved. Continue with: mvfusion train --resume run"), "{said}");
    assert!(!run.join("results.json").exists());

    let rest = mvfusion(folder.path(), &["train", "--resume", "run", "--set", "eval.training_views=false"]);
    assert!(rest.status.success(), "{}", text(&rest.stderr));
    outcome(&run);
}

#[test]
fn a_closed_stderr_does_not_end_a_training() {
    let folder = tempfile::tempdir().expect("folder");
    let mut child = program()
        .args(arguments(&["--out", "run"]).into_iter().filter(|argument| *argument != "--quiet"))
        .current_dir(folder.path())
        .stderr(Stdio::piped())
        .stdout(Stdio::piped())
        .spawn()
        .expect("the program starts");
    // Nobody reads any more.
    drop((child.stderr.take(), child.stdout.take()));
    assert!(child.wait().expect("it ends").success());
    outcome(&folder.path().join("run"));
    assert!(folder.path().join("run/report.html").is_file());
}

#[test]
fn a_replaced_run_waits_for_the_end_of_the_new_one_or_comes_back() {
    let folder = tempfile::tempdir().expect("folder");
    let place = folder.path();
    assert!(mvfusion(place, &arguments(&["--out", "run", "--seed", "1"])).status.success());
    let old = outcome(&place.join("run"));
    let replace = || {
        let mut child = started(place, &["--out", "run", "--force", "--set", "train.checkpoint_interval=2"]);
        // Until then, the log is that of the old run.
        wait_until("the old run is moved aside", || place.join("run/.replaced/metrics.jsonl").is_file());
        wait_for_step(&place.join("run"), 8);
        child.kill().expect("it is running");
        child.wait().expect("it ends");
    };
    replace();
    let eval = mvfusion(place, &["eval", "run", "--speed-frames", "0"]);
    assert!(text(&eval.stderr).contains("mvfusion restore run"), "{}", text(&eval.stderr));
    let refused = mvfusion(place, &["restore", "run"]);
    assert!(!refused.status.success() && text(&refused.stderr).contains("mvfusion train --resume run"));
    assert!(mvfusion(place, &["restore", "run", "--force"]).status.success());
    assert_eq!(outcome(&place.join("run")), old);

    replace();
    let rest = mvfusion(place, &["train", "--resume", "run"]);
    assert!(rest.status.success(), "{}", text(&rest.stderr));
    assert!(!place.join("run/.replaced").exists());
    assert_ne!(outcome(&place.join("run")), old);
}
