//! `results.json` and `per_view.json`: the figures of a run.

use std::collections::BTreeMap;

use mvfusion_model::densify::Branch;
use mvfusion_model::evaluation::{Evaluation, Scores, ViewScores};
use mvfusion_model::model::Model;
use serde::{Deserialize, Serialize};

use super::pictures::file_name;

/// Relative difference below which two figures are the same: the JSON reader may miss the last bit of a number.
const SAME: f64 = 1e-12;

/// `results.json`. A figure that is not known is absent.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Results {
    /// What the figures mean.
    pub protocol: String,
    /// Means over the held-out views.
    pub test: Scores,
    /// Means over the views that were trained on, where `eval.training_views` asks for them.
    #[serde(skip_serializing_if = "Option::is_none", default)]
    pub training_views: Option<Scores>,
    /// Numbers of Gaussians.
    pub gaussians: GaussianCounts,
    /// The training; absent where only an evaluation is known.
    #[serde(skip_serializing_if = "Option::is_none", default)]
    pub train: Option<TrainTime>,
    /// The evaluation.
    pub eval: EvalTime,
    /// SHA-256 of all learned parameters.
    pub params_sha256: String,
    /// Device.
    pub device: String,
    /// CPU threads.
    pub threads: usize,
    /// Seed of the run.
    pub seed: u64,
}

/// Numbers of Gaussians.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct GaussianCounts {
    /// Of the static branch; absent where there is none.
    #[serde(rename = "static", skip_serializing_if = "Option::is_none", default)]
    pub static_: Option<usize>,
    /// Of the dynamic branch.
    pub dynamic: usize,
}

/// How long training took.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct TrainTime {
    /// Seconds of all steps.
    pub seconds: f64,
    /// Optimiser steps of all stages.
    pub steps: usize,
}

/// How long evaluation took.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct EvalTime {
    /// Seconds of rendering, scoring and writing pictures.
    pub seconds: f64,
}

impl GaussianCounts {
    /// The numbers of a model.
    pub fn of(model: &Model) -> Self {
        let count = |branch: &Branch| branch.gaussians.count();
        Self { static_: model.static_.as_ref().map(count), dynamic: count(&model.dynamic) }
    }

    /// The numbers in words: `12 static, 3 dynamic`.
    pub fn sentence(&self, joint: &str) -> String {
        let static_ = self.static_.map_or(String::new(), |count| format!("{count} static{joint}"));
        format!("{static_}{} dynamic", self.dynamic)
    }
}

impl Results {
    /// The names of the figures in which `other` is not the same, each with both values.
    pub fn differences(&self, other: &Self) -> Vec<String> {
        let (own, others) = (self.figures(), other.figures());
        let names: std::collections::BTreeSet<_> = own.keys().chain(others.keys()).copied().collect();
        names
            .into_iter()
            .filter_map(|name| {
                let (a, b) = (own.get(name), others.get(name));
                let same = match (a, b) {
                    (Some(a), Some(b)) => (a - b).abs() <= SAME * a.abs().max(b.abs()),
                    _ => false,
                };
                let shown = |figure: Option<&f64>| figure.map_or("unknown".to_owned(), f64::to_string);
                (!same).then(|| format!("{name} {} instead of {}", shown(a), shown(b)))
            })
            .collect()
    }

    /// The figures that are known, by the names they have in the file.
    fn figures(&self) -> BTreeMap<&'static str, f64> {
        let (static_, region) = (self.test.static_.unwrap_or_default(), self.test.dynamic_region.unwrap_or_default());
        let training = self.training_views.unwrap_or_default();
        let all = [
            ("training_views.composed.psnr", training.composed.psnr),
            ("training_views.dynamic_region.psnr", training.dynamic_region.and_then(|scores| scores.psnr)),
            ("test.composed.psnr", self.test.composed.psnr),
            ("test.composed.ssim", self.test.composed.ssim),
            ("test.static.psnr", static_.psnr),
            ("test.static.ssim", static_.ssim),
            ("test.dynamic_region.psnr", region.psnr),
            ("test.mask_iou", self.test.mask_iou),
            ("gaussians.static", self.gaussians.static_.map(|count| count as f64)),
            ("gaussians.dynamic", Some(self.gaussians.dynamic as f64)),
        ];
        all.into_iter().filter_map(|(name, figure)| Some((name, figure?))).collect()
    }
}

/// `per_view.json`: the figures of every held-out view, by the name of its pictures.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct PerView {
    /// What the figures mean.
    pub protocol: String,
    /// The held-out views.
    pub test: BTreeMap<String, ViewScores>,
}

impl PerView {
    /// The views of an evaluation.
    pub fn of(protocol: &str, evaluation: &Evaluation) -> Self {
        let test = evaluation.views.iter().enumerate().map(|(index, view)| (file_name(index), view.clone())).collect();
        Self { protocol: protocol.to_owned(), test }
    }
}

#[cfg(test)]
mod tests {
    use mvfusion_model::evaluation::LayerScores;

    use super::*;

    fn results() -> Results {
        Results {
            protocol: "p".into(),
            test: Scores {
                composed: LayerScores { psnr: Some(1.0 / 0.3), ssim: Some(0.1 + 0.2), ..Default::default() },
                ..Default::default()
            },
            training_views: None,
            gaussians: GaussianCounts { static_: Some(2), dynamic: 1 },
            train: None,
            eval: EvalTime { seconds: 1.0 },
            params_sha256: "0".into(),
            device: "flex".into(),
            threads: 1,
            seed: 0,
        }
    }

    #[test]
    fn unknown_figures_are_absent_and_known_ones_are_whole() {
        let json = serde_json::to_value(results()).expect("written");
        assert_eq!(json["test"]["composed"]["ssim"], 0.1 + 0.2);
        assert_eq!(json["gaussians"]["static"], 2);
        assert!(json["test"].get("static").is_none() && json["test"].get("mask_iou").is_none());
        assert!(json.get("train").is_none());
        assert_eq!(serde_json::from_value::<Results>(json).expect("read"), results());
    }

    #[test]
    fn a_figure_that_changed_or_became_known_is_a_difference() {
        let mut other = results();
        assert!(results().differences(&other).is_empty());
        other.eval.seconds = 7.0;
        other.test.composed.psnr = Some(3.0);
        other.test.mask_iou = Some(0.5);
        let differences = results().differences(&other);
        assert_eq!(differences.len(), 2);
        assert!(differences[0].starts_with("test.composed.psnr 3.33"), "{differences:?}");
        assert_eq!(differences[1], "test.mask_iou unknown instead of 0.5");
    }
}
