//! The page of `--html`: a well-formed file that holds the Gaussians of the run and keeps to its budget.

use std::fs;
use std::path::{Path, PathBuf};

use base64::Engine;
use base64::engine::general_purpose::STANDARD;
use bytesize::ByteSize;
use mvfusion_cli::command;
use mvfusion_cli::export::eyes;
use mvfusion_cli::progress::Verbosity;
use mvfusion_data::keyframes::{BranchLayout, Keyframes, Quantity, decode};
use mvfusion_data::{GaussianCloud, sigmoid};
use mvfusion_model::config::Branches;
use mvfusion_model::model::gaussians::SH_C0;
use mvfusion_model::model::harmonics::mean_colours;
use serde_json::Value;

use super::Run;
use crate::training::config;

/// Tolerance for rounding in single precision, beside half a step.
const ROUNDING: f32 = 1e-5;

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
    assert!(said.contains(" dB between keyframes") && said.contains("page.html"), "{said}");
    assert!(!run.place.path().join("unused").exists(), "no folder is made");
    let (scene, branches) = read(&path);
    let [static_, dynamic] = branches.as_slice() else { panic!("two branches") };
    assert_eq!(static_.times().len(), 1);
    let training_times = run.scene.training_times();
    let has = |time: &f64| dynamic.times().contains(time);
    assert!(training_times.iter().all(has) && dynamic.times().is_sorted(), "{:?}", dynamic.times());
    let model = run.model();
    let wanted = run.moved(&model, training_times[1]).to_cloud().expect("read").at_degree(model.dynamic.sh_degree);
    assert_same_gaussians(&run, &scene["dynamic"], &dynamic.at(training_times[1]), &wanted);
    let wanted = model.static_.as_ref().expect("a static branch");
    let wanted = wanted.to_cloud().expect("read").at_degree(wanted.sh_degree);
    assert_same_gaussians(&run, &scene["static"], &static_.at(0.0), &wanted);
    let cameras = scene["cameras"].as_array().expect("a list");
    assert!(cameras.len() > 1 && cameras[0]["rotation"].as_array().is_some_and(|rows| rows.len() == 9));
}

/// Asserts that each Gaussian of a page is one of the model up to half a step of each quantity. The order is another
/// one, and those that cannot be seen are missing.
fn assert_same_gaussians(run: &Run, layout: &Value, found: &GaussianCloud, wanted: &GaussianCloud) {
    assert!(!found.is_empty() && found.len() <= wanted.len());
    let layout: BranchLayout = serde_json::from_value(layout.clone()).expect("a layout");
    let half = |quantity: Quantity| {
        let track = layout.tracks.iter().find(|track| track.name == quantity).expect("a track");
        0.5 * track.step as f32 + ROUNDING
    };
    let eyes = eyes(&run.scene);
    let colours = [found, wanted].map(|cloud| mean_colours(cloud, &eyes));
    // The mean is kept as far as no eye sees a colour that is cut at black.
    let seen: Vec<_> = eyes.iter().flat_map(|&eye| [found, wanted].map(|cloud| mean_colours(cloud, &[eye]))).collect();
    let share = |logit: f32| sigmoid(logit) as f32;
    let largest = |a: &[f32], b: &[f32]| a.iter().zip(b).map(|(a, b)| (a - b).abs()).fold(0.0, f32::max);
    let masks = |cloud: &GaussianCloud, row: usize| cloud.mask_logits.as_ref().map_or([0.0; 3], |m| m[row].map(share));
    for row in 0..found.len() {
        // By how much a Gaussian of the model is off, in the largest allowed differences.
        let excess = |index: usize| {
            let of = |off: f32, quantity: Quantity| off / half(quantity);
            let colour = (0..3).map(|channel| {
                let off = (colours[0][row][channel] - colours[1][index][channel]).abs();
                let is_cut = seen.chunks(2).any(|pair| pair[0][row][channel].min(pair[1][index][channel]) == 0.0);
                if is_cut { 0.0 } else { off / SH_C0 as f32 }
            });
            let opacities = [found.opacity_logits[row], wanted.opacity_logits[index]].map(share);
            [
                of(largest(&found.means[row], &wanted.means[index]), Quantity::Mean),
                of(largest(&found.log_scales[row], &wanted.log_scales[index]), Quantity::LogScale),
                of((opacities[0] - opacities[1]).abs(), Quantity::Opacity),
                // The brightness is rounded once to finer steps before.
                largest(&masks(found, row), &masks(wanted, index)) / (0.54 / 255.0),
                of(colour.fold(0.0, f32::max), Quantity::ShDc),
            ]
        };
        let largest = |index: usize| excess(index).into_iter().fold(0.0, f32::max);
        let nearest = (0..wanted.len()).min_by(|&a, &b| largest(a).total_cmp(&largest(b))).expect("some");
        assert!(largest(nearest) <= 1.0, "Gaussian {row}: centre, sizes, opacity, mask, colour {:?}", excess(nearest));
    }
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
    let error = command::export(&args, Verbosity::SILENT, &mut Vec::new()).expect_err("refused").to_string();
    assert!(error.contains("10.0 kB") && error.contains("--size"), "{error}");
    assert!(!run.place.path().join("none.html").exists());
    args.page.html = Some(Some(run.place.path().join("large.html")));
    let error = command::export(&args, Verbosity::SILENT, &mut Vec::new()).expect_err("refused").to_string();
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
