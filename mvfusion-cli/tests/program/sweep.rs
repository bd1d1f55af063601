//! Sweeps as a user runs them: interrupted, gone on with, failed, refused.

use std::collections::BTreeMap;
use std::fs::{self, File};
use std::io::{BufRead, BufReader};
use std::os::unix::fs::PermissionsExt;
use std::os::unix::process::CommandExt;
use std::path::{Path, PathBuf};
use std::process::{Child, Command, Stdio};
use std::time::{Duration, Instant};

use serde_json::Value;

use super::output::events;
use super::{FAILED, USAGE, mvfusion, program, text};

/// Cells of a second or two that pass through all stages.
const TINY: &str = r#"
title = "Tiny"
preset = "quickstart"
seeds = [1, 2]

[set]
train.stages = { geometry = 2, deformation = 2, refinement = 2 }
train.log_interval = 2
model.width = 8
model.grid = { features = 2, resolution = [4, 4, 4, 4], multipliers = [1] }
init.dynamic_points = 60
init.motion_points = 60
init.photo_points = 60
motion.samples = 4
eval.strips = 0
eval.pictures = false

[[scenes]]
name = "video"

[[variants]]
name = "full"

[[variants]]
name = "w/o MFTA"
set = { motion.mfta = false }

[[paper]]
variant = "full"
column = "video"
values = { "composed.psnr" = 32.07 }
"#;

/// The grids that ship with the program.
const SHIPPED: &str = concat!(env!("CARGO_MANIFEST_DIR"), "/sweeps");

/// An `sbatch` that notes what it is told, and runs nothing.
const SBATCH: &str = "#!/bin/sh\necho \"$@\" >>submitted\necho 7\n";

/// How long a sweep of tiny cells may take at most before a test gives up.
const PATIENCE: Duration = Duration::from_secs(300);

/// Milliseconds after which a sweep is killed: while it is written down, while a cell begins, trains and is written
/// down.
const KILLED_AFTER: [u64; 6] = [20, 60, 150, 400, 900, 1600];

struct Ground {
    folder: tempfile::TempDir,
}

impl Ground {
    fn new(grid: &str) -> Self {
        let folder = tempfile::tempdir().expect("folder");
        fs::write(folder.path().join("tiny.toml"), grid).expect("written");
        Self { folder }
    }

    fn path(&self) -> &Path {
        self.folder.path()
    }

    fn sweep(&self, more: &[&str]) -> std::process::Output {
        let arguments = ["sweep", "tiny.toml", "--out", "out", "--device", "cpu", "--jobs", "2"];
        mvfusion(self.path(), &arguments.into_iter().chain(more.iter().copied()).collect::<Vec<_>>())
    }

    /// A sweep in a process group of its own.
    fn started(&self) -> Child {
        program()
            .args(["sweep", "tiny.toml", "--out", "out", "--device", "cpu", "--jobs", "1", "--quiet"])
            .current_dir(self.path())
            .stdout(Stdio::null())
            .stderr(Stdio::null())
            .process_group(0)
            .spawn()
            .expect("the program starts")
    }

    /// A sweep that is handed to a SLURM which runs nothing.
    fn submission(&self, more: &[&str]) -> Command {
        let bin = self.path().join("bin");
        if !bin.exists() {
            fs::create_dir(&bin).expect("made");
            fs::write(bin.join("sbatch"), SBATCH).expect("written");
            fs::set_permissions(bin.join("sbatch"), fs::Permissions::from_mode(0o755)).expect("allowed");
        }
        let others = std::env::var_os("PATH").unwrap_or_default();
        let path = std::env::join_paths([bin].into_iter().chain(std::env::split_paths(&others))).expect("a path");
        let mut command = program();
        command
            .args(["sweep", "tiny.toml", "--out", "out", "--device", "cpu", "--launcher", "slurm"])
            .args(more)
            .current_dir(self.path())
            .env("PATH", path);
        command
    }

