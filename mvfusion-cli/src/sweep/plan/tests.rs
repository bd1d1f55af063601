use std::fs;
use std::path::Path;

use super::*;
use crate::failure;
use crate::sweep::shipped::SHIPPED;

/// Two scenes, two variants, an axis of two values, two seeds.
const GRID: &str = r#"
title = "a test"
preset = "quickstart"
seeds = [3, 4]
set = { train.scale = 0.5, eval.strips = 1 }

[[scenes]]
name = "video"

[[scenes]]
name = "steak"
data = "neu3d/steak"
set = { scene.downscale = 2 }

[[variants]]
name = "full"

[[variants]]
name = "w/o MFTA"
set = { motion.mfta = false }

[grid]
motion.window = [3, 5]
"#;

fn source(text: &str) -> Result<Source, UsageError> {
    let folder = tempfile::tempdir().expect("folder");
    let path = folder.path().join("test.toml");
    fs::write(&path, text).expect("written");
    Grid::read(&path)
}

fn plan(text: &str, additions: &Additions) -> anyhow::Result<Plan> {
    Plan::new(&source(text)?, additions)
}

fn cells(text: &str) -> Vec<Cell> {
    plan(text, &Additions::default()).expect("planned").index.cells
}

/// The words with which a grid is refused, which is the user's fault.
fn refusal(text: &str) -> String {
    let error = plan(text, &Additions::default()).expect_err("refused");
    assert_eq!(failure::exit_code(&error), failure::USAGE, "{error}");
    error.to_string()
}

#[test]
fn cells_are_all_combinations_seeds_slowest() {
    let Plan { index, configs } = plan(GRID, &Additions::default()).expect("planned");
    assert_eq!(index.cells.len(), 16);
    let names: Vec<String> = index.cells[..3].iter().map(|cell| cell.name(&index.axes)).collect();
    assert_eq!(
        names,
        [
            "video, full, motion.window = 3, seed 3",
            "video, full, motion.window = 5, seed 3",
            "video, w/o MFTA, motion.window = 3, seed 3"
        ]
    );
    let (cell, config) = (&index.cells[15], &configs[15]);
    assert_eq!(cell.name(&index.axes), "steak, w/o MFTA, motion.window = 5, seed 4");
    assert_eq!((config.seed, config.motion.window, config.motion.mfta), (4, 5, false));
    assert_eq!((config.scene.downscale, config.train.scale), (2.0, 0.5));
    assert_eq!(cell.steps, config.scaled().train.stages.total());
    assert_eq!(index.columns.len(), 2, "a scene a column");
}

#[test]
fn an_id_depends_on_every_key_and_on_no_place() {
    let ids = |additions: &Additions| -> Vec<String> {
        plan(GRID, additions).expect("planned").index.cells.into_iter().map(|cell| cell.id).collect()
    };
    let here = ids(&Additions::default());
    assert_eq!(here.iter().collect::<BTreeSet<_>>().len(), 16);
    let elsewhere = Additions { data_root: Some("/elsewhere".into()), ..Additions::default() };
    assert_eq!(ids(&elsewhere), here);
    let plan = plan(GRID, &elsewhere).expect("planned");
    assert_eq!(plan.configs[15].scene.data.as_deref(), Some(Path::new("/elsewhere/neu3d/steak")));
    let longer = Additions { set: vec!["train.scale=0.6".into()], ..Additions::default() };
    assert!(ids(&longer).iter().zip(&here).all(|(a, b)| a != b));
    // What may come later, or is a cache.
    let weighed = Additions { lpips_weights: Some("weights".into()), ..Additions::default() };
    assert_eq!(ids(&weighed), here);
    for output in ["scene.frame_store=\"frames\"", "train.tensorboard=true"] {
        let set = Additions { set: vec![output.into()], ..Additions::default() };
        assert_eq!(ids(&set), here, "{output}");
    }
}

