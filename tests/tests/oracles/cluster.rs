//! A sweep on a real SLURM: interrupted, submitted again, complete.
//!
//! The trials, `slurm::<what>`, run the program that the build left beside the tests, with a cluster of their own, and
//! are ignored where either is missing. Tests of the whole workspace build the program; those of this crate alone do
//! not.

mod ground;

use std::cell::RefCell;
use std::fs;

use anyhow::{Context, Result, anyhow, ensure};
use libtest_mimic::Trial;
use mvfusion_tests::Cluster;
use serde_json::{Value, json};

use crate::{failed, ignored};
use ground::{Ground, LONG, Sweep, UNEQUAL, job, program, said};

/// What the program says: of a cell in each state, and where nothing is left to do.
const FINISHED: &str = "finished";
const RUNNING: &str = "running";
const INTERRUPTED: &str = "interrupted";
const NOTHING_TO_DO: &str = "4 cells, 0 to do";

/// How a script asks for a GPU.
const GPU: &str = "#SBATCH --gres=gpu:1";

/// All trials.
pub fn trials() -> Vec<Trial> {
    vec![
        trial("a_cancelled_cell_alone_is_submitted_again", UNEQUAL, a_cancelled_cell_alone_is_submitted_again),
        trial("a_gpu_is_asked_for_where_one_is_wanted", UNEQUAL, a_gpu_is_asked_for_where_one_is_wanted),
        trial("cells_that_start_again_twice_go_on", LONG, cells_that_start_again_twice_go_on),
    ]
}

/// A trial that needs a cluster and the program.
fn trial(what: &str, sweep: Sweep, check: fn(&Ground) -> Result<()>) -> Trial {
    let name = format!("slurm::{what}");
    let no_program = || {
        let program = program().ok()?;
        (!program.is_file()).then(|| format!("{} is not built", program.display()))
    };
    // A sweep is refused for a device that the build does not include.
    let no_gpu = || (what.contains("gpu") && cfg!(not(feature = "wgpu"))).then(|| "no feature wgpu".to_owned());
    match Cluster::absent().or_else(no_program).or_else(no_gpu) {
        Some(reason) => ignored(name, reason),
        None => Trial::test(name, move || {
            let ground = Ground::new(sweep).map_err(failed)?;
            check(&ground).map_err(|error| failed(anyhow!("{error:#}\n{}", ground.story())))
        }),
    }
}

fn a_cancelled_cell_alone_is_submitted_again(ground: &Ground) -> Result<()> {
    let first = job(&ground.sweep(&[])?)?;
    let ids = ground.ids()?;
    ensure!(ground.submitted()? == ids, "the first script has not all cells in their order");
    // The first task has the first cell.
    let (task, cell) = (format!("{first}_0"), &ids[0]);
    ground.wait("the first cell at work", || {
        let runs = ground.cluster.queue(&first)?.contains(&format!("{task} RUNNING"));
        Ok(runs && ground.states()?.get(cell).is_some_and(|state| state == RUNNING))
    })?;
    ground.cluster.ask("scancel", &[&task])?;
    ground.wait("the end of the array", || Ok(ground.cluster.queue(&first)?.is_empty()))?;
    let states = ground.states()?;
    ensure!(states[cell] == INTERRUPTED, "the cancelled cell is {}", states[cell]);
    let finished = states.values().filter(|state| *state == FINISHED).count();
    ensure!(finished == UNEQUAL.cells - 1, "{finished} other cells have finished");
    let before = ground.finished()?;

    let again = ground.sweep(&["--wait"])?;
    let after = ground.finished()?;
    ensure!(
        after.len() == UNEQUAL.cells,
        "with --wait it returned before {} cells had ended",
        UNEQUAL.cells - after.len()
    );
    ensure!(job(&again)? != first, "the cell was not submitted again");
    ensure!(ground.submitted()? == [cell.as_str()], "others than the cancelled cell were submitted again");
    ensure!(before.iter().all(|(id, began)| after[id] == *began), "a finished cell was run again");
    ensure!(ground.states()?.values().all(|state| state == FINISHED), "a finished cell is said to be something else");

    let table = said(&ground.mvfusion(&["sweep", "table", "out"])?)?;
    ensure!(table.contains("long") && table.contains("w/o MFTA"), "no table: {table}");
    ensure!(ground.path("out/table.md").is_file(), "table.md is missing");

    let (script, jobs) = (fs::read(ground.path("out/slurm/array.sh"))?, ground.cluster.every_job()?);
    let output = ground.sweep(&[])?;
    let note = String::from_utf8_lossy(&output.stderr).into_owned();
    ensure!(note.contains(NOTHING_TO_DO), "it does not say that nothing is to do: {note}");
    ensure!(job(&output).is_err(), "it names a job");
    ensure!(ground.cluster.every_job()? == jobs, "a job was submitted for nothing");
    ensure!(fs::read(ground.path("out/slurm/array.sh"))? == script, "the script was written again for nothing");
    Ok(())
}