    /// What the sweep says that is handed to such a SLURM.
    fn submitted(&self, more: &[&str]) -> String {
        let output = self.submission(more).output().expect("the program starts");
        assert!(output.status.success(), "{}", text(&output.stderr));
        text(&output.stdout)
    }

    /// What SLURM was told, a line for each job.
    fn jobs(&self) -> Vec<String> {
        let told = fs::read_to_string(self.path().join("submitted")).unwrap_or_default();
        told.lines().map(str::to_owned).collect()
    }

    /// The ids of the cells.
    fn ids(&self) -> Vec<String> {
        let text = fs::read_to_string(self.path().join("out/sweep.json")).expect("read");
        let index: serde_json::Value = serde_json::from_str(&text).expect("JSON");
        let cells = index["cells"].as_array().expect("cells");
        cells.iter().map(|cell| cell["id"].as_str().expect("an id").to_owned()).collect()
    }

    /// Holds a cell as a process that works on it does, until the file is dropped.
    fn hold(&self, id: &str) -> File {
        let lock = File::create(self.path().join(format!("out/cells/{id}.lock"))).expect("made");
        lock.lock().expect("locked");
        lock
    }

    fn status(&self) -> String {
        text(&mvfusion(self.path(), &["sweep", "status", "out"]).stdout)
    }

    /// When each cell that has finished was begun.
    fn finished(&self) -> BTreeMap<PathBuf, String> {
        self.records(|record| record.get("finished").is_some())
    }

    /// When each cell was begun whose record is as told.
    fn records(&self, is: impl Fn(&serde_json::Value) -> bool) -> BTreeMap<PathBuf, String> {
        let Ok(cells) = fs::read_dir(self.path().join("out/cells")) else { return BTreeMap::new() };
        let record = |cell: PathBuf| {
            let text = fs::read_to_string(cell.join("run.json")).ok()?;
            let record: serde_json::Value = serde_json::from_str(&text).ok()?;
            is(&record).then(|| Some((cell, record["started"].as_str()?.to_owned())))?
        };
        cells.filter_map(|entry| record(entry.expect("entry").path())).collect()
    }

    /// Waits for something, not for ever.
    fn wait_for(&self, what: &str, is_there: impl Fn() -> bool) {
        let since = Instant::now();
        while !is_there() {
            assert!(since.elapsed() < PATIENCE, "no {what}: {}", self.status());
            std::thread::sleep(Duration::from_millis(10));
        }
    }

    fn table(&self) -> String {
        fs::read_to_string(self.path().join("out/table.md")).expect("the table is there")
    }
}

/// Ends a process group at once: the sweep and the cell that it runs.
fn kill_group(child: &mut Child) {
    let group = format!("-{}", child.id());
    let status = Command::new("kill").args(["-KILL", "--", &group]).status().expect("kill starts");
    assert!(status.success());
    child.wait().expect("ended");
}

#[test]
fn a_sweep_that_was_killed_goes_on_where_it_was_and_ends_with_the_same_table() {
    let whole = Ground::new(TINY);
    let output = whole.sweep(&[]);
    assert!(output.status.success(), "{}", text(&output.stderr));
    assert!(whole.status().ends_with("4 cells: 4 finished\n"), "{}", whole.status());
    let said = text(&output.stdout);
    assert!(said.contains("w/o MFTA") && said.contains("built-in scene") && said.contains("32.07"), "{said}");
    for file in ["table.md", "table.tex", "table.csv", "seeds.csv", "table.json", "grid.toml", "sweep.json"] {
        assert!(whole.path().join("out").join(file).is_file(), "{file}");
    }

    let broken = Ground::new(TINY);
    for delay in KILLED_AFTER {
        let mut child = broken.started();
        std::thread::sleep(Duration::from_millis(delay));
        kill_group(&mut child);
    }
    let mut child = broken.started();
    broken.wait_for("a finished cell", || !broken.finished().is_empty());
    kill_group(&mut child);
    let finished = broken.finished();
    assert!(finished.len() < 4, "{}", broken.status());
    let output = broken.sweep(&[]);
    assert!(output.status.success(), "{}", text(&output.stderr));
    assert!(
        text(&output.stderr).contains(&format!("4 cells, {} to do", 4 - finished.len())),
        "{}",
        text(&output.stderr)
    );
    let after = broken.finished();
    assert!(finished.iter().all(|(cell, began)| after[cell] == *began), "a finished cell was run again");
    assert_eq!(broken.table(), whole.table());

    let output = broken.sweep(&[]);
    assert!(text(&output.stderr).contains("4 cells, 0 to do"), "{}", text(&output.stderr));
    assert_eq!(broken.finished(), after);
}