#[test]
fn the_command_line_does_not_hide_what_the_grid_says() {
    let refusal = |setting: &str| {
        let additions = Additions { set: vec![setting.into()], ..Additions::default() };
        plan(GRID, &additions).expect_err("refused").to_string()
    };
    for (setting, word) in [
        ("motion.window=5", "[grid]"),
        ("motion.mfta=true", "the variant `w/o MFTA`"),
        ("seed=9", "`seeds`"),
        ("scene.data=elsewhere", "`data`"),
        ("eval.lpips_weights=elsewhere", "--lpips-weights"),
        ("train.scale", "--set"),
    ] {
        assert!(refusal(setting).contains(word), "{setting}: {}", refusal(setting));
    }
}

#[test]
fn cells_that_train_the_same_after_scaling_are_refused() {
    let intervals = GRID.replace("motion.window = [3, 5]", "motion.interval = [500, 1000]");
    let short = intervals.replace("train.scale = 0.5", "train.scale = 0.1");
    assert_eq!(cells(&intervals.replace("train.scale = 0.5", "train.scale = 1.0")).len(), 16);
    assert!(refusal(&short).contains("train identically at train.scale = 0.1"), "{}", refusal(&short));
}

#[test]
fn what_is_written_in_another_order_has_the_same_ids() {
    let other =
        GRID.replace("set = { train.scale = 0.5, eval.strips = 1 }", "set = { eval.strips = 1, train.scale = 0.5 }");
    let ids = |text| cells(text).into_iter().map(|cell| cell.id).collect::<Vec<_>>();
    assert_eq!(ids(GRID), ids(&other));
    assert_eq!(ids(GRID), ids(&GRID.replace("motion.window = [3, 5]", "\"motion.window\" = [3, 5]")));
}

#[test]
fn an_exclusion_leaves_out_what_agrees_with_all_of_it() {
    let excluding = format!("{GRID}\n[[exclude]]\nscene = \"steak\"\nvariant = \"w/o MFTA\"\nmotion.window = 3\n");
    assert_eq!(cells(&excluding).len(), 14);
    let nothing = format!("{GRID}\n[[exclude]]\nscene = \"stake\"\n");
    assert!(refusal(&nothing).contains("no cell matches this entry of `exclude`"), "{}", refusal(&nothing));
    let everything = format!("{GRID}\n[[exclude]]\nseed = 3\n[[exclude]]\nseed = 4\n");
    assert!(refusal(&everything).contains("every cell"));
    let unknown = format!("{GRID}\n[[exclude]]\nmotion.windows = 3\n");
    assert!(refusal(&unknown).contains("not `motion.windows`"), "{}", refusal(&unknown));
}

/// A key that changes only the output, with a value of its kind.
fn setting_of(key: &str) -> String {
    let value = match key {
        "train.tensorboard" => "true",
        "train.on_bad_step" => "skip",
        _ => "7",
    };
    format!("{key}={value}")
}

#[test]
fn the_papers_numbers_compare_with_its_data_and_schedule_alone() {
    let cells = cells(GRID);
    assert_eq!(
        cells[0].not_comparable.as_deref(),
        Some("built-in scene, motion.window = 3, preset quickstart, train.scale = 0.5")
    );
    let steak = cells.iter().find(|cell| cell.scene == "steak").expect("there");
    assert_eq!(steak.not_comparable.as_deref(), Some("motion.window = 3, preset quickstart, train.scale = 0.5"));
    let row = "[[paper]]\nat = { motion.window = 3 }\ncolumn = \"video\"\nvalues = { \"composed.psnr\" = 1.0 }\n";
    let full = format!("{GRID}\n{row}").replace("train.scale = 0.5, ", "").replace("\"quickstart\"", "\"neu3d\"");
    let reason = |additions: &Additions| {
        let cells = plan(&full, additions).expect("planned").index.cells;
        cells.into_iter().find(|cell| cell.scene == "steak").expect("there").not_comparable
    };
    // The strips change nothing, the variants are the paper's, and the grid says how its scenes are read.
    assert_eq!(reason(&Additions::default()), None);
    let noted = Additions { set: UNSCHEDULED.iter().map(|key| setting_of(key)).collect(), ..Additions::default() };
    assert_eq!(reason(&noted), None, "how often it is written down changes nothing either");
    let smaller = Additions { set: vec!["scene.downscale=4".into()], ..Additions::default() };
    assert_eq!(reason(&smaller).as_deref(), Some("scene.downscale = 4"));
}

