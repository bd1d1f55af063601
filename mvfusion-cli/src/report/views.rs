//! Per-view metrics: a curve for each PSNR, the views with the worst moving parts, and a table.

use maud::{Markup, html};
use mvfusion_model::evaluation::{LpipsVariant, Metric, Scores, ViewScores};

use super::curve::{Chart, Point, Series, Weight};
use super::snippet::number;
use crate::run::PerView;

/// Minimum number of views for a chart, and maximum number of views for an open table.
const DRAWN: usize = 8;
const FOLDED: usize = 12;
/// Number of worst views that are listed.
const WORST: usize = 4;

/// A column of the table of views.
struct ViewColumn {
    name: &'static str,
    /// The part of the image, as in [`Scores::label_and_source`]; empty for the whole image.
    part: &'static str,
    title: &'static str,
    decimals: usize,
    of: fn(&Scores) -> Option<f64>,
}

const VIEW_COLUMNS: [ViewColumn; 13] = [
    ViewColumn {
        name: Metric::Psnr.label(),
        part: "",
        title: "composed, dB",
        decimals: 2,
        of: |scores| scores.composed.psnr,
    },
    ViewColumn {
        name: Metric::Ssim.label(),
        part: "",
        title: "composed",
        decimals: 4,
        of: |scores| scores.composed.ssim,
    },
    ViewColumn {
        name: Metric::Lpips(LpipsVariant::ALEX).label(),
        part: "",
        title: "composed, network inputs in [-1, 1]",
        decimals: 4,
        of: |scores| Metric::Lpips(LpipsVariant::ALEX).of(&scores.composed),
    },
    ViewColumn {
        name: Metric::Lpips(LpipsVariant::VGG).label(),
        part: "",
        title: "composed, network inputs in [-1, 1]",
        decimals: 4,
        of: |scores| Metric::Lpips(LpipsVariant::VGG).of(&scores.composed),
    },
    ViewColumn {
        name: Metric::Lpips(LpipsVariant::ALEX_RAW).label(),
        part: "",
        title: "composed, network inputs in [0, 1]",
        decimals: 4,
        of: |scores| Metric::Lpips(LpipsVariant::ALEX_RAW).of(&scores.composed),
    },
    ViewColumn {
        name: Metric::Lpips(LpipsVariant::VGG_RAW).label(),
        part: "",
        title: "composed, network inputs in [0, 1]",
        decimals: 4,
        of: |scores| Metric::Lpips(LpipsVariant::VGG_RAW).of(&scores.composed),
    },
    ViewColumn {
        name: "static PSNR",
        part: "",
        title: "static branch compared with the clean background, dB",
        decimals: 2,
        of: |scores| scores.static_?.psnr,
    },
    ViewColumn {
        name: "dynamic region PSNR",
        part: "dynamic_region",
        title: "composed, where something moves, dB",
        decimals: 2,
        of: |scores| scores.dynamic_region?.psnr,
    },
    ViewColumn {
        name: "still region PSNR",
        part: "still_region",
        title: "composed, where nothing moves, dB",
        decimals: 2,
        of: |scores| scores.still_region?.psnr,
    },
    ViewColumn {
        name: "movers PSNR",
        part: "movers",
        title: "composed, where a mover is in front, dB",
        decimals: 2,
        of: |scores| scores.movers?.psnr,
    },
    ViewColumn {
        name: "small movers",
        part: "",
        title: "share of the pixels of small moving components (below 1 % of the image) that the mask covers",
        decimals: 4,
        of: |scores| scores.small_movers.map(|small| small.recall),
    },
    ViewColumn {
        name: "mask IoU",
        part: "",
        title: "overlap with the given mask",
        decimals: 4,
        of: |scores| scores.mask_iou,
    },
    ViewColumn {
        name: "T-LPIPS-alex",
        part: "",
        title: "flicker relative to the previous frame",
        decimals: 4,
        of: |scores| scores.temporal?.t_lpips_alex,
    },
];

impl ViewColumn {
    /// Its name, with the mask source of a region.
    fn heading(&self, views: &[&ViewScores]) -> String {
        let source = views.iter().find_map(|view| view.scores.label_and_source(self.part).1);
        self.name.to_owned() + &source.map_or(String::new(), |source| format!(" ({})", source.words()))
    }
}

/// The metrics of every view: PSNR as curves, the worst views in words, and all metrics in a table.
pub(super) fn views(per_view: &PerView) -> Markup {
    let views: Vec<&ViewScores> = per_view.test.values().collect();
    let is_known = |column: &ViewColumn| views.iter().any(|view| (column.of)(&view.scores).is_some());
    let columns: Vec<ViewColumn> = VIEW_COLUMNS.into_iter().filter(is_known).collect();
    html! {
        @if views.len() >= DRAWN {
            div.charts.single { (chart(&views).draw()) }
            (lowest(&views))
        }
        details open[views.len() <= FOLDED] {
            summary { (views.len()) " held-out views" }
            div.scroll {
                table.views.sortable {
                    thead { tr {
                        th scope="col" { "view" }
                        @for column in &columns { th scope="col" title=(column.title) { (column.heading(&views)) } }
                    } }
                    tbody {
                        @for view in &views { tr {
                            th scope="row" { (view.view) }
                            @for column in &columns { @match (column.of)(&view.scores) {
                                Some(value) => td { (number(value, column.decimals)) },
                                None => td.absent { "\u{2013}" },
                            } }
                        } }
                    }
                }
            }
        }
    }
}

