//! Disks that fill up, folders that become read-only, files that may not grow, and scenes that vanish for a while.
//!
//! What needs a disk of its own runs again in a process with its own mounts. Where the system allows none, it is not
//! tested, and says so.

use std::fs::{self, File};
use std::io::Write;
use std::path::Path;
use std::process::{Child, Command, Output, Stdio};

use super::resume::{arguments, outcome, signal, steps, wait_for_step, wait_until};
use super::{FAILED, mvfusion, program, text};

/// In a process with its own mounts: the empty disk.
const DISK: &str = "MVFUSION_TEST_DISK";

/// Mounts the disk, an ephemeral one of 8 MB.
const MOUNT: &str = "mount -t tmpfs -o size=8m none \"$1\"";

/// Enough steps that something happens in the middle.
const LONG: [&str; 2] = ["--set", "train.stages={geometry=20, deformation=20, refinement=40}"];

/// Runs the body with a disk of 8 MB. `test` is the name of the calling test within this file.
fn with_small_disk(test: &str, body: impl FnOnce(&Path)) {
    if let Some(disk) = std::env::var_os(DISK) {
        return body(Path::new(&disk));
    }
    let folder = tempfile::tempdir().expect("folder");
    let own_mounts = |kind: &str, script: &str| {
        let mut command = Command::new("unshare");
        command.args([kind, "sh", "-c", script, "sh"]).arg(folder.path()).env(DISK, folder.path());
        command
    };
    // As root, or as root of a user namespace.
    let can_mount = |kind: &&&str| own_mounts(kind, MOUNT).output().is_ok_and(|output| output.status.success());
    let Some(kind) = ["-m", "-rm"].iter().find(can_mount) else {
        // Past the test runner, which shows what is printed of failures alone.
        let _ = writeln!(std::io::stderr(), "NOT TESTED: {test}, because no disk can be mounted here");
        return;
    };
    let program = std::env::current_exe().expect("this program has a path");
    let script = format!("{MOUNT} && exec \"$2\" --exact \"disks::{test}\" --nocapture");
    let output = own_mounts(kind, &script).arg(program).output().expect("`unshare` starts");
    let log = text(&output.stdout) + &text(&output.stderr);
    assert!(output.status.success() && log.contains("1 passed"), "{log}");
}

/// Fills a disk. Removing the file frees it again.
fn fill(ballast: &Path) {
    let mut file = File::create(ballast).expect("made");
    for size in [1 << 16, 1 << 8, 1] {
        while file.write_all(&vec![0; size]).is_ok() {}
    }
}

fn ended(child: Child) -> (Option<i32>, String) {
    let Output { status, stderr, .. } = child.wait_with_output().expect("it ends");
    (status.code(), text(&stderr))
}

fn assert_says(said: &str, words: &[&str]) {
    assert!(!said.contains("panicked"), "{said}");
    words.iter().for_each(|word| assert!(said.contains(word), "`{word}` is missing: {said}"));
}

/// A small scene, whose checkpoints have some hundred kilobytes.
fn write_scene(place: &Path) {
    let synth = ["synth", "scene", "--layout", "neu3d", "--size", "48x36", "--frames", "3"];
    assert!(mvfusion(place, &synth).status.success());
    let fields = ["float x", "float y", "float z", "uchar red", "uchar green", "uchar blue"];
    let fields = fields.map(|field| format!("property {field}\n")).concat();
    let point = |i: i32| format!("{} {} {} {i} 90 200\n", i % 7 - 3, i % 5 - 2, i % 3);
    let points: String = (0..200).map(point).collect();
    let head = format!("ply\nformat ascii 1.0\nelement vertex 200\n{fields}end_header\n");
    fs::write(place.join("scene/points3D.ply"), head + &points).expect("written");
}

/// The words that train on that scene, aloud.
fn training<'a>(more: &[&'a str]) -> Vec<&'a str> {
    // Nothing is kept in memory.
    let of_scene = ["--data", "scene", "--image-cache", "0"];
    let words = arguments(&[&of_scene[..], &LONG, more].concat());
    words.into_iter().filter(|word| *word != "--quiet").collect()
}

fn start(place: &Path, words: &[&str]) -> Child {
    program()
        .args(words)
        .current_dir(place)
        .stderr(Stdio::piped())
        .stdout(Stdio::null())
        .spawn()
        .expect("the program starts")
}

