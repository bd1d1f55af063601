//! Output for other programs: `--progress json` on stderr, and `--json` on stdout.

use std::fs;
use std::path::Path;

use serde_json::Value;

use super::{FAILED, USAGE, misused, mvfusion, text, train_tiny};

/// The lines of a stderr on which everything is JSON. The last one is the end, and the only one.
pub(super) fn events(stderr: &[u8]) -> Vec<Value> {
    let lines = text(stderr);
    let event = |line: &str| serde_json::from_str::<Value>(line).unwrap_or_else(|error| panic!("{error}: {line}"));
    let events: Vec<Value> = lines.lines().map(event).collect();
    let ends: Vec<usize> = (0..events.len()).filter(|&index| events[index]["event"] == "end").collect();
    assert_eq!(ends, [events.len() - 1], "{lines}");
    events
}

/// The progress of a task.
fn progress<'a>(events: &'a [Value], task: &str) -> Vec<&'a Value> {
    events.iter().filter(|event| event["event"] == "progress" && event["task"] == task).collect()
}

fn json(bytes: &[u8]) -> Value {
    serde_json::from_slice(bytes).unwrap_or_else(|error| panic!("{error}: {}", text(bytes)))
}

fn read(path: &Path) -> Value {
    json(&fs::read(path).expect("read"))
}

#[test]
fn with_json_every_line_of_stderr_is_an_object_and_the_last_one_tells_the_end() {
    let folder = tempfile::tempdir().expect("folder");
    let place = folder.path();
    let output = train_tiny(place, &["--out", "run", "--progress", "json", "--threads", "9999"]);
    let said = events(&output.stderr);
    assert!(output.status.success() && text(&output.stdout).contains("composed"), "the table stays as it is");
    let topics: Vec<&str> = said.iter().filter_map(|event| event["topic"].as_str()).collect();
    assert!(["note", "device", "scene", "run"].iter().all(|topic| topics.contains(topic)), "{said:?}");
    let end = said.last().expect("a line");
    assert_eq!((&end["status"], &end["exit_code"]), (&"ok".into(), &0.into()));
    for (name, path) in [("run", "run"), ("report", "run/report.html")] {
        let told = Path::new(end["paths"][name].as_str().expect("a path"));
        assert!(told.is_absolute() && told.ends_with(path) && told.exists(), "{end}");
    }

    // Every log step is told, with the numbers of the log.
    let training = progress(&said, "training");
    let log = fs::read_to_string(place.join("run/metrics.jsonl")).expect("a log");
    let logged: Vec<Value> = log.lines().map(|line| json(line.as_bytes())).collect();
    let with_loss: Vec<&&Value> = training.iter().filter(|event| !event["loss"].is_null()).collect();
    assert_eq!(with_loss.len(), 3, "{training:?}");
    for (told, line) in with_loss.iter().zip(&logged) {
        assert_eq!((&told["done"], &told["total"]), (&line["step"], &6.into()));
        for number in ["stage", "loss", "psnr", "gaussians", "steps_per_second"] {
            assert_eq!(told[number], line[number], "{number}");
        }
        assert!(told["seconds_left"].is_number(), "{told}");
    }
    assert_eq!(progress(&said, "evaluation").last().expect("told")["done"], 24);

    let eval = mvfusion(place, &["eval", "run", "--speed-frames", "0", "--json", "--progress", "json"]);
    let said = events(&eval.stderr);
    assert!(eval.status.success(), "{}", text(&eval.stderr));
    let is_equal = |event: &Value| event["text"].as_str().is_some_and(|text| text.contains("The metrics equal"));
    assert!(said.iter().any(is_equal), "{said:?}");
    let (mut printed, mut written) = (json(&eval.stdout), read(&place.join("run/results.json")));
    for results in [&mut printed, &mut written] {
        results["eval"]["seconds"] = 0.into();
        results["threads"] = 0.into();
        // The folder has grown since by what was written after its metrics.
        results["size"]["run"] = 0.into();
    }
    assert_eq!(printed, written);

    let film = ["render", "run", "--frames", "2", "--layers", "composed", "--format", "png", "--size", "32x24"];
    let render = mvfusion(place, &[&film[..], &["--progress=json"]].concat());
    let said = events(&render.stderr);
    assert_eq!(progress(&said, "rendering").last().expect("told")["done"], 2);
    assert!(said.last().expect("a line")["paths"]["frames"].as_str().is_some_and(|path| Path::new(path).is_dir()));

    let replaced = mvfusion(place, &["eval", "run", "--replace", "mvg=mean", "--json", "--progress", "none"]);
    assert_eq!(json(&replaced.stdout)["replaced"][0]["module"], "mvg", "{}", text(&replaced.stderr));
    let said = text(&replaced.stderr);
    assert!(said.starts_with("device: ") && !said.contains("evaluation"), "notes, and no progress: {said}");
    let plain = mvfusion(place, &["eval", "run", "--speed-frames", "0", "--progress", "plain"]);
    assert!(text(&plain.stderr).contains("evaluation 24/24"), "{}", text(&plain.stderr));
}

