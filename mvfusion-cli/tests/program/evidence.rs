//! Runs whose checkpoint, configuration or images are no longer those that their results describe.

use std::collections::BTreeMap;
use std::fs;
use std::path::Path;

use super::{FAILED, USAGE, mvfusion, text, train_tiny};

const CHECKPOINT: &str = "run/checkpoints/final.safetensors";

/// Adds a step to the last stage of a tiny run.
const LONGER: &str = "train.stages.refinement=3";

/// The bytes of all files that an evaluation may write.
fn contents(run: &Path) -> BTreeMap<String, Vec<u8>> {
    let mut found = BTreeMap::new();
    for folder in ["", "strips", "protocols"] {
        let Ok(entries) = fs::read_dir(run.join(folder)) else { continue };
        for path in entries.map(|entry| entry.expect("listed").path()).filter(|path| path.is_file()) {
            found.insert(path.display().to_string(), fs::read(&path).expect("read"));
        }
    }
    found
}

fn recorded(run: &Path) -> serde_json::Value {
    serde_json::from_str(&fs::read_to_string(run.join("results.json")).expect("read")).expect("JSON")
}

#[test]
fn the_results_of_a_run_that_changed_are_never_overwritten() {
    let folder = tempfile::tempdir().expect("folder");
    let place = folder.path();
    for (out, seed) in [("run", "1"), ("other", "2")] {
        let trained = train_tiny(place, &["--quiet", "--out", out, "--seed", seed]);
        assert!(trained.status.success(), "{}", text(&trained.stderr));
    }
    let run = place.join("run");
    let before = contents(&run);
    // What is refused says these words, and changes nothing.
    let refused = |arguments: &[&str], code: i32, words: &[&str]| {
        let output = mvfusion(place, arguments);
        let said = text(&output.stderr);
        assert_eq!(output.status.code(), Some(code), "{arguments:?}: {said}");
        assert!(said.contains("error: ") && !said.contains("panicked"), "{said}");
        for word in words {
            assert!(said.contains(word), "{arguments:?}: `{word}` is missing: {said}");
        }
        text(&output.stdout)
    };

    let own = fs::read(place.join(CHECKPOINT)).expect("read");
    fs::copy(place.join("other/checkpoints/final.safetensors"), place.join(CHECKPOINT)).expect("copied");
    let [written, now] = ["run", "other"].map(|run| recorded(&place.join(run))["params_sha256"].to_string());
    let hashes = [written.trim_matches('"'), now.trim_matches('"'), "run/results.json"];
    for protocol in ["mvfusion", "3dgs"] {
        let eval = ["eval", "run", "--speed-frames", "0", "--protocol", protocol];
        refused(&[eval.as_slice(), &["--write"]].concat(), FAILED, &hashes);
        let table = refused(&eval, FAILED, &hashes);
        assert!(table.contains("composed"), "without --write, the table is printed first: {table}");
        assert!(contents(&run) == before, "{protocol}: a file has changed");
    }

    let mut damaged = own.clone();
    let middle = damaged.len() / 2;
    damaged[middle] ^= 1;
    fs::write(place.join(CHECKPOINT), damaged).expect("written");
    for command in [["eval", "run"].as_slice(), &["render", "run"], &["export", "run", "--out", "out"]] {
        refused(command, FAILED, &["final.safetensors", "damaged", "was written as", "is now"]);
    }
    fs::write(place.join(CHECKPOINT), own).expect("written");

    let config = run.join("config.toml");
    let original = fs::read_to_string(&config).expect("read");
    fs::write(&config, format!("# Looked at.\n{original}")).expect("written");
    let eval = ["eval", "run", "--speed-frames", "0"];
    refused(&[eval.as_slice(), &["--write"]].concat(), FAILED, &["config.toml is not what run/results.json describes"]);
    let output = mvfusion(place, &eval);
    assert!(output.status.success(), "{}", text(&output.stderr));
    assert!(text(&output.stderr).contains("config.toml is not what run/results.json describes"));
    fs::write(&config, original.replace("samples = 4", "samples = 0")).expect("written");
    refused(&eval, USAGE, &["config.toml", "`motion.samples` is 0"]);
    fs::write(&config, original).expect("written");

    assert!(contents(&run) == before, "a file has changed");
    let output = mvfusion(place, &[eval.as_slice(), &["--write"]].concat());
    assert!(output.status.success() && !text(&output.stderr).contains("is not what"), "{}", text(&output.stderr));
}

