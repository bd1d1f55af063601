//! The pages of synthetic runs: complete ones, incomplete ones, and hostile ones.

use std::fs;
use std::path::Path;

use image::{Rgb, RgbImage};
use mvfusion_model::evaluation::{LayerScores, Protocol, RegionSource, Scores, ViewScores};

use super::*;
use crate::run::{GaussianCounts, HeldOutView, PerView, Results, SceneCamera, SceneFile, specimen};

/// What would run, close an element or leave an attribute, if it were not escaped.
const HOSTILE: &str = "</style><script>alert('x')</script>\"'><img src=x onerror=alert(1)>&amp;";

fn write(folder: &Path, name: &str, text: impl AsRef<[u8]>) {
    let path = folder.join(name);
    fs::create_dir_all(path.parent().expect("a folder")).expect("made");
    fs::write(path, text).expect("written");
}

fn picture(folder: &Path, layer: &str, name: &str) {
    let path = folder.join("renders/test").join(layer).join(name);
    fs::create_dir_all(path.parent().expect("a folder")).expect("made");
    RgbImage::from_fn(16, 12, |x, y| Rgb([x as u8 * 9, y as u8 * 9, layer.len() as u8 * 15]))
        .save(path)
        .expect("saved");
}

fn scores() -> Scores {
    let layer = |psnr| LayerScores { psnr: Some(psnr), ssim: Some(0.98765), ..LayerScores::default() };
    Scores {
        composed: layer(27.345),
        dynamic_region: Some(LayerScores { psnr: Some(21.0), ..LayerScores::default() }),
        region_source: Some(RegionSource::GivenMasks),
        mask_iou: Some(0.625),
        ..Scores::default()
    }
}

fn results(protocol: &str) -> Results {
    let gaussians = GaussianCounts { static_: Some(1200), dynamic: 34 };
    Results { protocol: protocol.to_owned(), gaussians, ..specimen(scores()) }
}

/// A whole run of one view, whose every text is `text`.
fn run(text: &str) -> tempfile::TempDir {
    let folder = tempfile::tempdir().expect("folder");
    let record = serde_json::json!({
        "version": "0.1.0", "preset": text, "seed": 7, "scene": {"name": text}, "git": {"commit": text, "dirty": true},
        text: text,
    });
    write(folder.path(), "run.json", record.to_string());
    write(folder.path(), "results.json", json(&results(text)));
    let view = ViewScores { view: text.to_owned(), scores: scores() };
    let per_view =
        PerView { protocol: text.to_owned(), test: [("00000.png".to_owned(), view)].into(), field: [].into() };
    write(folder.path(), "per_view.json", json(&per_view));
    write(folder.path(), "config.toml", format!("# {text}\n[train]\nseed = 1\n"));
    write(folder.path(), "scene.json", json(&scene(text, 1)));
    let line = serde_json::json!({
        "step": 1, "stage": text, "stage_step": 1, "loss": 2.0, "psnr": 9.0, "gaussians": {"dynamic": 1},
        "steps_per_second": 3.5,
    });
    write(folder.path(), "metrics.jsonl", format!("{line}\n"));
    for layer in ["gt", "composed", "static", "mask", "motion"] {
        picture(folder.path(), layer, "00000.png");
    }
    write(folder.path(), "strips/00000.png", "never read where there are layers");
    folder
}

/// A scene of one camera that looks at this many times.
fn scene(text: &str, views: usize) -> SceneFile {
    let camera = SceneCamera {
        name: text.to_owned(),
        is_held_out: true,
        position: [0.0, 0.0, -1.0],
        axes: [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]],
        half_size: [0.5, 0.4],
        times: [0.0, 1.0],
        views,
    };
    let view = |index: usize| HeldOutView { name: text.to_owned(), time: index as f64 / 4.0, camera: 0 };
    let held_out = (0..views).map(view).collect();
    SceneFile { extent: 1.0, centre: [0.0; 3], points: None, cameras: vec![camera], held_out }
}

fn json(value: &impl serde::Serialize) -> String {
    serde_json::to_string(value).expect("written")
}

fn count(page: &str, what: &str) -> usize {
    page.matches(what).count()
}

