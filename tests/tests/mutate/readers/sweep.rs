//! The files of a sweep.

use std::fs;
use std::path::Path;

use mvfusion_cli::run;
use mvfusion_cli::sweep::{Additions, Grid, Index, Plan, SweepFolder, table};

use super::run::finished;
use super::{RECORDS, Room, Target, Targets, answer};
use crate::mutation::Kind;

/// The readers of this file.
pub const READERS: &[(&str, Targets)] = &[("grid", grids), ("sweep_index", indices), ("sweep_cell", orders)];

/// A grid that has something of everything.
const GRID: &str = r#"
title = "Two variants"
about = "For the tests"
preset = "quickstart"
seeds = [0, 7]
speed_frames = 2
expected = { minutes = 1.5, on = "two cores" }
[set]
train.scale = 0.5
[[scenes]]
name = "video"
[[scenes]]
name = "photos"
set = { scene.kind = "casual" }
[[variants]]
name = "full"
[[variants]]
name = "w/o MVG"
set = { motion.mvg = false }
[grid]
motion.window = [3, 5]
[[exclude]]
motion.window = 3
variant = "full"
scene = "video"
[[columns]]
title = "Video"
scenes = ["video"]
metrics = ["composed.psnr", "composed.ssim"]
[[columns]]
title = "Mean"
metrics = ["composed.psnr"]
[[differences]]
variant = "full"
minus = "w/o MVG"
[[paper]]
variant = "full"
at = { motion.window = 5 }
column = "Video"
values = { "composed.psnr" = 31.5 }
not_comparable = { "*" = "other scenes" }
[[paper]]
literature = "4DGS"
column = "Mean"
values = { "composed.psnr" = 30.25 }
"#;

/// A plan holds a whole configuration for each cell, however short the entry of the grid that makes many of them.
const PLAN: Room = Room { times: 64, fixed: 64 << 20 };

fn plan(file: &Path) -> anyhow::Result<Plan> {
    Plan::new(&Grid::read(file)?, &Additions::default())
}

fn write_grid(place: &Path) -> std::path::PathBuf {
    let file = place.join("own.toml");
    fs::write(&file, GRID).expect("written");
    file
}

fn grids(place: &Path) -> Vec<Target> {
    let file = write_grid(place);
    plan(&file).expect("a sound grid");
    let path = file.clone();
    vec![Target { file, kind: Kind::Toml, room: PLAN, others: 0, read: Box::new(move || answer(plan(&path))) }]
}

/// A folder of a sweep whose first cell is finished, with its plan.
fn folder(place: &Path) -> (SweepFolder, Plan) {
    let folder = SweepFolder::new(&place.join("sweep")).expect("a place");
    let mut plan = plan(&write_grid(place)).expect("a sound grid");
    // The run of the tests measures no speed.
    plan.index.wanted.speed_frames = 0;
    folder.prepare(GRID, &plan).expect("written");
    let cell = folder.run(&plan.index.cells[0].id);
    fs::create_dir(&cell).expect("made");
    for name in [run::RECORD, run::RESULTS] {
        fs::copy(finished(place).join(name), cell.join(name)).expect("copied");
    }
    assert!(folder.is_finished(&plan.index.cells[0].id, &plan.index.wanted));
    (folder, plan)
}

/// The index, and the results of a cell, on their way to the table.
fn indices(place: &Path) -> Vec<Target> {
    let (folder, plan) = folder(place);
    let cell = folder.run(&plan.index.cells[0].id);
    let files = [folder.path().join("sweep.json"), cell.join(run::RESULTS), cell.join(run::RECORD)];
    let others = super::bytes_below(folder.path());
    let target = |file| {
        let folder = folder.clone();
        let read = move || -> anyhow::Result<usize> {
            let index = Index::read(folder.path())?;
            let outcomes = folder.outcomes(&index)?;
            Ok(table::write(&index, &outcomes, folder.path())?.len())
        };
        answer(read()).expect("a sound sweep").expect("a sound sweep");
        Target { file, kind: Kind::Json, room: PLAN, others, read: Box::new(move || answer(read())) }
    };
    files.into_iter().map(target).collect()
}

/// What a task of a cluster reads of its cell.
fn orders(place: &Path) -> Vec<Target> {
    let (folder, plan) = folder(place);
    let id = plan.index.cells[1].id.clone();
    let file = folder.config(&id).with_extension("json");
    let read = move || answer(folder.order(&id));
    assert_eq!(read(), Ok(Ok(())), "a sound cell");
    vec![Target { file, kind: Kind::Json, room: RECORDS, others: 0, read: Box::new(read) }]
}