fn a_gpu_is_asked_for_where_one_is_wanted(ground: &Ground) -> Result<()> {
    for (device, wants) in [("cpu", false), ("wgpu", true)] {
        let output = ground.sweep(&["--device", device, "--dry-run"])?;
        let said = said(&output)?;
        ensure!(said.lines().any(|line| line == GPU) == wants, "--device {device}: {said}");
        ensure!(!ground.path("out").exists(), "a dry run writes");
        // SLURM itself must understand it. The script is the part from its first line to the command that it runs.
        let begin = said.find("#!").context("no script is shown")?;
        let script = said[begin..].lines().take_while(|line| !line.is_empty()).collect::<Vec<_>>().join("\n");
        fs::write(ground.path("script.sh"), script)?;
        let script = ground.path("script.sh").display().to_string();
        ground.cluster.ask("sbatch", &["--test-only", &script]).with_context(|| format!("--device {device}"))?;
    }
    ensure!(ground.cluster.every_job()?.is_empty(), "a dry run submits");
    Ok(())
}

fn cells_that_start_again_twice_go_on(ground: &Ground) -> Result<()> {
    let resumptions = || -> Result<Vec<usize>> {
        let runs = ground.of_each_cell("out", "run.json")?;
        Ok(runs.iter().map(|run| run["resumed"].as_array().map_or(0, Vec::len)).collect())
    };
    let array = job(&ground.sweep(&[])?)?;
    for time in 0..2 {
        // A cell that has logged a step since it started has something to go on from. Each is started again by itself: the
        // first would be finished before the last has begun.
        let before = ground.logged()?;
        let waiting = RefCell::new((0..LONG.cells).collect::<Vec<_>>());
        ground.wait("all cells at work", || {
            let (resumed, now) = (resumptions()?, ground.logged()?);
            let (ready, rest): (Vec<_>, Vec<_>) =
                waiting.take().into_iter().partition(|&cell| resumed[cell] == time && now[cell] > before[cell]);
            for cell in ready {
                ground.cluster.ask("scontrol", &["requeue", &format!("{array}_{cell}")])?;
            }
            let is_over = rest.is_empty();
            waiting.replace(rest);
            Ok(is_over)
        })?;
    }
    ground.wait("the end of the array", || Ok(ground.cluster.queue(&array)?.is_empty()))?;
    ensure!(resumptions()? == [2; LONG.cells], "{:?} resumptions", resumptions()?);
    let results = |folder: &str| -> Result<(Vec<Value>, String)> {
        let learned = ground.of_each_cell(folder, "results.json")?;
        ensure!(learned.iter().all(|results| results["params_sha256"].is_string()), "{folder}: a cell has no results");
        let learned = learned.iter().map(|results| json!([results["params_sha256"], results["test"]])).collect();
        said(&ground.mvfusion(&["sweep", "table", folder])?)?;
        Ok((learned, fs::read_to_string(ground.path(folder).join("table.md"))?))
    };
    let alone = ["sweep", "tiny.toml", "--out", "alone", "--jobs", "2", "--threads", "1", "--device", "cpu"];
    said(&ground.mvfusion(&alone)?)?;
    ensure!(results("out")? == results("alone")?, "the cells differ from those that ran without a break");
    Ok(())
}