#[test]
fn a_run_becomes_a_page_with_all_its_sections() {
    let folder = run("kitchen");
    let page = fs::read_to_string(write_report(folder.path())).expect("read");
    for anchor in ["metrics", "training", "film", "sliders", "layers", "motion", "cameras", "record", "config"] {
        assert_eq!(count(&page, &format!("<section id=\"{anchor}\"")), 1, "{anchor}");
        assert_eq!(count(&page, &format!("<a href=\"#{anchor}\">")), 2, "{anchor}");
    }
    for words in ["<h1>kitchen</h1>", "27.34", "0.9876", "0.625", "2 min 51 s", "1234", "given masks", "commit"] {
        assert!(page.contains(words), "{words} is missing");
    }
    // Each picture once: five layers, and two of the slider and the photo of the heat map are copied.
    assert_eq!((count(&page, "src=\"data:image/png"), count(&page, "data-copy=\"v0-gt\"")), (5, 2));
    assert_eq!(count(&page, "class=\"missing\""), 2, "the noscript's, and the one of the unknown key");
}

fn write_report(run: &Path) -> PathBuf {
    super::write(run).expect("a report")
}

#[test]
fn a_metric_that_is_not_known_is_a_dash_with_its_reason() {
    let folder = run(Protocol::Mvfusion.statement());
    let page = html(folder.path()).expect("a page");
    let dash = |reason: &str| format!("<td class=\"absent\" title=\"{reason}\">\u{2013}</td>");
    assert_eq!(count(&page, &dash("no clean background is known")), 2, "PSNR and SSIM of the static branch");
    assert_eq!(count(&page, &dash("not written by this run\u{2019}s version")), 1, "SSIM of the dynamic region");
    assert!(page.contains("LPIPS-alex, LPIPS-vgg, LPIPS-alex on [0,1], LPIPS-vgg on [0,1] (no folder of"), "{page}");
    let statement = maud::html! { (Protocol::Mvfusion.statement()) }.into_string();
    assert!(page.contains(&statement), "{statement}");
    assert!(!page.contains(">0.00<") && !page.contains(">0.0000<"));
}

#[test]
fn other_protocols_have_tables_of_their_own_in_a_fixed_order() {
    let folder = run(Protocol::Mvfusion.statement());
    assert!(!html(folder.path()).expect("a page").contains("Metrics under the protocol"));
    for (protocol, psnr) in [(Protocol::NerfBaselines, 24.25), (Protocol::ThreeDgs, 23.75)] {
        let composed = LayerScores { psnr: Some(psnr), ..LayerScores::default() };
        let results =
            Results { protocol: protocol.statement().to_owned(), ..specimen(Scores { composed, ..scores() }) };
        write(folder.path(), &format!("protocols/{}/results.json", protocol.name()), json(&results));
    }
    write(folder.path(), "protocols/degauss/results.json", "{\"protocol\": ");
    let page = html(folder.path()).expect("a page");
    let places = [
        "27.34",
        "Metrics under the protocol degauss",
        "protocols/degauss/results.json cannot be read",
        "`mvfusion eval RUN --protocol degauss --write` writes it again",
        "Metrics under the protocol 3dgs",
        "23.75",
        "</b>3dgs: last iteration",
        "Metrics under the protocol nerfbaselines",
        "24.25",
        "LPIPS-alex, LPIPS-vgg (no folder",
        "</b>nerfbaselines: last iteration",
        "Per-view metrics",
    ];
    let found = places.map(|words| page.find(words).unwrap_or_else(|| panic!("{words} is missing")));
    assert!(found.is_sorted(), "{found:?}");
}

#[test]
fn metrics_of_an_earlier_model_are_told_from_those_of_this_one() {
    let folder = run(Protocol::Mvfusion.statement());
    for (params, notes) in [("0", 0), ("1", 1)] {
        let protocol = Protocol::DeGauss.statement().to_owned();
        let results = Results { protocol, params_sha256: params.to_owned(), ..specimen(scores()) };
        write(folder.path(), "protocols/degauss/results.json", json(&results));
        let page = html(folder.path()).expect("a page");
        assert_eq!(count(&page, "The parameters have changed since these metrics were computed."), notes);
    }
}

#[test]
fn a_region_has_the_ssim_without_border_and_no_ms_ssim() {
    let folder = run(Protocol::Mvfusion.statement());
    let composed = LayerScores { ssim_valid: Some(0.9375), ms_ssim: Some(0.96875), ..LayerScores::default() };
    let dynamic_region = Some(LayerScores { ssim_valid: Some(0.8125), ..LayerScores::default() });
    let results = Results {
        protocol: Protocol::DeGauss.statement().to_owned(),
        ..specimen(Scores { composed, dynamic_region, ..Scores::default() })
    };
    write(folder.path(), "protocols/degauss/results.json", json(&results));
    let page = html(folder.path()).expect("a page");
    assert!(page.contains(">0.9375</td>") && page.contains(">0.8125</td>"));
    assert_eq!(count(&page, "so it has no map to select a region from"), 1, "MS-SSIM of the dynamic region");
}