#[test]
fn a_cell_whose_sweep_was_killed_is_waited_for_and_not_run_twice() {
    let ground = Ground::new(TINY);
    let mut child = ground.started();
    ground.wait_for("a cell at work", || ground.records(|record| record.get("finished").is_none()).len() == 1);
    let at_work = ground.records(|record| record.get("finished").is_none());
    // The sweep alone, not its cell.
    child.kill().expect("killed");
    child.wait().expect("ended");
    assert!(ground.status().contains("running"), "{}", ground.status());
    let output = ground.sweep(&[]);
    assert!(output.status.success(), "{}", text(&output.stderr));
    assert!(ground.status().ends_with("4 cells: 4 finished\n"), "{}", ground.status());
    assert!(at_work.iter().all(|(cell, began)| ground.finished()[cell] == *began), "a running cell was run again");
}

#[test]
fn what_is_wanted_later_is_measured_without_training_again() {
    let grid = TINY.replace("seeds = [1, 2]", "seeds = [1]");
    let ground = Ground::new(&grid);
    assert!(ground.sweep(&[]).status.success());
    let trained = ground.finished();
    let results = |cell: &Path| fs::read_to_string(cell.join("results.json")).expect("results");
    assert!(trained.keys().all(|cell| !results(cell).contains("\"speed\"")));
    let timed = grid.replace("seeds = [1]", "seeds = [1]\nspeed_frames = 2");
    fs::write(ground.path().join("tiny.toml"), timed).expect("written");
    let output = ground.sweep(&[]);
    assert!(text(&output.stderr).contains("2 cells, 2 to do"), "{}", text(&output.stderr));
    assert_eq!(ground.finished(), trained, "a cell was trained again");
    assert!(trained.keys().all(|cell| results(cell).contains("\"speed\"")));
}

/// What scripts are told of a sweep of which two cells fail.
fn check_json(ground: &Ground) {
    let json = |action: &str| -> Value {
        let printed = mvfusion(ground.path(), &["sweep", action, "out", "--json"]).stdout;
        serde_json::from_slice(&printed).unwrap_or_else(|error| panic!("{error}: {}", text(&printed)))
    };
    let status = json("status");
    let counts = serde_json::json!({ "finished": 2, "running": 0, "interrupted": 0, "failed": 2, "to_do": 0 });
    assert_eq!(status["counts"], counts);
    let cells = status["cells"].as_array().expect("cells");
    let ids: Vec<&str> = cells.iter().filter_map(|cell| cell["id"].as_str()).collect();
    assert_eq!(ids, ground.ids());
    for cell in cells {
        let has_failed = cell["state"] == "failed";
        assert_eq!(cell["failure"].as_str().is_some_and(|words| words.contains("none.ply")), has_failed, "{cell}");
        assert_eq!((&cell["scene"], &cell["steps"]), (&"video".into(), &6.into()));
    }
    let table = fs::read(ground.path().join("out/table.json")).expect("a table");
    assert_eq!(json("table"), serde_json::from_slice::<Value>(&table).expect("JSON"));
    // Only the failed ones are tried again.
    let again = ground.sweep(&["--progress", "json"]);
    let said = events(&again.stderr);
    let of_sweep: Vec<&Value> = said.iter().filter(|event| event["task"] == "sweep").collect();
    assert_eq!(of_sweep.iter().map(|event| event["done"].as_u64()).collect::<Vec<_>>(), [Some(1), Some(2)]);
    for event in of_sweep {
        assert_eq!((&event["total"], &event["cell"]["state"]), (&2.into(), &"failed".into()));
        assert!(event["cell"]["failure"].as_str().is_some_and(|words| words.contains("none.ply")), "{event}");
    }
    let end = said.last().expect("a line");
    assert!(end["exit_code"] == FAILED && end["paths"]["sweep"].as_str().is_some(), "{end}");
}

