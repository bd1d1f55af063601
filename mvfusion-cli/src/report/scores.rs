//! The section of the metrics: means by layer and region, under each protocol.

use std::collections::BTreeMap;

use maud::{Markup, html};
use mvfusion_model::evaluation::{LayerScores, Metric, Protocol, Scores};

use super::files::{Found, RunFiles};
use super::meaning::{meaning, protocol_of, why_absent};
use super::snippet::{notice, number};
use super::views::views;
use crate::run::{LpipsWeights, Results};
use crate::table::what_photos_show;

/// The metrics of a run.
pub(super) fn scores(files: &RunFiles) -> Markup {
    let own = match &files.results {
        Ok(results) => means(results),
        Err(missing) => notice(missing),
    };
    let views = match &files.per_view {
        Ok(per_view) => views(per_view),
        Err(missing) => notice(missing),
    };
    html! {
        (own)
        @for (protocol, results) in &files.others { (by_another(*protocol, results, &files.results)) }
        h3 { "Per-view metrics" }
        (views)
    }
}

/// The metrics of the run under another protocol.
fn by_another(protocol: Protocol, results: &Found<Results>, own: &Found<Results>) -> Markup {
    let hashes = [results, own].map(|found| found.as_ref().ok().map(|found| found.params_sha256.as_str()));
    let is_stale = matches!(hashes, [Some(other), Some(own)] if other != own);
    html! {
        h3 { "Metrics under the protocol " (protocol.name()) }
        @if is_stale {
            p.note { "The parameters have changed since these metrics were computed." }
        }
        @match results {
            Ok(results) => (means(results)),
            Err(missing) => (notice(missing)),
        }
    }
}

/// The part of an image that is compared.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Extent {
    /// The whole image.
    Picture,
    /// Only the pixels of a region.
    Region,
}

/// A row of the table: what is compared, its metrics, and the reason if there are none.
struct Row {
    name: String,
    title: &'static str,
    extent: Extent,
    scores: Option<LayerScores>,
    absent: &'static str,
}

fn rows(scores: &Scores, results: &Results) -> [Row; 5] {
    let no_static = match results.gaussians.static_ {
        None => "the model has no static branch",
        Some(_) => "no clean background is known",
    };
    let no_region = match scores.region_source {
        None => "no masks were given, and no camera is static",
        Some(_) => "it is empty in every view",
    };
    [
        Row {
            name: scores.label("composed"),
            title: "the composed render compared with the photo",
            extent: Extent::Picture,
            scores: Some(scores.composed),
            absent: "not scored",
        },
        Row {
            name: scores.label("static"),
            title: "the static branch compared with the clean background",
            extent: Extent::Picture,
            scores: scores.static_,
            absent: no_static,
        },
        Row {
            name: scores.label("dynamic_region"),
            title: "the composed render compared with the photo, where something moves",
            extent: Extent::Region,
            scores: scores.dynamic_region,
            absent: no_region,
        },
        Row {
            name: scores.label("still_region"),
            title: "the composed render compared with the photo, where nothing moves",
            extent: Extent::Region,
            scores: scores.still_region,
            absent: no_region,
        },
        Row {
            name: scores.label("movers"),
            title: "the composed render compared with the photo, where a mover is in front",
            extent: Extent::Region,
            scores: scores.movers,
            absent: "movers are known only in built-in scenes, or none is visible in these views",
        },
    ]
}

fn means(results: &Results) -> Markup {
    html! {
        (layers("Held-out views", &results.test, results))
        @if let Some(training) = &results.training_views {
            (layers("Training views", training, results))
        }
        p.protocol { b { "Protocol. " } (results.protocol) "." }
    }
}

/// The table of a set of views, and the metrics outside the table.
fn layers(caption: &str, scores: &Scores, results: &Results) -> Markup {
    let rows = rows(scores, results);
    let is_known = |metric: &Metric| rows.iter().any(|row| row.scores.is_some_and(|s| metric.of(&s).is_some()));
    let metrics = protocol_of(&results.protocol).metrics();
    let (known, unknown): (Vec<Metric>, Vec<Metric>) = metrics.iter().copied().partition(is_known);
    html! {
        div.scroll {
            table.scores {
                caption { (caption) }
                thead { tr {
                    th scope="col" {}
                    @for metric in known.iter().copied() {
                        th scope="col" title=(meaning(metric)) { (metric.label()) " " (metric.better().arrow()) }
                    }
                } }
                tbody {
                    @for row in &rows { tr {
                        th scope="row" title=(row.title) { (row.name) }
                        @for metric in known.iter().copied() { (cell(row, metric)) }
                    } }
                }
            }
        }
        (beside(scores))
        @if !unknown.is_empty() {
            p.note { "Not available: " (excuses(&unknown, &results.lpips)) "." }
        }
    }
}

