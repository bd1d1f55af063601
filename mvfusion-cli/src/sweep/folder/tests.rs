use super::*;
use crate::sweep::grid::Grid;
use crate::sweep::plan::Additions;

fn in_folder() -> (tempfile::TempDir, SweepFolder) {
    let folder = tempfile::tempdir().expect("folder");
    let sweep = SweepFolder::new(folder.path()).expect("a path");
    (folder, sweep)
}

#[test]
fn a_grid_or_cells_of_somebody_else_are_not_written_over() {
    let (folder, sweep) = in_folder();
    let refusal = || sweep.check("mine").expect_err("refused").to_string();
    fs::create_dir(folder.path().join(CELLS)).expect("made");
    fs::write(folder.path().join(CELLS).join("a.toml"), "x").expect("written");
    sweep.check("mine").expect("a sweep that was killed as it began");
    fs::create_dir(folder.path().join(CELLS).join("a")).expect("made");
    assert!(refusal().contains("`cells`, but no sweep"), "{}", refusal());
    fs::write(folder.path().join(GRID), "mine").expect("written");
    sweep.check("mine").expect("a sweep that was killed before its index");
    fs::remove_dir_all(folder.path().join(CELLS)).expect("removed");
    fs::write(folder.path().join(GRID), "theirs").expect("written");
    assert!(refusal().contains("`grid.toml`, but no sweep"), "{}", refusal());
}

#[test]
fn a_grid_that_was_changed_in_the_folder_is_not_lost() {
    let (folder, sweep) = in_folder();
    let write = |name: &str, text: &str| fs::write(folder.path().join(name), text).expect("written");
    let index = serde_json::json!({ "grid_sha256": sha256(b"old") });
    write(INDEX, &index.to_string());
    sweep.check("new").expect("the grid is not there");
    write(GRID, "old");
    sweep.check("new").expect("the grid that is given has changed");
    write(GRID, "own");
    let said = sweep.check("new").expect_err("refused").to_string();
    assert!(said.contains("grid.toml was changed") && said.contains("move it away"), "{said}");
    sweep.check("own").expect("the changed grid itself is given");
    write(INDEX, r#"{ "name": "of an earlier version" }"#);
    sweep.check("new").expect("nothing tells whether it was changed");
}

#[test]
fn a_sweep_without_any_cell_of_the_grid_is_noticed() {
    let (_folder, sweep) = in_folder();
    let grids = tempfile::tempdir().expect("folder");
    let text = |seeds: &str| {
        format!("title = \"a test\"\npreset = \"quickstart\"\nseeds = {seeds}\n[[scenes]]\nname = \"video\"\n")
    };
    let plan = |seeds: &str| {
        let path = grids.path().join("grid.toml");
        fs::write(&path, text(seeds)).expect("written");
        Plan::new(&Grid::read(&path).expect("a grid"), &Additions::default()).expect("planned")
    };
    let first = plan("[1, 2]");
    assert!(!sweep.has_other_cells(&first.index), "there is no sweep");
    sweep.prepare(&text("[1, 2]"), &first).expect("written");
    assert!(!sweep.has_other_cells(&plan("[2, 3]").index));
    assert!(sweep.has_other_cells(&plan("[3]").index));
}

#[test]
fn a_run_is_measured_once_every_wanted_network_has_looked_at_it_with_the_wanted_weights() {
    let mut results = run::specimen(Scores::default());
    let wanted = |networks: &[(&str, &str)]| {
        let lpips = networks.iter().map(|&(network, sha256)| (network.to_owned(), sha256.to_owned())).collect();
        Wanted { lpips_weights: Some("weights".into()), lpips, ..Wanted::default() }
    };
    // Nothing is missed of a folder that has no network of a column.
    assert!(is_measured(&results, &wanted(&[])));
    assert!(!is_measured(&results, &wanted(&[("alex", "a")])));
    results.lpips.insert("alex".into(), LpipsWeights::WeightsSha256("a".into()));
    assert!(is_measured(&results, &wanted(&[("alex", "a")])));
    assert!(!is_measured(&results, &wanted(&[("alex", "other")])), "other weights");
    assert!(!is_measured(&results, &wanted(&[("alex", "a"), ("vgg", "v")])), "a further network");
    assert!(!is_measured(&results, &wanted(&[("vgg", "v")])), "another network");
    results.lpips.insert("vgg".into(), LpipsWeights::WeightsSha256("v".into()));
    assert!(is_measured(&results, &wanted(&[("alex", "a"), ("vgg", "v")])));
    let timed = Wanted { speed_frames: 1, ..wanted(&[("alex", "a")]) };
    assert!(!is_measured(&results, &timed), "no speed");
    let speed = |frames| run::RenderSpeed { width: 8, height: 8, warm_up: 0, frames, fps: 1.0, fps_without_mfta: None };
    results.speed = Some(speed(2));
    assert!(!is_measured(&results, &timed), "over other frames");
    results.speed = Some(speed(1));
    assert!(is_measured(&results, &timed));
}