#[test]
fn a_variant_with_a_schedule_of_its_own_making_is_not_the_papers() {
    let reasons = |schedule: &str| {
        let text = GRID
            .replace("train.scale = 0.5, ", "")
            .replace("\"quickstart\"", "\"neu3d\"")
            .replace("motion.mfta = false", &format!("motion = {{ mvg = false, mfta = false }}, {schedule}"))
            .replace("[grid]\nmotion.window = [3, 5]\n", "");
        let of_variant = |cell: &Cell| cell.scene == "steak" && cell.variant == "w/o MFTA";
        cells(&text).into_iter().find(of_variant).expect("there").not_comparable
    };
    // As `neu3d-degauss`, the preset of another method, has it.
    assert_eq!(reasons("train.stages = { geometry = 2000, deformation = 20000, refinement = 0 }"), None);
    assert_eq!(
        reasons("train.stages = { geometry = 2000, deformation = 19999, refinement = 0 }").as_deref(),
        Some("train.stages.deformation = 19999, train.stages.geometry = 2000, train.stages.refinement = 0")
    );
    // Half that of one method and half that of another; that of a method for other data.
    assert_eq!(
        reasons("train.stages = { geometry = 3000, deformation = 20000, refinement = 0 }").as_deref(),
        Some("train.stages.deformation = 20000, train.stages.geometry = 3000, train.stages.refinement = 0")
    );
    assert_eq!(reasons("train.batch_size = 1").as_deref(), Some("train.batch_size = 1"));
    // The preset's own, and what only says how often it is written down.
    assert_eq!(reasons("train.batch_size = 2, train.log_interval = 7, train.tensorboard = true"), None);
    // What is neither schedule nor data is what the paper compares.
    assert_eq!(reasons("loss.main = 2.0"), None);
}

#[test]
fn a_bad_grid_is_refused_with_what_is_wrong() {
    for (good, bad, words) in [
        ("train.scale = 0.5", "train.scael = 0.5", "test.toml, [set]).|`train.scael`|`train.scale`"),
        ("train.scale = 0.5", "\"train.scale\" = 0.5", "test.toml, [set]|`train.scale` without quotes"),
        ("motion.mfta = false", "motion.mtfa = false", "the variant `w/o MFTA`|`motion.mfta`"),
        ("motion.window = [3, 5]", "motion.widow = [3, 5]", "[grid]|`motion.window`"),
        ("motion.window = [3, 5]", "motion.window = []", "`motion.window` in [grid] is empty"),
        ("motion.window = [3, 5]", "motion.window = 3", "must be a list"),
        ("motion.window = [3, 5]", "motion.window = [3, 3]", "the value `3` appears twice"),
        ("motion.window = [3, 5]", "motion.window = [3, 0]", "motion.window"),
        ("motion.window = [3, 5]", "motion.window = [3, \"wide\"]", "whole number"),
        ("motion.window = [3, 5]", "motion.mfta = [true, false]", "`motion.mfta` in [grid]|the variant `w/o MFTA`"),
        ("set = { scene.downscale = 2 }", "set = { motion.mfta = true }", "the variant `w/o MFTA`|the scene `steak`"),
        ("motion.window = [3, 5]", "seed = [3, 5]", "list it in `seeds`"),
        ("seeds = [3, 4]", "seeds = []", "`seeds` is empty"),
        ("seeds = [3, 4]", "seeds = [3, 3]", "the seed `3` appears twice"),
        ("name = \"w/o MFTA\"", "name = \"full\"", "the variant `full` appears twice"),
        ("name = \"w/o MFTA\"", "name = \" \"", "the name of variant 2 is empty"),
        ("set = { motion.mfta = false }", "", "are the same run"),
        ("set = { motion.mfta = false }", "set = { seed = 5 }", "`seeds`"),
        ("set = { motion.mfta = false }", "preset = \"neu3\"", "`neu3d`"),
        ("name = \"steak\"", "name = \"video\"", "the scene `video` appears twice"),
        ("title = \"a test\"", "titel = \"a test\"", "line 2|titel"),
        ("title = \"a test\"", "title = \"a test", "not valid TOML"),
    ] {
        assert!(GRID.contains(good), "{good}");
        let said = refusal(&GRID.replacen(good, bad, 1));
        for word in words.trim_end_matches('.').split('|') {
            assert!(said.contains(word.trim_end_matches(").")), "{bad}: `{word}` is missing in: {said}");
        }
    }
}