/// Parameters and metrics of a run.
type Learned = (serde_json::Value, serde_json::Value);

/// Begins a run, which is terminated and saved after a few steps. Returns what the same run learns uninterrupted.
fn begun(place: &Path, run: &Path) -> Learned {
    write_scene(place);
    assert!(mvfusion(place, &training(&["--out", "whole"])).status.success());
    let child = start(place, &training(&["--out", run.to_str().expect("UTF-8")]));
    wait_for_step(run, 3);
    signal(&child, "-TERM");
    let (code, said) = ended(child);
    assert_eq!(code, Some(143), "{said}");
    outcome(&place.join("whole"))
}

fn assert_resumes(place: &Path, run: &Path, whole: &Learned) {
    let rest = mvfusion(place, &["train", "--resume", run.to_str().expect("UTF-8")]);
    assert!(rest.status.success(), "{}", text(&rest.stderr));
    assert_eq!(outcome(run), *whole);
    assert_eq!(steps(run), (1..=80).collect::<Vec<_>>());
    assert!(run.join("report.html").is_file());
}

/// Resumes with checkpoints after so many steps.
fn resume(place: &Path, run: &Path, interval: &str) -> Child {
    let interval = format!("train.checkpoint_interval={interval}");
    start(place, &["train", "--resume", run.to_str().expect("UTF-8"), "--set", &interval])
}

#[test]
fn a_disk_that_is_full_when_a_checkpoint_or_a_log_line_is_written_costs_nothing_that_was_saved() {
    with_small_disk(
        "a_disk_that_is_full_when_a_checkpoint_or_a_log_line_is_written_costs_nothing_that_was_saved",
        |disk| {
            let place = tempfile::tempdir().expect("folder");
            let (run, ballast) = (disk.join("run"), disk.join("ballast"));
            let whole = begun(place.path(), &run);
            // No checkpoint is due: it is a line of the log that finds no room.
            let logged = steps(&run).len();
            let child = resume(place.path(), &run, "1000");
            wait_for_step(&run, logged + 3);
            fill(&ballast);
            let (code, said) = ended(child);
            assert_eq!(code, Some(FAILED), "{said}");
            assert_says(
                &said,
                &["cannot write", "metrics.jsonl", "No space left", "Continue with: mvfusion train --resume"],
            );
            fs::remove_file(&ballast).expect("removed");
            // One is due at every step.
            let newest = || {
                let names =
                    fs::read_dir(run.join("checkpoints")).expect("listed").flatten().map(|entry| entry.file_name());
                let step = |name: &str| name.strip_prefix("step_")?.strip_suffix(".safetensors")?.parse::<usize>().ok();
                names.filter_map(|name| step(name.to_str()?)).max().expect("one was saved")
            };
            let saved = newest();
            let child = resume(place.path(), &run, "1");
            wait_until("two further checkpoints", || newest() >= saved + 2);
            fill(&ballast);
            let (code, said) = ended(child);
            assert_eq!(code, Some(FAILED), "{said}");
            assert_says(&said, &["No space left", "Continue with: mvfusion train --resume"]);
            fs::remove_file(&ballast).expect("removed");
            assert_resumes(place.path(), &run, &whole);
        },
    );
}

#[test]
fn a_disk_that_is_full_when_the_report_is_written_costs_the_report_alone() {
    with_small_disk("a_disk_that_is_full_when_the_report_is_written_costs_the_report_alone", |disk| {
        let place = tempfile::tempdir().expect("folder");
        let (run, ballast) = (disk.join("run"), disk.join("ballast"));
        let path = run.to_str().expect("UTF-8");
        // The first run tells how much room the second one needs, which therefore has one checkpoint alone.
        let words = training(&["--out", path, "--set", "train.checkpoint_minutes=0"]);
        write_scene(place.path());
        assert!(mvfusion(place.path(), &words).status.success());
        let whole = outcome(&run);
        fill(&ballast);
        let free = {
            fs::remove_file(run.join("report.html")).expect("removed");
            let used = fs::metadata(&ballast).expect("there").len();
            fs::remove_dir_all(&run).expect("removed");
            let mut more = File::options().append(true).open(&ballast).expect("opened");
            while more.write_all(&[0; 4096]).is_ok() {}
            fs::metadata(&ballast).expect("there").len() - used
        };
        // That room, less half of a report of at least 40 kB.
        let room = fs::metadata(&ballast).expect("there").len() - free + (20 << 10);
        File::options().write(true).open(&ballast).and_then(|file| file.set_len(room)).expect("shortened");
        let output = mvfusion(place.path(), &words);
        let said = text(&output.stderr);
        assert_eq!(output.status.code(), Some(FAILED), "{said}");
        assert_says(&said, &["cannot write", "report.html", "No space left"]);
        fs::remove_file(&ballast).expect("removed");
        assert_eq!(outcome(&run), whole);
        assert!(mvfusion(place.path(), &["report", path]).status.success());
    });
}

