//! `mvfusion prepare`, with a script in the place of COLMAP, and a signal while it runs.

use std::fs;
use std::os::unix::fs::PermissionsExt;
use std::process::{Command, Stdio};

use super::output::events;
use super::resume::{signal, wait_until};
use super::{mvfusion, program, text};

/// Answers as COLMAP does, and finds features for longer than a test waits. Its process is in the file `process`.
const COLMAP: &str = r#"#!/bin/sh
case "$1 $2" in
-h*) echo "COLMAP 3.13.0 -- Structure-from-Motion and Multi-View Stereo" ;;
*-h) ;;
feature_extractor*) echo $$ > process; exec sleep 600 ;;
esac
"#;

#[test]
fn a_preparation_that_is_terminated_ends_colmap_and_leaves_nothing() {
    let folder = tempfile::tempdir().expect("folder");
    let place = folder.path();
    let made = mvfusion(place, &["synth", "known", "--layout", "colmap", "--size", "32x24", "--photos", "4"]);
    assert!(made.status.success(), "{}", text(&made.stderr));
    let colmap = place.join("colmap");
    fs::write(&colmap, COLMAP).expect("written");
    fs::set_permissions(&colmap, fs::Permissions::from_mode(0o755)).expect("made a program");
    let child = program()
        .args(["prepare", "known/images", "--out", "scene", "--gpu", "off", "--progress", "json", "--colmap"])
        .arg(&colmap)
        .current_dir(place)
        .stderr(Stdio::piped())
        .stdout(Stdio::null())
        .spawn()
        .expect("the program starts");
    let process = || fs::read_to_string(place.join("process")).unwrap_or_default().trim().to_owned();
    wait_until("COLMAP's process", || !process().is_empty());
    signal(&child, "-TERM");
    let output = child.wait_with_output().expect("it ends");
    assert_eq!(output.status.code(), Some(143), "{}", text(&output.stderr));
    let said = events(&output.stderr);
    let end = said.last().expect("a line");
    assert_eq!((&end["status"], &end["exit_code"]), (&"interrupted".into(), &143.into()), "{end}");
    let names = fs::read_dir(place).expect("listed").map(|entry| entry.expect("an entry").file_name());
    let mut names: Vec<_> = names.collect();
    names.sort();
    assert_eq!(names, ["colmap", "known", "process"]);
    let asked = Command::new("kill").args(["-0", &process()]).stderr(Stdio::null()).status().expect("`kill` starts");
    assert!(!asked.success(), "COLMAP still runs");
}