#[test]
fn columns_and_paper_rows_belong_to_something() {
    let column = |text: &str| format!("{GRID}\n[[columns]]\n{text}\n");
    assert!(refusal(&column("title = \"a\"\nscenes = [\"stake\"]\nmetrics = [\"composed.psnr\"]")).contains("`stake`"));
    assert!(refusal(&column("title = \"a\"\nmetrics = [\"composed.pnsr\"]")).contains("Did you mean `composed.psnr`?"));
    let regions = "title = \"a\"\nmetrics = [\"dynamic_region.ms_ssim\"]";
    assert!(refusal(&column(regions)).contains("unknown metric `dynamic_region.ms_ssim`"));
    assert!(refusal(&column("title = \"a\"\nmetrics = []")).contains("no metrics"));
    assert!(refusal(&column("title = \"a\"\nmetrics = [\"speed.fps\"]")).contains("`speed_frames`"));
    let training = "title = \"a\"\nmetrics = [\"training_views.composed.psnr\"]";
    assert!(refusal(&column(training)).contains("eval.training_views = true"));
    let flicker = column("title = \"a\"\nmetrics = [\"training_views.temporal.t_lpips_alex\"]");
    cells(&flicker.replace("eval.strips = 1", "eval.strips = 1, eval.training_views = true"));
    let twice = "title = \"a\"\nscenes = [\"video\", \"video\"]\nmetrics = [\"composed.psnr\"]";
    assert!(refusal(&column(twice)).contains("the scene `video` appears twice"));
    let paper = |metric: &str, text: &str| format!("{GRID}\n[[paper]]\nvalues = {{ \"{metric}\" = 1.0 }}\n{text}\n");
    let psnr = |text: &str| paper("composed.psnr", text);
    let whole = "variant = \"full\"\ncolumn = \"video\"\nat = { motion.window = 5 }";
    plan(&psnr(whole), &Additions::default()).expect("planned");
    for (from, to, word) in [
        ("\"full\"", "\"fool\"", "`fool`"),
        ("\"video\"", "\"vidoe\"", "`vidoe`"),
        ("window = 5", "window = 4", "`motion.window = 4`"),
        ("at = { motion.window = 5 }", "", "give `at`"),
    ] {
        let said = refusal(&psnr(&whole.replace(from, to)));
        assert!(said.contains(word), "{to}: {said}");
    }
    assert!(refusal(&paper("composed.pnsr", whole)).contains("`composed.pnsr`"));
}

#[test]
fn numbers_that_sweep_json_cannot_hold_are_refused() {
    for number in ["nan", "inf", "-inf"] {
        let row = format!("variant = \"full\"\nvalues = {{ \"composed.psnr\" = {number} }}");
        let said = refusal(&with_paper(&[&row]));
        assert!(said.contains("`composed.psnr`") && said.contains("finite number"), "{said}");
    }
    for minutes in ["nan", "inf", "0", "-1.5"] {
        let expected = format!("preset = \"quickstart\"\nexpected = {{ minutes = {minutes}, on = \"a snail\" }}");
        let said = refusal(&GRID.replace("preset = \"quickstart\"", &expected));
        assert!(said.contains("`minutes` in `expected`") && said.contains("above 0"), "{said}");
    }
}