/// The missing metrics, grouped by reason.
fn excuses(unknown: &[Metric], lpips: &BTreeMap<String, LpipsWeights>) -> String {
    let mut excuses: Vec<(String, Vec<&str>)> = Vec::new();
    for &metric in unknown {
        let why = why_absent(metric, lpips);
        match excuses.iter_mut().find(|(other, _)| *other == why) {
            Some((_, labels)) => labels.push(metric.label()),
            None => excuses.push((why, vec![metric.label()])),
        }
    }
    excuses.iter().map(|(why, labels)| format!("{} ({why})", labels.join(", "))).collect::<Vec<_>>().join("; ")
}

fn cell(row: &Row, metric: Metric) -> Markup {
    match row.scores.and_then(|scores| metric.of(&scores)) {
        Some(value) => html! { td title=(value) { (number(value, metric.decimals())) } },
        None => {
            let reason = row.scores.map_or(row.absent, |scores| why_blank(row.extent, metric, &scores));
            html! { td.absent title=(reason) { "\u{2013}" } }
        }
    }
}

/// Why a row with other metrics lacks one that another row has.
fn why_blank(extent: Extent, metric: Metric, scores: &LayerScores) -> &'static str {
    match (extent, metric) {
        (_, Metric::Psnr) => "every image equals its reference after rounding, so PSNR is infinite",
        (_, Metric::PsnrExact) if scores.psnr.is_none() => "every image equals its reference, so PSNR is infinite",
        (Extent::Region, Metric::MsSsim | Metric::DSsim) => {
            "MS-SSIM multiplies means over five scales of the whole image, so it has no map to select a region from"
        }
        (Extent::Region, Metric::SsimValid) => {
            "all of its pixels are in the 5-pixel border, or the run\u{2019}s version did not support this metric"
        }
        _ => "not written by this run\u{2019}s version",
    }
}

/// The metrics that do not belong to a layer: difference of regions, overlap of masks, small movers and flicker.
fn beside(scores: &Scores) -> Markup {
    let temporal = scores.temporal.unwrap_or_default();
    let metrics = [
        (
            "mask IoU \u{2191}",
            "overlap of the predicted and the given mask, over the pixels of all views",
            scores.mask_iou,
        ),
        (
            "recall of small movers \u{2191}",
            "share of the pixels of small moving components (below 1 % of the image) that the predicted mask covers, \
             over all views",
            scores.small_movers.map(|small| small.recall),
        ),
        ("T-LPIPS-alex \u{2193}", "mean |LPIPS(renders) - LPIPS(photos)| of consecutive frames", temporal.t_lpips_alex),
        ("T-LPIPS-vgg \u{2193}", "the same with VGG-16", temporal.t_lpips_vgg),
        (
            "consecutive LPIPS-alex",
            "LPIPS of each render and the previous one; includes motion",
            temporal.consecutive_lpips_alex,
        ),
        ("consecutive LPIPS-vgg", "the same with VGG-16", temporal.consecutive_lpips_vgg),
    ];
    let known: Vec<_> = metrics.into_iter().filter_map(|(name, title, value)| Some((name, title, value?))).collect();
    html! {
        @if !known.is_empty() || scores.dynamic_minus_still_psnr.is_some() || scores.composed_shows.is_some() {
            ul.beside {
                @if let Some(shown) = scores.composed_shows { li { "composed shows " b { (what_photos_show(shown)) } } }
                @if let Some(difference) = scores.dynamic_minus_still_psnr {
                    li title="PSNR of the dynamic region minus PSNR of the still region" {
                        "dynamic - still region " b { (number(difference, 2)) } " dB"
                    }
                }
                @for (name, title, value) in known { li title=(title) { (name) " " b { (number(value, 4)) } } }
                @if let Some(small) = scores.small_movers {
                    li { "small movers " b { (small.components) } " components" }
                }
            }
        }
    }
}

#[cfg(test)]
pub(super) mod tests {
    use serde_json::{Map, Value, json};

    use super::*;

    /// Metrics that are all known and all different.
    pub(in crate::report) fn known() -> LayerScores {
        let numbered = Metric::ALL.into_iter().zip(1..);
        let metrics: Map<String, Value> =
            numbered.map(|(metric, number)| (metric.name().to_owned(), json!(number))).collect();
        serde_json::from_value(Value::Object(metrics)).expect("metrics")
    }

    #[test]
    fn a_dash_tells_what_a_region_cannot_have_from_what_this_one_lacks() {
        let nothing = LayerScores::default();
        assert!(why_blank(Extent::Region, Metric::MsSsim, &known()).contains("has no map"));
        assert!(why_blank(Extent::Region, Metric::SsimValid, &known()).contains("5-pixel border"));
        for extent in [Extent::Picture, Extent::Region] {
            assert!(why_blank(extent, Metric::Psnr, &known()).contains("infinite"));
            assert!(why_blank(extent, Metric::PsnrExact, &nothing).contains("infinite"));
            // The rounded pictures differ, so those as rendered do.
            assert!(why_blank(extent, Metric::PsnrExact, &known()).contains("version"));
            assert!(why_blank(extent, Metric::Ssim, &known()).contains("version"));
        }
        assert!(why_blank(Extent::Picture, Metric::MsSsim, &known()).contains("version"));
    }
}