#[test]
fn a_label_is_one_metric_in_all_tables_of_a_page() {
    let folder = run(Protocol::Mvfusion.statement());
    let composed = LayerScores { lpips_vgg: Some(0.0625), lpips_vgg_raw: Some(0.5625), ..LayerScores::default() };
    let scores = Scores { composed, ..Scores::default() };
    let view = ViewScores { view: "cam00/0000".to_owned(), scores };
    let per_view = PerView { protocol: String::new(), test: [("00000.png".to_owned(), view)].into(), field: [].into() };
    write(folder.path(), "per_view.json", json(&per_view));
    write(folder.path(), "results.json", json(&Results { lpips: [].into(), ..specimen(scores) }));
    for protocol in [Protocol::DeGauss, Protocol::ThreeDgs] {
        let results = Results { protocol: protocol.statement().to_owned(), lpips: [].into(), ..specimen(scores) };
        write(folder.path(), &format!("protocols/{}/results.json", protocol.name()), json(&results));
    }
    let page = html(folder.path()).expect("a page");
    // With an arrow in the tables of means, without one in that of the views.
    assert_eq!(count(&page, ">LPIPS-vgg \u{2193}</th>"), 1, "the run's own protocol");
    assert_eq!(count(&page, ">LPIPS-vgg on [0,1] \u{2193}</th>"), 3, "every protocol here");
    for head in ["LPIPS-vgg", "LPIPS-vgg on [0,1]"] {
        assert_eq!(count(&page, &format!(">{head}</th>")), 1, "{head}");
    }
    assert_eq!((count(&page, ">0.0625</td>"), count(&page, ">0.5625</td>")), (2, 4));
    let row = page.split("<th scope=\"row\">cam00/0000</th>").nth(1).expect("the view's row");
    assert!(row.starts_with("<td>0.0625</td><td>0.5625</td>"), "{row}");
}

#[test]
fn no_text_of_a_file_becomes_part_of_the_page() {
    let folder = run(HOSTILE);
    // Two views make a film.
    picture(folder.path(), "composed", "00001.png");
    write(folder.path(), "scene.json", json(&scene(HOSTILE, 2)));
    write(folder.path(), "strips/panels.json", json(&[HOSTILE; 6]));
    let page = html(folder.path()).expect("a page");
    assert!(page.contains("<figure class=\"film script\""), "{page}");
    assert_eq!((count(&page, "<script"), count(&page, "<style"), count(&page, "</style")), (1, 1, 1));
    for harm in ["<img src=x", "alert('x')</script>", "\"'>", "=alert(1)>"] {
        assert!(!page.contains(harm), "{harm}");
    }
    // It is there all the same, as text: title, heading, preset, commit's beginning, protocol, view, record, files …
    assert!(count(&page, "&lt;script&gt;alert('x')&lt;/script&gt;&quot;'&gt;") >= 10, "{page}");
}

#[test]
fn the_page_asks_for_nothing() {
    let page = html(run("kitchen").path()).expect("a page");
    let policy = page.split("Content-Security-Policy\" content=\"").nth(1).and_then(|rest| rest.split('"').next());
    assert!(policy.is_some_and(|policy| policy.starts_with("default-src 'none'; img-src data:;")), "{policy:?}");
    for address in ["http://", "https://", "url(h", "@import", "src=\"/", "href=\"/"] {
        assert!(!page.contains(address), "{address}");
    }
}

#[test]
fn a_run_of_one_file_names_all_that_is_missing() {
    let folder = tempfile::tempdir().expect("folder");
    write(folder.path(), "config.toml", "seed = 3\n");
    let page = html(folder.path()).expect("a page");
    for missing in ["metrics.jsonl", "results.json", "per_view.json", "run.json", "scene.json"] {
        assert!(page.contains(&format!("The run has no {missing}.")), "{missing}");
    }
    assert!(page.contains("mvfusion eval RUN --write") && page.contains("seed = 3") && !page.contains("<img"));
}