#[test]
fn differences_are_of_two_variants_of_the_grid() {
    let difference =
        |variant: &str, minus: &str| format!("{GRID}\n[[differences]]\nvariant = \"{variant}\"\nminus = \"{minus}\"\n");
    let planned = plan(&difference("full", "w/o MFTA"), &Additions::default()).expect("planned");
    assert_eq!(planned.index.differences[0].minus, "w/o MFTA");
    assert!(refusal(&difference("fool", "w/o MFTA")).contains("`fool`; the variants are `full`"));
    assert!(refusal(&difference("full", "full")).contains("with itself"));
}

/// The grid with rows of the paper in the column of its first scene.
fn with_paper(rows: &[&str]) -> String {
    let row = |row: &&str| format!("\n[[paper]]\ncolumn = \"video\"\n{row}\n");
    GRID.to_owned() + &rows.iter().map(row).collect::<String>()
}

#[test]
fn a_number_of_the_paper_is_given_once() {
    let psnr = |place: &str| format!("{place}\nvalues = {{ \"composed.psnr\" = 1.0 }}");
    let rows = |a: &str, b: &str| with_paper(&[&psnr(a), &psnr(b)]);
    for (a, b) in [
        ("variant = \"full\"\nat = { motion.window = 3 }", "variant = \"full\"\nat = { motion.window = 3.0 }"),
        // Of all variants, one of which has another row.
        ("at = { motion.window = 3 }", "variant = \"full\"\nat = { \"motion.window\" = 3 }"),
        ("literature = \"3DGS\"", "literature = \"3DGS\""),
        ("literature = \"3DGS\"\nat = { motion.window = 3 }", "literature = \"3DGS\"\nat = { motion.window = 3 }"),
    ] {
        let said = refusal(&rows(a, b));
        assert!(said.contains("two values of `composed.psnr`") && said.contains("column `video`"), "{a}, {b}: {said}");
    }
    for (a, b) in [
        ("variant = \"full\"\nat = { motion.window = 3 }", "variant = \"full\"\nat = { motion.window = 5 }"),
        ("variant = \"full\"\nat = { motion.window = 3 }", "variant = \"w/o MFTA\"\nat = { motion.window = 3 }"),
        ("literature = \"3DGS\"", "literature = \"3DGS\"\nat = { motion.window = 3 }"),
        ("literature = \"3DGS\"", "literature = \"4DGS\""),
        ("literature = \"full\"", "variant = \"full\"\nat = { motion.window = 3 }"),
    ] {
        cells(&rows(a, b));
    }
    // Two rows of one place with different metrics.
    let ssim = "literature = \"3DGS\"\nvalues = { \"composed.ssim\" = 0.9 }";
    cells(&with_paper(&[&psnr("literature = \"3DGS\""), ssim]));
}

#[test]
fn reasons_against_the_papers_numbers_belong_to_numbers_and_say_something() {
    let row = |reasons: &str| {
        let values = "values = { \"composed.psnr\" = 1.0, \"composed.ssim\" = 0.9 }";
        with_paper(&[&format!("literature = \"3DGS\"\n{values}\nnot_comparable = {reasons}")])
    };
    for good in ["{ \"composed.psnr\" = \"other views\" }", "{ \"*\" = \"a\", \"composed.ssim\" = \"b\" }"] {
        let index = plan(&row(good), &Additions::default()).expect("planned").index;
        let json = serde_json::to_string(&index).expect("written");
        assert_eq!(serde_json::from_str::<Index>(&json).expect("read"), index, "{good}");
    }
    for (bad, word) in [
        ("{ \"composed.lpips_alex\" = \"other views\" }", "`composed.lpips_alex` in `not_comparable`"),
        ("{ \"composed.pnsr\" = \"other views\" }", "`composed.pnsr` in `not_comparable`"),
        ("{ \"*\" = \" \" }", "why `*` is not comparable"),
        ("\"other views\"", "is no grid"),
    ] {
        assert!(refusal(&row(bad)).contains(word), "{bad}: {}", refusal(&row(bad)));
    }
}