#[test]
fn a_cell_that_fails_is_told_and_the_others_go_on() {
    let failing = TINY.replace("set = { motion.mfta = false }", "set = { init.static_ply = \"none.ply\" }");
    let ground = Ground::new(&failing);
    let output = ground.sweep(&[]);
    assert_eq!(output.status.code(), Some(FAILED));
    assert!(text(&output.stderr).contains("2 of 4 cells have not finished"), "{}", text(&output.stderr));
    assert!(ground.table().contains("failed"), "{}", ground.table());
    let status = ground.status();
    assert!(status.ends_with("4 cells: 2 finished, 2 failed\n") && status.contains("none.ply"), "{status}");
    check_json(&ground);
}

#[test]
fn a_cpu_runs_a_cell_for_each_thread_and_one_where_frame_rates_are_measured() {
    let timed = TINY.replace("seeds = [1, 2]", "seeds = [1, 2]\nspeed_frames = 2");
    for (grid, jobs) in [(TINY, "3 at a time"), (&timed, "1 at a time")] {
        let ground = Ground::new(grid);
        let arguments = ["sweep", "tiny.toml", "--out", "out", "--dry-run", "--device", "cpu", "--threads", "3"];
        let said = text(&mvfusion(ground.path(), &arguments).stdout);
        assert!(said.contains(jobs), "{said}");
    }
}

#[test]
fn a_dry_run_shows_the_cells_and_writes_nothing() {
    let ground =
        Ground::new(&TINY.replace("seeds = [1, 2]", "seeds = [1, 2]\nexpected = { minutes = 3, on = \"a snail\" }"));
    let output = ground.sweep(&["--dry-run"]);
    let said = text(&output.stdout);
    assert!(said.contains("4 cells to do, 24 steps, 2 at a time: 6 min 00 s") && said.contains("a snail"), "{said}");
    assert!(!ground.path().join("out").exists());
}

#[test]
fn a_grid_that_cannot_be_run_is_refused_before_anything_is() {
    for (good, bad, code, word) in [
        ("motion.mfta = false", "motion.mtfa = false", USAGE, "`motion.mfta`"),
        ("seeds = [1, 2]", "seeds = []", USAGE, "is empty"),
        ("name = \"w/o MFTA\"", "name = \"full\"", USAGE, "appears twice"),
        ("motion.mfta = false", "motion.mfta = false, motion.temporal = \"average\"", USAGE, "motion.temporal"),
        ("name = \"video\"", "name = \"video\"\ndata = \"not/there\"", FAILED, "--data-root"),
    ] {
        let ground = Ground::new(&TINY.replace(good, bad));
        let output = ground.sweep(&[]);
        let said = text(&output.stderr);
        assert_eq!(output.status.code(), Some(code), "{bad}: {said}");
        assert!(said.starts_with("error: ") && said.contains(word) && !said.contains("panicked"), "{bad}: {said}");
        assert!(!ground.path().join("out").exists(), "{bad}");
    }
}

