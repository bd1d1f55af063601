//! The head of the page: the name of the run, and its main metrics.

use std::borrow::Cow;

use maud::{Markup, html};
use mvfusion_model::evaluation::{LayerScores, LpipsVariant, Metric, Scores};
use serde_json::Value;

use super::files::RunFiles;
use super::meaning::meaning;
use super::snippet::number;
use crate::clock::spoken;
use crate::memory;
use crate::run::Results;

/// The scene's name, or the folder's.
pub(super) fn title(files: &RunFiles) -> String {
    files.recorded(&["scene", "name"]).unwrap_or_else(|| {
        let name = files.folder.file_name().map(|name| name.to_string_lossy().into_owned());
        name.unwrap_or_else(|| "run".to_owned())
    })
}

/// The title, and two lines of facts about the run.
pub(super) fn head(files: &RunFiles) -> Markup {
    let of = |path: &[&str]| files.recorded(path);
    let views = of(&["scene", "train_views"]).zip(of(&["scene", "test_views"]));
    let what = [
        of(&["preset"]).map(|preset| ("preset", preset)),
        of(&["seed"]).map(|seed| ("seed", seed)),
        views.map(|(train, test)| ("views", format!("{train} training, {test} held out"))),
        of(&["device"]).map(|device| ("device", device)),
    ];
    let when = [
        of(&["started"]).map(|time| ("started", legible(&time))),
        of(&["finished"]).map(|time| ("finished", legible(&time))),
        of(&["version"]).map(|version| ("mvfusion", version)),
        git(files).map(|state| ("git", state)),
    ];
    html! {
        header {
            p.kind { "MVFusion-GS run" }
            h1 { (title(files)) }
            @for facts in [what, when] {
                p.facts { @for (name, value) in facts.into_iter().flatten() { span { (name) " " b { (value) } } } }
            }
        }
    }
}

/// A time of the record, such as `2026-03-09T17:04:05Z`, in a readable form.
fn legible(time: &str) -> String {
    time.strip_suffix('Z').map_or(time.to_owned(), |time| format!("{} UTC", time.replace('T', " ")))
}

/// The git state of the sources, if it was recorded: a text, or a commit with further values.
fn git(files: &RunFiles) -> Option<String> {
    match files.record.as_ref().ok()?.get("git")? {
        Value::String(text) => Some(text.clone()),
        Value::Object(parts) => {
            let commit: String = parts.get("commit")?.as_str()?.chars().take(12).collect();
            let is_dirty = parts.get("dirty").and_then(Value::as_bool).unwrap_or(false);
            Some(if is_dirty { format!("{commit} with local changes") } else { commit })
        }
        _ => None,
    }
}

/// A main metric.
struct Card {
    name: Cow<'static, str>,
    title: &'static str,
    value: String,
    unit: &'static str,
}

/// The main metrics of the run.
pub(super) fn headline(files: &RunFiles) -> Markup {
    let Ok(results) = &files.results else { return html! {} };
    html! {
        div.cards {
            @for card in cards(results) {
                div.card title=(card.title) {
                    span.name { (card.name) }
                    span.value { (card.value) @if !card.unit.is_empty() { small { " " (card.unit) } } }
                }
            }
        }
    }
}

fn cards(results: &Results) -> impl Iterator<Item = Card> {
    quality(&results.test).into_iter().chain(cost(results)).flatten()
}

/// The quality of the renders.
fn quality(test: &Scores) -> [Option<Card>; 7] {
    let metric = |name: &str, metric: Metric, value: Option<f64>| {
        let (name, unit) = (Cow::from(name.to_owned()), metric.unit().unwrap_or_default());
        value.map(|value| Card { name, title: meaning(metric), value: number(value, metric.decimals()), unit })
    };
    let (static_, region) = (test.static_.unwrap_or_default(), test.dynamic_region.unwrap_or_default());
    let of_part = |layer: &str, scores: LayerScores| {
        let (name, source) = test.label_and_source(layer);
        let source = source.map_or(String::new(), |source| format!(" ({})", source.words()));
        metric(&format!("{name} PSNR{source}"), Metric::Psnr, scores.psnr)
    };
    let overlap = test.mask_iou.map(|value| Card {
        name: "mask IoU".into(),
        title: "overlap of the predicted and the given mask",
        value: number(value, 3),
        unit: "",
    });
    [
        metric("PSNR", Metric::Psnr, test.composed.psnr),
        metric("SSIM", Metric::Ssim, test.composed.ssim),
        metric("LPIPS-alex", Metric::Lpips(LpipsVariant::ALEX), test.composed.lpips_alex),
        metric("static PSNR", Metric::Psnr, static_.psnr),
        of_part("dynamic_region", region),
        of_part("movers", test.movers.unwrap_or_default()),
        overlap,
    ]
}

/// The cost of the renders.
fn cost(results: &Results) -> [Option<Card>; 5] {
    let gaussians = Card {
        name: "Gaussians".into(),
        title: "total of both branches",
        value: (results.gaussians.static_.unwrap_or(0).saturating_add(results.gaussians.dynamic)).to_string(),
        unit: "",
    };
    let time = results.train.map(|train| Card {
        name: "training".into(),
        title: "time of all steps",
        value: spoken(train.seconds),
        unit: "",
    });
    let disk = results.size.map(|size| Card {
        name: "model".into(),
        title: "size of all learned parameters on disk",
        value: memory::size(size.parameters as f64),
        unit: "",
    });
    let peak = results.train.and_then(|train| train.peak_memory).map(|bytes| Card {
        name: "memory".into(),
        title: "most resident memory of the training process",
        value: memory::size(bytes as f64),
        unit: "",
    });
    let speed = results.speed.map(|speed| Card {
        name: "rendering".into(),
        title: "frame rate on the held-out views, with all parts of the model and without transfers to the host",
        value: number(speed.fps, 1),
        unit: "FPS",
    });
    [Some(gaussians), disk, time, peak, speed]
}