#[test]
fn with_json_an_error_is_the_end_with_its_exit_code() {
    let folder = tempfile::tempdir().expect("folder");
    for (arguments, code, words) in [
        (&["train", "--set", "train.scael=1"][..], USAGE, "`train.scale`"),
        (&["train", "--data", "no/scene"], FAILED, "no/scene"),
        (&["train", "--tensorbaord"], USAGE, "--tensorbaord"),
        (&["evla"], USAGE, "eval"),
    ] {
        let output = mvfusion(folder.path(), &[arguments, &["--progress", "json"]].concat());
        assert_eq!(output.status.code(), Some(code), "{arguments:?}");
        let said = events(&output.stderr);
        let end = said.last().expect("a line");
        assert_eq!((&end["status"], &end["exit_code"]), (&"failed".into(), &code.into()), "{end}");
        let message = end["message"].as_str().expect("a message");
        assert!(message.contains(words) && !message.starts_with("error"), "{message}");
    }
    let help = mvfusion(folder.path(), &["train", "--progress", "json", "--help"]);
    assert!(help.status.success() && help.stderr.is_empty() && text(&help.stdout).contains("--progress <FORM>"));
    misused(&["train", "--quiet", "--progress", "json"], &["\"event\":\"end\"", "--quiet"]);
    misused(&["train", "--progress", "xml"], &["xml", "plain", "json"]);
}

#[test]
fn presets_and_devices_are_listed_for_scripts_as_for_people() {
    let folder = tempfile::tempdir().expect("folder");
    let printed = |arguments: &[&str]| mvfusion(folder.path(), arguments).stdout;
    let names = |list: &Value| -> Vec<String> {
        let list = list.as_array().expect("a list").iter();
        list.map(|entry| entry["name"].as_str().expect("a name").to_owned()).collect()
    };
    let first_words = |lines: &[u8]| -> Vec<String> {
        text(lines).lines().filter_map(|line| line.split(' ').next()).map(str::to_owned).collect()
    };
    let presets = json(&printed(&["presets", "--json"]));
    assert_eq!(names(&presets), first_words(&printed(&["presets"])));
    assert_eq!(presets[1]["base"], "quickstart");
    assert!(presets[0].get("base").is_none() && presets[0]["purpose"].is_string(), "{presets}");

    let listed = json(&printed(&["devices", "--json"]));
    let devices = names(&listed["devices"]);
    let said = first_words(&printed(&["devices"]));
    assert_eq!(devices, said.into_iter().filter(|word| word != "no" && word != "this").collect::<Vec<_>>());
    for device in listed["devices"].as_array().expect("a list") {
        let is_cpu = device["kind"] == "cpu";
        assert_eq!(device["threads"].is_u64(), is_cpu, "{device}");
        assert_eq!(device["card"]["largest_buffer"].is_u64() || !device["error"].is_null(), !is_cpu, "{device}");
    }
    let has = |feature: &str| listed["features"].as_array().is_some_and(|list| list.contains(&feature.into()));
    assert_eq!((has("flex"), has("wgpu")), (cfg!(feature = "flex"), cfg!(feature = "wgpu")));
}