#[test]
fn broken_files_and_pictures_cost_their_places_alone() {
    let folder = run("kitchen");
    write(folder.path(), "results.json", "{\"protocol\": 7}");
    write(folder.path(), "per_view.json", "[]");
    write(folder.path(), "renders/test/composed/00000.png", "no picture");
    let page = html(folder.path()).expect("a page");
    for lack in [
        "results.json cannot be read",
        "per_view.json cannot be read",
        "renders/test/composed/00000.png is not an image",
    ] {
        assert!(page.contains(lack), "{lack}");
    }
    // The others are there, and the slider compares what is left.
    assert_eq!(count(&page, "src=\"data:image/png"), 4);
    assert_eq!(count(&page, "<figure class=\"slider script\""), 1);
}

#[test]
fn what_each_branch_adds_is_shown_where_the_run_has_it() {
    let folder = run("kitchen");
    let names = ["masked static", "masked dynamic"].map(|name| format!("<figcaption>{name}</figcaption>"));
    let page = html(folder.path()).expect("a page");
    assert!(!names.iter().any(|name| page.contains(name)) && !page.contains("two terms of this sum"));
    for layer in ["masked_static", "masked_dynamic"] {
        picture(folder.path(), layer, "00000.png");
    }
    let page = html(folder.path()).expect("a page");
    assert!(names.iter().all(|name| count(&page, name) == 1) && page.contains("two terms of this sum"));
    assert_eq!(count(&page, "src=\"data:image/png"), 7);
    // They can be chosen on either side of the slider.
    assert_eq!(count(&page, "<option value=\"v0-masked_dynamic\""), 2);
}

#[test]
fn without_layers_the_strips_are_shown_and_the_reason_is_given() {
    let folder = run("kitchen");
    fs::remove_dir_all(folder.path().join("renders")).expect("removed");
    write(folder.path(), "config.toml", "[eval]\npictures = false\n");
    RgbImage::from_pixel(60, 10, Rgb([5; 3])).save(folder.path().join("strips/00000.png")).expect("saved");
    let page = html(folder.path()).expect("a page");
    assert!(page.contains("eval.pictures=false") && !page.contains("type=\"range\""));
    assert_eq!(count(&page, "src=\"data:image/png"), 1);
    // Each panel has its caption if the run says what it shows.
    assert!(page.contains("From left to right") && !page.contains("class=\"captions\""));
    write(folder.path(), "strips/panels.json", json(&["ground truth", "composed", "mask"]));
    let page = html(folder.path()).expect("a page");
    let captions = "<div class=\"captions\"><span>ground truth</span><span>composed</span><span>mask</span></div>";
    assert!(page.contains(captions) && !page.contains("From left to right"), "{page}");
}

#[test]
fn a_film_has_every_view_in_every_layer_with_its_time_and_its_score() {
    let folder = run("kitchen");
    for (layer, view) in ["gt", "composed", "mask"].into_iter().flat_map(|layer| [(layer, 1), (layer, 2)]) {
        picture(folder.path(), layer, &format!("{view:05}.png"));
    }
    write(folder.path(), "scene.json", json(&scene("kitchen", 3)));
    let page = html(folder.path()).expect("a page");
    assert_eq!(count(&page, "<li data-caption="), 3);
    for (words, times) in [
        ("<data class=\"composed\" value=\"data:image/jpeg", 3),
        ("<data class=\"static\"", 1),
        ("data-caption=\"kitchen \u{b7} time 0.000 \u{b7} 27.34 dB\"", 1),
        ("data-caption=\"00002 \u{b7} time 0.500\"", 1),
        ("max=\"2\"", 1),
        ("data-kind=\"gt\"", 1),
    ] {
        assert_eq!(count(&page, words), times, "{words}");
    }
    // With a score of one view alone there is no curve.
    assert!(!page.contains("class=\"trace\""));
}

#[test]
fn a_page_of_another_program_is_not_replaced_but_an_own_one_is() {
    let folder = tempfile::tempdir().expect("folder");
    write(folder.path(), "config.toml", "x");
    write(folder.path(), "report.html", "<title>Accounts</title>");
    let error = super::write(folder.path()).expect_err("refused").to_string();
    assert!(error.contains("report.html was not written by this program"), "{error}");
    assert_eq!(fs::read_to_string(folder.path().join("report.html")).expect("read"), "<title>Accounts</title>");
    // A run that is too damaged to be known as one.
    fs::remove_file(folder.path().join("report.html")).expect("removed");
    for _ in 0..2 {
        super::write(folder.path()).expect("written");
    }
    // The folder of a run is ours, whatever lies there.
    write(folder.path(), "run.json", r#"{ "burn": "1", "preset": "a" }"#);
    write(folder.path(), "report.html", "half a p");
    super::write(folder.path()).expect("written");
}
