//! Metrics under the names that the scripts of 3DGS and its descendants expect in `results.json` and `per_view.json`:
//! `{"ours_14000": {"PSNR": ..}}`.

use std::collections::BTreeMap;

use mvfusion_model::evaluation::{LayerScores, LpipsVariant, Metric, Protocol, ViewScores};
use serde::Serialize;

/// The common name of a metric, and the metric itself. Both LPIPS networks receive inputs in `[0, 1]`. SSIM is that of the
/// protocol.
fn figures(protocol: Protocol) -> [(&'static str, Metric); 6] {
    let ssim = if protocol.metrics().contains(&Metric::Ssim) { Metric::Ssim } else { Metric::SsimValid };
    [
        ("SSIM", ssim),
        ("PSNR", Metric::Psnr),
        ("LPIPS-vgg", Metric::Lpips(LpipsVariant::VGG_RAW)),
        ("LPIPS-alex", Metric::Lpips(LpipsVariant::ALEX_RAW)),
        ("MS-SSIM", Metric::MsSsim),
        ("D-SSIM", Metric::DSsim),
    ]
}

/// Means over the composed renders, by their common names.
#[derive(Clone, Debug, Default, PartialEq, Serialize)]
#[serde(transparent)]
pub struct FieldScores(BTreeMap<&'static str, f64>);

/// Metrics of every composed render, by their common names and the names of the images.
#[derive(Clone, Debug, Default, PartialEq, Serialize)]
#[serde(transparent)]
pub struct FieldPerView(BTreeMap<&'static str, BTreeMap<String, f64>>);

/// The method name of a training with this number of steps.
fn method(steps: usize) -> String {
    format!("ours_{steps}")
}

impl FieldScores {
    /// The known metrics of a layer.
    pub fn of(protocol: Protocol, steps: usize, scores: &LayerScores) -> BTreeMap<String, Self> {
        let known = figures(protocol).into_iter().filter_map(|(name, metric)| Some((name, metric.of(scores)?)));
        BTreeMap::from([(method(steps), Self(known.collect()))])
    }
}

impl FieldPerView {
    /// The known metrics of views, by the names of their images.
    pub fn of(protocol: Protocol, steps: usize, views: &BTreeMap<String, ViewScores>) -> BTreeMap<String, Self> {
        let column = |metric: Metric| -> BTreeMap<String, f64> {
            let value = |view: &ViewScores| metric.of(&view.scores.composed);
            views.iter().filter_map(|(picture, view)| Some((picture.clone(), value(view)?))).collect()
        };
        let columns = figures(protocol).into_iter().map(|(name, metric)| (name, column(metric)));
        BTreeMap::from([(method(steps), Self(columns.filter(|(_, column)| !column.is_empty()).collect()))])
    }
}

#[cfg(test)]
mod tests {
    use mvfusion_model::evaluation::Scores;

    use super::*;

    #[test]
    fn metrics_stand_under_the_names_that_scripts_look_for() {
        let composed = LayerScores {
            psnr: Some(30.0),
            ssim: Some(0.9),
            ssim_valid: Some(0.8),
            lpips_vgg: Some(0.3),
            lpips_vgg_raw: Some(0.2),
            ..Default::default()
        };
        let json = serde_json::to_value(FieldScores::of(Protocol::Mvfusion, 14, &composed)).expect("written");
        assert_eq!(json, serde_json::json!({"ours_14": {"PSNR": 30.0, "SSIM": 0.9, "LPIPS-vgg": 0.2}}));
        let degauss = serde_json::to_value(FieldScores::of(Protocol::DeGauss, 14, &composed)).expect("written");
        assert_eq!(degauss["ours_14"]["SSIM"], 0.8);
        let view = ViewScores { view: "cam00/0000".into(), scores: Scores { composed, ..Default::default() } };
        let json = serde_json::to_value(FieldPerView::of(
            Protocol::Mvfusion,
            14,
            &BTreeMap::from([("00000.png".into(), view)]),
        ));
        assert_eq!(json.expect("written")["ours_14"]["LPIPS-vgg"]["00000.png"], 0.2);
    }
}