#[test]
fn a_scene_and_a_variant_do_not_both_name_a_preset() {
    let scene = GRID.replacen("name = \"steak\"", "name = \"steak\"\npreset = \"neu3d\"", 1);
    assert_eq!(cells(&scene).iter().filter(|cell| cell.preset == "neu3d").count(), 8);
    let both = scene.replacen("name = \"full\"", "name = \"full\"\npreset = \"quickstart-4dgs\"", 1);
    assert!(refusal(&both).contains("both name a preset"));
}

#[test]
fn every_shipped_grid_can_be_planned() {
    for shipped in SHIPPED {
        let source = Grid::read(Path::new(shipped.name)).expect("read");
        let plan =
            Plan::new(&source, &Additions::default()).unwrap_or_else(|error| panic!("{}: {error}", shipped.name));
        // These are tables of this project; all others are tables of the paper.
        let ours =
            ["methods", "claim", "claim-small", "claim-again", "claim-nearest", "convergence", "costs", "readings"];
        let is_ours = ours.contains(&shipped.name);
        assert_eq!(source.grid.paper.is_empty(), is_ours, "{}", shipped.name);
        if source.grid.paper.is_empty() {
            continue;
        }
        let is_small = shipped.name.ends_with("-small");
        for (cell, config) in plan.index.cells.iter().zip(&plan.configs) {
            assert_eq!(config.scene.data.is_none(), is_small, "{}", shipped.name);
            assert_eq!(cell.not_comparable.is_some(), is_small, "{}: {:?}", shipped.name, cell.not_comparable);
        }
    }
}

#[test]
fn an_unknown_grid_is_refused_with_those_there_are() {
    for name in ["component", "component.toml"] {
        let error = Grid::read(Path::new(name)).expect_err("refused").to_string();
        assert!(error.contains(name) && error.contains("components-small"), "{error}");
    }
}

#[test]
fn a_seed_that_no_configuration_can_hold_is_refused_by_its_number() {
    let mut source = source(GRID).expect("read");
    source.grid.seeds = vec![u64::MAX];
    let said = Plan::new(&source, &Additions::default()).expect_err("refused").to_string();
    assert!(said.contains("test.toml") && said.contains(&u64::MAX.to_string()), "{said}");
}

#[test]
fn the_weights_of_the_columns_networks_are_wanted_and_do_not_change_ids() {
    let folder = tempfile::tempdir().expect("folder");
    fs::write(folder.path().join("lpips_vgg_f32.safetensors"), "vgg").expect("written");
    let weighed = Additions { lpips_weights: Some(folder.path().to_owned()), ..Additions::default() };
    let wanted = |grid: &str| plan(grid, &weighed).expect("planned").index.wanted.lpips;
    assert!(wanted(GRID).is_empty(), "the columns want AlexNet");
    let by_vgg = format!("{GRID}\n[[columns]]\ntitle = \"a\"\nmetrics = [\"composed.lpips_vgg\"]\n");
    assert_eq!(wanted(&by_vgg).into_keys().collect::<Vec<_>>(), ["vgg"]);
}

#[test]
fn a_grid_of_more_cells_than_can_be_planned_is_refused_before_any_is_made() {
    let numbers = |count: usize| (3..3 + count).map(|value| value.to_string()).collect::<Vec<_>>().join(", ");
    let axes = format!("motion.samples = [{0}]\nmotion.knots = [{0}]\nmodel.width = [{0}]", numbers(100));
    let said = refusal(&GRID.replace("motion.window = [3, 5]", &axes));
    assert!(said.contains("test.toml") && said.contains("more than 100000 cells"), "{said}");
}

#[test]
fn a_scene_whose_name_has_a_comma_could_not_be_chosen_and_is_refused() {
    let said = refusal(&GRID.replace("name = \"video\"", "name = \"a,b\""));
    assert!(said.contains("`a,b`") && said.contains("--scenes"), "{said}");
}