#[test]
fn a_run_that_becomes_read_only_stops_with_its_last_checkpoint() {
    with_small_disk("a_run_that_becomes_read_only_stops_with_its_last_checkpoint", |disk| {
        let place = tempfile::tempdir().expect("folder");
        let run = disk.join("run");
        let whole = begun(place.path(), &run);
        let logged = steps(&run).len();
        let child = resume(place.path(), &run, "2");
        wait_for_step(&run, logged + 3);
        let shell = |script: &str| {
            let status = Command::new("sh").args(["-c", script, "sh"]).arg(&run).status().expect("a shell");
            assert!(status.success(), "{script}");
        };
        shell("mount --bind \"$1\" \"$1\"");
        // Refused as long as a file is being written.
        shell("for i in $(seq 200); do mount -o remount,ro,bind \"$1\" && exit; sleep 0.05; done; exit 1");
        let (code, said) = ended(child);
        assert_eq!(code, Some(FAILED), "{said}");
        assert_says(
            &said,
            &["cannot", "checkpoints", "Read-only file system", "Continue with: mvfusion train --resume"],
        );
        shell("umount \"$1\"");
        assert_resumes(place.path(), &run, &whole);
    });
}

#[test]
fn a_scene_that_vanishes_for_a_while_stops_the_run_and_it_resumes() {
    let folder = tempfile::tempdir().expect("folder");
    let place = folder.path();
    write_scene(place);
    assert!(mvfusion(place, &training(&["--out", "whole"])).status.success());
    let child = start(place, &training(&["--out", "run", "--set", "train.checkpoint_interval=2"]));
    wait_for_step(&place.join("run"), 4);
    fs::rename(place.join("scene"), place.join("elsewhere")).expect("moved");
    let (code, said) = ended(child);
    assert_eq!(code, Some(FAILED), "{said}");
    assert_says(&said, &["cannot read the image", "scene/cam", "Continue with: mvfusion train --resume run"]);
    fs::rename(place.join("elsewhere"), place.join("scene")).expect("moved back");
    assert_resumes(place, &place.join("run"), &outcome(&place.join("whole")));
}

/// Runs the program with files limited to some blocks (512 or 1024 bytes, as the shell has it).
fn limited(folder: &Path, blocks: &str, arguments: &[&str]) -> Output {
    Command::new("sh")
        .args(["-c", "ulimit -f \"$0\" && exec \"$@\"", blocks, env!("CARGO_BIN_EXE_mvfusion")])
        .env("MVFUSION_LPIPS", "none")
        .args(arguments)
        .current_dir(folder)
        .output()
        .expect("a shell")
}

#[test]
fn files_that_may_not_grow_are_an_error_with_words_and_synth_leaves_nothing() {
    let folder = tempfile::tempdir().expect("folder");
    let output = limited(folder.path(), "2", &["synth", "deep/scene", "--layout", "colmap", "--size", "96x72"]);
    let said = text(&output.stderr);
    assert_eq!(output.status.code(), Some(FAILED), "{said}");
    assert_says(&said, &["cannot write", "deep/scene", "File too large"]);
    assert_eq!(fs::read_dir(folder.path()).expect("listed").count(), 0, "synth left something behind");

    write_scene(folder.path());
    let output = limited(folder.path(), "80", &training(&["--out", "run"]));
    let said = text(&output.stderr);
    assert_eq!(output.status.code(), Some(FAILED), "{said}");
    assert_says(&said, &["cannot write", "step_1.safetensors", "File too large"]);
}