/// PSNR over the views, in the order of a camera's frames.
fn chart(views: &[&ViewScores]) -> Chart<'static> {
    let curve = |layer: &str, colour, of: PsnrOf| {
        let point =
            |(index, view): (usize, &&ViewScores)| Point { x: index as f64, y: of(&view.scores).unwrap_or(f64::NAN) };
        let points = views.iter().enumerate().map(point).collect();
        Series { name: Some(name(layer, views)), colour, weight: Weight::Bold, points }
    };
    let series = vec![
        curve("composed", 0, |scores| scores.composed.psnr),
        curve("static", 1, |scores| scores.static_?.psnr),
        curve("dynamic_region", 2, |scores| scores.dynamic_region?.psnr),
        curve("movers", 3, |scores| scores.movers?.psnr),
    ];
    let known = series.into_iter().filter(|series| series.points.iter().any(|point| point.y.is_finite())).collect();
    Chart { x_title: "held-out view", ..Chart::linear("PSNR of each view, dB", known, &[]) }
}

/// A PSNR of a view.
type PsnrOf = fn(&Scores) -> Option<f64>;

/// A layer in words, with the mask source of a region.
fn name(layer: &str, views: &[&ViewScores]) -> String {
    let labels = || views.iter().map(|view| view.scores.label(layer));
    // A view without motion has no mask source.
    labels().find(|label| label.ends_with(')')).or_else(|| labels().next()).unwrap_or_default()
}

/// The views with the worst movers, or otherwise the worst dynamic region. A mean would hide a single bad frame.
fn lowest(views: &[&ViewScores]) -> Markup {
    let of_movers: PsnrOf = |scores| scores.movers?.psnr;
    let of_region: PsnrOf = |scores| scores.dynamic_region?.psnr;
    let known = |of: PsnrOf| views.iter().filter_map(move |view| Some((of(&view.scores)?, view.view.as_str())));
    let (layer, of) =
        if known(of_movers).next().is_some() { ("movers", of_movers) } else { ("dynamic_region", of_region) };
    let mut sorted: Vec<(f64, &str)> = known(of).collect();
    sorted.sort_by(|a, b| a.0.total_cmp(&b.0));
    // The mean of the two middle values of an even number.
    let middle = sorted.len() / 2;
    let median = sorted.get(middle).map(|(upper, _)| match sorted.len() % 2 {
        0 => (sorted[middle - 1].0 + upper) / 2.0,
        _ => *upper,
    });
    let words = |(psnr, view): &(f64, &str)| format!("{view} ({})", number(*psnr, 2));
    let worst: Vec<String> = sorted.iter().take(WORST).map(words).collect();
    html! {
        @if let Some(median) = median {
            p.note {
                "PSNR of " (name(layer, views)) ", dB: median " (number(median, 2)) "; lowest in " (worst.join(", "))
                "."
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use mvfusion_model::evaluation::{LayerScores, RegionSource};

    use super::super::scores::tests::known;
    use super::*;

    #[test]
    fn a_column_of_views_that_is_named_as_a_metric_shows_that_metric() {
        let scores = Scores { composed: known(), ..Scores::default() };
        let mut named = 0;
        for column in VIEW_COLUMNS {
            let metric = Metric::ALL.into_iter().find(|metric| metric.label() == column.name);
            if let Some(metric) = metric {
                assert_eq!((column.of)(&scores), metric.of(&scores.composed), "{}", column.name);
                assert_eq!(column.decimals, metric.decimals(), "{}", column.name);
                named += 1;
            }
        }
        assert_eq!(named, 6);
    }

    /// Eight views whose movers get worse but for the last, where there are none.
    fn frames(region_source: Option<RegionSource>) -> Vec<ViewScores> {
        let psnr = |psnr| Some(LayerScores { psnr: Some(psnr), ..LayerScores::default() });
        let view = |frame: u8| {
            let movers = if frame == 7 { None } else { psnr(20.0 - f64::from(frame)) };
            let scores = Scores { dynamic_region: psnr(25.0), movers, region_source, ..Scores::default() };
            ViewScores { view: format!("cam00/{frame:04}"), scores }
        };
        (0..8).map(view).collect()
    }

    #[test]
    fn movers_have_a_curve_by_frame_and_the_worst_frames_are_named() {
        let views = frames(Some(RegionSource::GivenMasks));
        let test = views.into_iter().enumerate().map(|(index, view)| (format!("{index:05}.png"), view)).collect();
        let page = super::views(&PerView { protocol: String::new(), test, field: [].into() }).into_string();
        for words in [
            "<span class=\"key c3\">movers (true masks)</span>",
            "<span class=\"key c2\">dynamic region (given masks)</span>",
            "PSNR of movers (true masks), dB: median 17.00; lowest in cam00/0006 (14.00), cam00/0005 (15.00)",
            ">movers PSNR (true masks)</th>",
            ">dynamic region PSNR (given masks)</th>",
        ] {
            assert!(page.contains(words), "{words} is missing: {page}");
        }
    }

    #[test]
    fn without_movers_the_worst_frames_are_those_of_the_dynamic_region() {
        let mut views = frames(Some(RegionSource::TemporalDeviation));
        views.iter_mut().for_each(|view| view.scores.movers = None);
        let said = |views: &[ViewScores]| lowest(&views.iter().collect::<Vec<_>>()).into_string();
        assert!(said(&views).contains("dynamic region (temporal deviation), dB: median 25.00"), "{}", said(&views));
        views.iter_mut().for_each(|view| view.scores.dynamic_region = None);
        assert_eq!(said(&views), "");
    }
}
