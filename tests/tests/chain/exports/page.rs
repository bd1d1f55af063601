//! The page of `--html`: a well-formed file that holds the Gaussians of the run and keeps to its budget.

use std::fs;
use std::path::{Path, PathBuf};

use base64::Engine;
use base64::engine::general_purpose::STANDARD;
use bytesize::ByteSize;
use mvfusion_cli::command;
use mvfusion_cli::progress::Verbosity;
use mvfusion_data::GaussianCloud;
use mvfusion_data::keyframes::{BranchLayout, Keyframes, decode};
use mvfusion_model::config::Branches;
use serde_json::Value;

use super::{Run, numbers};
use crate::training::config;

/// Tolerance for rounding in single precision, beside half a step.
const ROUNDING: f64 = 1e-5;

/// What stands between two texts.
fn between<'a>(text: &'a str, before: &str, after: &str) -> &'a str {
    let (_, rest) = text.split_once(before).unwrap_or_else(|| panic!("no `{before}`"));
    rest.split_once(after).unwrap_or_else(|| panic!("no `{after}` after `{before}`")).0
}

/// The description and the branches of a page.
fn read(path: &Path) -> (Value, Vec<Keyframes>) {
    let html = fs::read_to_string(path).expect("read");
    let scene: Value =
        serde_json::from_str(between(&html, r#"<script type="application/json" id="scene">"#, "</script>"))
            .expect("JSON");
    let gaussians = between(&html, r#"<script type="text/plain" id="gaussians">"#, "</script>");
    let layouts: Vec<BranchLayout> = ["static", "dynamic"]
        .into_iter()
        .filter(|name| !scene[name].is_null())
        .map(|name| serde_json::from_value(scene[name].clone()).expect("a layout"))
        .collect();
    let branches = decode(&layouts, &STANDARD.decode(gaussians).expect("base64")).expect("unpacked");
    (scene, branches)
}

impl Run {
    /// Exports a page into the file of this name, with further arguments; returns its path and what was said.
    fn page(&self, name: &str, size: ByteSize) -> (PathBuf, String) {
        let path = self.place.path().join(name);
        let said = self.export_saying("unused", |args| {
            (args.page.html, args.page.size) = (Some(Some(path.clone())), size);
        });
        (path, said)
    }
}

#[test]
fn a_page_holds_the_gaussians_of_each_keyframe_up_to_half_a_step() {
    let run = Run::new(config());
    let (path, said) = run.page("page.html", ByteSize::mb(20));
    assert!(said.contains("PSNR") && said.contains("page.html"), "{said}");
    assert!(!run.place.path().join("unused").exists(), "no folder is made");
    let (scene, branches) = read(&path);
    let [static_, dynamic] = branches.as_slice() else { panic!("two branches") };
    assert_eq!(static_.times().len(), 1);
    let training_times = run.scene.training_times();
    let has = |time: &f64| dynamic.times().contains(time);
    assert!(training_times.iter().all(has) && dynamic.times().is_sorted(), "{:?}", dynamic.times());
    let model = run.model();
    let time = training_times[1];
    let wanted = run.moved(&model, time);
    let means = numbers(wanted.means.clone());
    let step = scene["dynamic"]["tracks"][0]["step"].as_f64().expect("a step");
    assert!(step > 0.0 && dynamic.count() > 0 && dynamic.count() <= means.len() / 3);
    // The order is another one, and those that cannot be seen are missing.
    let cloud: GaussianCloud = dynamic.at(time);
    for mean in &cloud.means {
        let is_near =
            |row: &[f64]| row.iter().zip(mean).all(|(a, b)| (a - f64::from(*b)).abs() <= 0.5 * step + ROUNDING);
        assert!(means.chunks(3).any(is_near), "{mean:?} is no Gaussian of the run");
    }
    assert_eq!(cloud.mask_logits.expect("masks").len(), dynamic.count());
    let cameras = scene["cameras"].as_array().expect("a list");
    assert!(cameras.len() > 1 && cameras[0]["rotation"].as_array().is_some_and(|rows| rows.len() == 9));
}

#[test]
fn a_page_loads_nothing_and_escapes_what_it_shows() {
    let mut run = Run::new(config());
    run.config.scene.data = run.config.scene.data.as_ref().map(|data| {
        let hostile = data.with_file_name("<b>&\"'scene");
        fs::rename(data, &hostile).expect("renamed");
        hostile
    });
    let text = mvfusion_cli::config::to_toml(&run.config).expect("TOML");
    fs::write(run.folder().join("config.toml"), text).expect("written");
    let (path, _) = run.page("page.html", ByteSize::mb(20));
    let html = fs::read_to_string(&path).expect("read");
    assert!(html.starts_with("<!DOCTYPE html>") && html.ends_with("</html>"));
    assert!(!html.contains("<b>"), "the name is text");
    assert!(html.contains("default-src 'none'"));
    for forbidden in ["http://", "https://", " src="] {
        let shown = html.split(forbidden).count() - 1;
        assert_eq!(shown, 0, "{forbidden}");
    }
    assert!(read(&path).0["title"].as_str().is_some_and(|title| title.contains("<b>")));
}

#[test]
fn a_smaller_budget_leaves_out_more_and_one_that_is_too_small_is_refused() {
    let run = Run::new(config());
    let (large, _) = run.page("large.html", ByteSize::mb(20));
    let full = fs::metadata(&large).expect("there").len();
    let (player, gaussians) = {
        let html = fs::read_to_string(&large).expect("read");
        let gaussians = between(&html, r#"<script type="text/plain" id="gaussians">"#, "</script>").len() as u64;
        (full - gaussians, gaussians)
    };
    let budget = ByteSize(player + gaussians / 2);
    let (small, _) = run.page("small.html", budget);
    assert!(fs::metadata(&small).expect("there").len() <= budget.as_u64());
    let [before, after] = [large, small].map(|path| read(&path).1.pop().expect("a branch"));
    let numbers = |frames: &Keyframes| frames.count() * (frames.times().len() + frames.sh_degree());
    assert!(numbers(&after) < numbers(&before) && after.times().last() == before.times().last());

    let mut args = None;
    run.export_saying("used", |given| args = Some(given.clone()));
    let mut args = args.expect("arguments");
    (args.page.html, args.page.size) = (Some(Some(run.place.path().join("none.html"))), ByteSize::kb(10));
    let error = command::export(&args, Verbosity::Silent, &mut Vec::new()).expect_err("refused").to_string();
    assert!(error.contains("10.0 kB") && error.contains("--size"), "{error}");
    assert!(!run.place.path().join("none.html").exists());
    args.page.html = Some(Some(run.place.path().join("large.html")));
    let error = command::export(&args, Verbosity::Silent, &mut Vec::new()).expect_err("refused").to_string();
    assert!(error.contains("large.html exists") && error.contains("--force"), "{error}");
}

#[test]
fn a_model_of_one_branch_has_a_page_without_masks() {
    let mut config = config();
    config.model.branches = Branches::Dynamic;
    config.loss.composed_dssim = 0.0;
    let run = Run::new(config);
    let (path, _) = run.page("one.html", ByteSize::mb(20));
    let (scene, branches) = read(&path);
    assert!(scene["static"].is_null() && branches.len() == 1 && branches[0].at(0.0).mask_logits.is_none());
}