#[test]
fn a_folder_that_holds_something_else_is_not_written_to() {
    let ground = Ground::new(TINY);
    fs::create_dir(ground.path().join("out")).expect("made");
    fs::write(ground.path().join("out/thesis.tex"), "x").expect("written");
    let output = ground.sweep(&[]);
    assert_eq!(output.status.code(), Some(FAILED));
    assert!(text(&output.stderr).contains("`thesis.tex`, but no sweep"), "{}", text(&output.stderr));

    let ground = Ground::new(TINY);
    fs::write(ground.path().join("out"), "x").expect("written");
    let output = ground.sweep(&[]);
    assert!(text(&output.stderr).contains("is a file"), "{}", text(&output.stderr));

    if cfg!(target_os = "linux") {
        // Nobody can write there, whoever runs the tests.
        let arguments = ["sweep", "tiny.toml", "--device", "cpu", "--out", "/proc/sweep"];
        let output = mvfusion(ground.path(), &arguments);
        assert_eq!(output.status.code(), Some(FAILED));
        assert!(text(&output.stderr).contains("cannot write to /proc"), "{}", text(&output.stderr));
    }
}

#[test]
fn options_that_would_be_ignored_are_refused() {
    let ground = Ground::new(TINY);
    for option in ["--wait", "--sbatch=--time=1"] {
        let output = ground.sweep(&[option]);
        assert_eq!(output.status.code(), Some(USAGE));
        assert!(text(&output.stderr).contains("--launcher slurm"), "{}", text(&output.stderr));
    }
    assert!(!ground.path().join("out").exists());
}

#[test]
fn shipped_grids_are_listed_and_shown_as_they_are() {
    let ground = Ground::new(TINY);
    let listed = text(&mvfusion(ground.path(), &["sweep", "list"]).stdout);
    let mut count = 0;
    for entry in fs::read_dir(SHIPPED).expect("listed") {
        let path = entry.expect("entry").path();
        let (grid, name) = (fs::read_to_string(&path).expect("read"), path.file_stem().expect("named"));
        let name = name.to_str().expect("UTF-8");
        let line = listed.lines().find(|line| line.split(' ').next() == Some(name));
        let title = grid.parse::<toml::Table>().expect("TOML")["title"].as_str().expect("a title").to_owned();
        assert!(line.is_some_and(|line| line.ends_with(&title)), "{name}: {listed}");
        let shown = mvfusion(ground.path(), &["sweep", "show", name]);
        assert_eq!(text(&shown.stdout), grid, "{name}");
        count += 1;
    }
    assert_eq!(listed.lines().count(), count);
    let output = mvfusion(ground.path(), &["sweep", "show", "component"]);
    assert_eq!(output.status.code(), Some(USAGE));
    assert!(text(&output.stderr).contains("`component`") && text(&output.stderr).contains("components-small"));
}

#[test]
fn scenes_variants_and_seeds_choose_cells_that_there_are() {
    let other = "[[scenes]]\nname = \"other\"\nset = { scene.kind = \"casual\" }\n[[variants]]";
    let ground = Ground::new(&TINY.replacen("[[variants]]", other, 1));
    let shown = |more: &[&str]| {
        let output = ground.sweep(&[["--dry-run"].as_slice(), more].concat());
        assert!(output.status.success(), "{}", text(&output.stderr));
        let said = text(&output.stdout);
        let cells = said.lines().filter(|line| line.starts_with("to do ")).map(str::to_owned).collect::<Vec<_>>();
        let sum = said.lines().last().expect("a sum").to_owned();
        (cells, sum)
    };
    assert_eq!(shown(&[]).0.len(), 8);
    let choices: [(&[&str], &[&str]); 4] = [
        (&["--scenes", "other"], &["other"]),
        (&["--variant", "w/o MFTA"], &["w/o MFTA"]),
        (&["--seeds", "2"], &["seed 2"]),
        (&["--scenes", "video", "--seeds", "1"], &["video", "seed 1"]),
    ];
    for (more, words) in choices {
        let (cells, sum) = shown(more);
        assert_eq!(cells.len(), 8 >> words.len(), "{more:?}: {cells:?}");
        assert!(cells.iter().all(|cell| words.iter().all(|word| cell.contains(word))), "{more:?}: {cells:?}");
        assert!(sum.starts_with(&format!("{} cells to do", cells.len())), "{more:?}: {sum}");
    }
    assert_eq!(shown(&["--scenes", "video,other", "--seeds", "1,2"]).0.len(), 8);
    assert_eq!(shown(&["--variant", "full", "--variant", "w/o MFTA"]).0.len(), 8);
    for (more, word) in [
        (["--scenes", "vidoe"], "`vidoe`; it has `other`, `video`"),
        (["--variant", "w/o"], "`w/o`; it has `full`, `w/o MFTA`"),
        (["--seeds", "3"], "no seed 3; it has "),
    ] {
        let output = ground.sweep(&[["--dry-run"].as_slice(), more.as_slice()].concat());
        assert_eq!(output.status.code(), Some(USAGE), "{more:?}");
        assert!(text(&output.stderr).contains(word), "{more:?}: {}", text(&output.stderr));
    }
}

