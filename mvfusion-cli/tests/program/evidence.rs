//! Runs whose checkpoint or configuration is no longer the one that their results describe.

use std::collections::BTreeMap;
use std::fs;
use std::path::Path;

use super::{FAILED, USAGE, mvfusion, text, train_tiny};

const CHECKPOINT: &str = "run/checkpoints/final.safetensors";

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