#[test]
fn a_run_is_neither_written_to_nor_resumed_with_the_images_of_another_scene() {
    let folder = tempfile::tempdir().expect("folder");
    let place = folder.path();
    for (scene, seed) in [("scene", "1"), ("other", "2")] {
        let small = ["--layout", "neu3d", "--size", "48x36", "--frames", "3", "--seed", seed];
        let made = mvfusion(place, &[&["synth", scene][..], &small].concat());
        assert!(made.status.success(), "{}", text(&made.stderr));
    }
    let still = ["--set", "init.motion_points=0", "--set", "eval.pictures=false"];
    let trained = train_tiny(place, &[&["--quiet", "--data", "scene", "--out", "run"][..], &still].concat());
    assert!(trained.status.success(), "{}", text(&trained.stderr));
    let run = place.join("run");
    let before = contents(&run);
    let eval = |data, more: &[&str]| {
        mvfusion(place, &[&["eval", "run", "--speed-frames", "0", "--data", data][..], more].concat())
    };
    let resume = |data| mvfusion(place, &["train", "--resume", "run", "--data", data, "--set", LONGER]);

    for more in [&["--write"][..], &["--write", "--protocol", "3dgs"], &["--write", "--replace", "all"]] {
        let refused = eval("other", more);
        let said = text(&refused.stderr);
        assert_eq!(refused.status.code(), Some(FAILED), "{more:?}: {said}");
        let hash = recorded(&run)["photos_sha256"].as_str().expect("a hash").to_owned();
        for word in ["the held-out photos are not what run/results.json describes", "without --write", &hash] {
            assert!(said.contains(word), "{more:?}: `{word}` is missing: {said}");
        }
    }
    let compared = eval("other", &[]);
    assert!(compared.status.success(), "{}", text(&compared.stderr));
    assert!(text(&compared.stdout).contains("were computed on other photos"), "{}", text(&compared.stdout));
    let refused = resume("other");
    let said = text(&refused.stderr);
    assert_eq!(refused.status.code(), Some(FAILED), "{said}");
    assert!(said.contains("its training images are not those of the run") && said.contains("--data"), "{said}");
    assert!(contents(&run) == before, "a file has changed");

    fs::rename(place.join("scene"), place.join("moved")).expect("moved");
    let lost = mvfusion(place, &["train", "--resume", "run", "--set", LONGER]);
    let said = text(&lost.stderr);
    assert!(!lost.status.success() && said.contains("if it has moved, give its folder with --data"), "{said}");
    let written = eval("moved", &["--write"]);
    assert!(written.status.success(), "{}", text(&written.stderr));

    let poses = place.join("moved/poses_bounds.npy");
    let own = fs::read(&poses).expect("read");
    // The x of the second camera, the first that trains; eight rows of 17 numbers end the file.
    let first = own.len() - 7 * 17 * 8 + 3 * 8;
    let shifted = [&own[..first], &9.0f64.to_le_bytes()[..], &own[first + 8..]].concat();
    fs::write(&poses, shifted).expect("written");
    for refused in [eval("moved", &["--write"]), resume("moved")] {
        let said = text(&refused.stderr);
        assert_eq!(refused.status.code(), Some(FAILED), "{said}");
        assert!(said.contains("the camera positions"), "{said}");
    }
    fs::write(&poses, own).expect("written");

    let config = run.join("config.toml");
    let edited = fs::read_to_string(&config).expect("read") + "# edited\n";
    fs::write(&config, edited).expect("written");
    let longer = resume("moved");
    let said = text(&longer.stderr);
    assert!(longer.status.success() && said.contains("config.toml was changed since the run began"), "{said}");
}