#[test]
fn weights_that_the_columns_cannot_use_are_refused_before_anything_is_trained() {
    let ground = Ground::new(TINY);
    let refused = |folder: &str, reason: &str| {
        let output = ground.sweep(&["--lpips-weights", folder]);
        let said = text(&output.stderr);
        assert_eq!(output.status.code(), Some(FAILED), "{said}");
        assert!(said.contains(folder) && said.contains(reason), "{said}");
    };
    refused("no/weights", "there is no such folder");
    fs::create_dir(ground.path().join("empty")).expect("made");
    refused("empty", "no lpips_alex_f32.safetensors");
    // A network that no column asks for.
    fs::create_dir(ground.path().join("weights")).expect("made");
    fs::write(ground.path().join("weights/lpips_vgg_f32.safetensors"), "vgg").expect("written");
    refused("weights", "no lpips_alex_f32.safetensors");
    assert!(!ground.path().join("out").exists());
}

#[test]
fn cells_at_work_are_left_out_of_a_new_array_and_waited_for() {
    let ground = Ground::new(TINY);
    let said = ground.submitted(&[]);
    assert!(said.contains("job 7: 4 cells") && said.contains("sweep status"), "{said}");
    let ids = ground.ids();

    let held = ground.hold(&ids[1]);
    let said = ground.submitted(&[]);
    assert!(said.contains("1 of 4 cells are already running") && said.contains("job 7: 3 cells"), "{said}");
    let script = fs::read_to_string(ground.path().join("out/slurm/array.sh")).expect("read");
    let submitted: Vec<bool> = ids.iter().map(|id| script.contains(id.as_str())).collect();
    assert_eq!(submitted, [true, false, true, true], "{script}");

    let others = [0, 2, 3].map(|place: usize| ground.hold(&ids[place]));
    let said = ground.submitted(&[]);
    assert!(said.contains("4 of 4 cells are already running") && !said.contains("job "), "{said}");
    assert_eq!(ground.jobs().len(), 2, "{:?}", ground.jobs());
    drop(others);

    let mut waiting =
        ground.submission(&["--wait"]).stdout(Stdio::null()).stderr(Stdio::piped()).spawn().expect("starts");
    let mut notes = BufReader::new(waiting.stderr.take().expect("piped")).lines().map(|line| line.expect("read"));
    assert!(notes.any(|note| note.contains("waiting for running cells (1)")), "it did not wait");
    assert!(ground.jobs()[2].contains("--wait"), "{:?}", ground.jobs());
    assert_eq!(waiting.try_wait().expect("asked"), None, "it did not wait for the cell at work");
    drop(held);
    let since = Instant::now();
    let status = loop {
        if let Some(status) = waiting.try_wait().expect("asked") {
            break status;
        }
        assert!(since.elapsed() < PATIENCE, "it waits for nothing");
        std::thread::sleep(Duration::from_millis(10));
    };
    // Nothing was run.
    assert_eq!(status.code(), Some(FAILED));
}
