//! `results.json` and `per_view.json`: the metrics of a run.

use std::collections::{BTreeMap, BTreeSet};

use mvfusion_model::evaluation::{
    Evaluation, Evaluator, LayerScores, Metric, ModuleFigures, Protocol, RefinementFigures, Scores, ViewScores,
};
use mvfusion_model::model::Model;
use mvfusion_model::model::gaussians::Gaussians;
use serde::{Deserialize, Serialize};

use super::field::{FieldPerView, FieldScores};
use super::files::picture_file;
use super::size::DiskSize;
use crate::lpips::LpipsFolder;
use crate::machine::Machine;
use crate::program::Program;

/// Relative difference below which two metrics are equal. The JSON reader may change the last bit of a number.
const SAME: f64 = 1e-12;

/// `results.json`. Unknown metrics are absent.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Results {
    /// The protocol of the metrics.
    pub protocol: String,
    /// Means over the held-out views.
    pub test: Scores,
    /// Means over the training views, if `eval.training_views` is set.
    #[serde(skip_serializing_if = "Option::is_none", default)]
    pub training_views: Option<Scores>,
    /// What the motion-aware modules contribute; absent without them.
    #[serde(skip_serializing_if = "Option::is_none", default)]
    pub refinement: Option<RefinementFigures>,
    /// Numbers of Gaussians.
    pub gaussians: GaussianCounts,
    /// The cost of training; absent if only an evaluation is known.
    #[serde(skip_serializing_if = "Option::is_none", default)]
    pub train: Option<TrainCost>,
    /// The evaluation.
    pub eval: EvalTime,
    /// The frame rate; absent unless it was measured.
    #[serde(skip_serializing_if = "Option::is_none", default)]
    pub speed: Option<RenderSpeed>,
    /// For each network that the protocol needs: its weights, or why there are none.
    #[serde(default)]
    pub lpips: BTreeMap<String, LpipsWeights>,
    /// SHA-256 of all learned parameters.
    pub params_sha256: String,
    /// SHA-256 of the run's `config.toml`.
    #[serde(default)]
    pub config_sha256: String,
    /// SHA-256 of the composed renders of all held-out views, see [`PicturesHash`](super::PicturesHash).
    #[serde(default)]
    pub predictions_sha256: String,
    /// SHA-256 of the ground-truth photos.
    #[serde(default)]
    pub photos_sha256: String,
    /// SHA-256 of the masks of moving objects; absent if none were given.
    #[serde(skip_serializing_if = "Option::is_none", default)]
    pub masks_sha256: Option<String>,
    /// The folder of the weights of LPIPS; absent without any.
    #[serde(skip_serializing_if = "Option::is_none", default)]
    pub lpips_folder: Option<LpipsFolder>,
    /// The program that computed the metrics; `run.json` has the one that trained.
    #[serde(skip_serializing_if = "Option::is_none", default)]
    pub program: Option<Program>,
    /// The machine that computed them.
    #[serde(skip_serializing_if = "Option::is_none", default)]
    pub machine: Option<Machine>,
    /// What the model takes on disk.
    #[serde(skip_serializing_if = "Option::is_none", default)]
    pub size: Option<DiskSize>,
    /// Device.
    pub device: String,
    /// CPU threads.
    pub threads: usize,
    /// Seed of the run.
    pub seed: u64,
    /// The metrics under the names that the scripts of 3DGS expect.
    #[serde(flatten, skip_deserializing)]
    pub field: BTreeMap<String, FieldScores>,
}

/// The weights of an LPIPS network.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum LpipsWeights {
    /// A file with this SHA-256.
    WeightsSha256(String),
    /// None, for this reason. Its metrics are absent.
    Absent(String),
}

/// The frame rate of repeated renders of the held-out views (METHOD A35). It includes deformation, refinement and
/// rasterisation. It excludes reading, writing and transfers to the host.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct RenderSpeed {
    /// Width of the first view in pixels.
    pub width: usize,
    /// Height of the first view in pixels.
    pub height: usize,
    /// Warm-up frames.
    pub warm_up: usize,
    /// Measured frames.
    pub frames: usize,
    /// Frames per second.
    pub fps: f64,
    /// Frames per second without MFTA, the cheaper inference; absent if the model has no MFTA.
    #[serde(skip_serializing_if = "Option::is_none", default)]
    pub fps_without_mfta: Option<f64>,
}

/// Numbers of Gaussians.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct GaussianCounts {
    /// Of the static branch; absent if there is none.
    #[serde(rename = "static", skip_serializing_if = "Option::is_none", default)]
    pub static_: Option<usize>,
    /// Of the dynamic branch.
    pub dynamic: usize,
}

/// The cost of training.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct TrainCost {
    /// Seconds of all steps.
    pub seconds: f64,
    /// Optimiser steps of all stages.
    pub steps: usize,
    /// Steps among them that changed nothing, because a number was not finite (`train.on_bad_step`).
    #[serde(skip_serializing_if = "is_zero", default)]
    pub skipped: usize,
    /// The most resident memory of the process until the last step, in bytes; that of the last process if the run was
    /// resumed. Absent where the system does not tell.
    #[serde(skip_serializing_if = "Option::is_none", default)]
    pub peak_memory: Option<u64>,
}

/// Whether there is nothing to tell.
pub(super) fn is_zero(count: &usize) -> bool {
    *count == 0
}

/// Evaluation time.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct EvalTime {
    /// Seconds of rendering, scoring and writing images.
    pub seconds: f64,
}

impl GaussianCounts {
    /// The numbers of a model.
    pub fn of(model: &Model) -> Self {
        let count = |branch: &Gaussians| branch.count();
        Self { static_: model.static_.as_ref().map(count), dynamic: count(&model.dynamic) }
    }

    /// The numbers in words: `12 static, 3 dynamic`.
    pub fn sentence(&self, joint: &str) -> String {
        let static_ = self.static_.map_or(String::new(), |count| format!("{count} static{joint}"));
        format!("{static_}{} dynamic", self.dynamic)
    }
}

impl LpipsWeights {
    /// Those of an evaluator, by the networks' names.
    pub fn of(evaluator: &Evaluator) -> BTreeMap<String, Self> {
        let there = evaluator.weights().map(|(network, hash)| (network, Self::WeightsSha256(hash.to_owned())));
        let missing = evaluator.missing().map(|(network, reason)| (network, Self::Absent(reason.to_owned())));
        there.chain(missing).map(|(network, weights)| (network.name().to_owned(), weights)).collect()
    }
}

impl Results {
    /// The frame rate, if parameters, device, machine and threads are the same as those of `other`.
    pub fn speed_of(&self, other: &Self) -> Option<RenderSpeed> {
        let is_same_machine =
            self.device == other.device && self.machine == other.machine && self.threads == other.threads;
        self.speed.filter(|_| is_same_machine && self.params_sha256 == other.params_sha256)
    }

    /// The names of the metrics that differ from those of `other`, each with both values.
    pub fn differences(&self, other: &Self) -> Vec<String> {
        let (mut own, mut others) = (self.metrics(), other.metrics());
        if self.refinement.is_none() || other.refinement.is_none() {
            // Earlier versions did not measure the modules.
            for metrics in [&mut own, &mut others] {
                metrics.retain(|name, _| !name.starts_with(OF_MODULES));
            }
        }
        let names: BTreeSet<_> = own.keys().chain(others.keys()).collect();
        names
            .into_iter()
            .filter_map(|name| {
                let (a, b) = (own.get(name), others.get(name));
                let same = match (a, b) {
                    (Some(a), Some(b)) => (a - b).abs() <= SAME * a.abs().max(b.abs()),
                    _ => false,
                };
                // The other program version may not have measured it.
                let shown = |metric: Option<&f64>| metric.map_or("not measured".to_owned(), f64::to_string);
                (!same).then(|| format!("{name} {} instead of {}", shown(a), shown(b)))
            })
            .collect()
    }

    /// The known metrics, by their names in the file, without times and frame rates.
    pub fn metrics(&self) -> BTreeMap<String, f64> {
        let sets =
            std::iter::once(("test", &self.test)).chain(self.training_views.iter().map(|set| ("training_views", set)));
        let mut metrics: BTreeMap<String, f64> = sets.flat_map(|(name, set)| metrics_of(name, set)).collect();
        metrics.extend(self.gaussians.static_.map(|count| ("gaussians.static".to_owned(), count as f64)));
        metrics.insert("gaussians.dynamic".to_owned(), self.gaussians.dynamic as f64);
        metrics.extend(self.refinement.iter().flat_map(metrics_of_modules));
        metrics
    }
}

/// The known metrics of a set of views.
fn metrics_of(set: &str, scores: &Scores) -> BTreeMap<String, f64> {
    let of_layer = |(layer, scores): (&'static str, &LayerScores)| {
        let known = Metric::ALL.into_iter().filter_map(|metric| Some((metric.name(), metric.of(scores)?)));
        known.map(|(metric, value)| (format!("{set}.{layer}.{metric}"), value)).collect::<Vec<_>>()
    };
    let mut metrics: BTreeMap<String, f64> = scores.layers().flat_map(of_layer).collect();
    let small = scores.small_movers;
    for (name, metric) in [
        ("mask_iou", scores.mask_iou),
        ("dynamic_minus_still_psnr", scores.dynamic_minus_still_psnr),
        ("small_movers.recall", small.map(|small| small.recall)),
        ("small_movers.components", small.map(|small| small.components as f64)),
    ] {
        metrics.extend(metric.map(|metric| (format!("{set}.{name}"), metric)));
    }
    let temporal = scores.temporal.unwrap_or_default();
    for (name, flicker) in [
        ("t_lpips_alex", temporal.t_lpips_alex),
        ("t_lpips_vgg", temporal.t_lpips_vgg),
        ("consecutive_lpips_alex", temporal.consecutive_lpips_alex),
        ("consecutive_lpips_vgg", temporal.consecutive_lpips_vgg),
    ] {
        metrics.extend(flicker.map(|flicker| (format!("{set}.temporal.{name}"), flicker)));
    }
    metrics
}

/// How the names of their metrics begin.
const OF_MODULES: &str = "refinement.";

/// The figures of the motion-aware modules.
fn metrics_of_modules(figures: &RefinementFigures) -> Vec<(String, f64)> {
    let mut metrics = Vec::new();
    for (module, figures) in [("mvg", figures.mvg), ("mfta", figures.mfta)] {
        let Some(ModuleFigures { norm, constant, over_gaussians, over_time, active, silent }) = figures else {
            continue;
        };
        let shares = [("constant", constant), ("over_gaussians", over_gaussians), ("over_time", over_time)];
        let counted = [("active", active), ("silent", silent)];
        let counted = counted.into_iter().filter_map(|(name, share)| Some((name, share?)));
        for (name, value) in std::iter::once(("norm", norm)).chain(shares).chain(counted) {
            metrics.push((format!("{OF_MODULES}{module}.{name}"), value));
        }
    }
    if let Some(attention) = figures.attention {
        metrics.push((format!("{OF_MODULES}attention.entropy"), attention.entropy));
        metrics.push((format!("{OF_MODULES}attention.uniform_entropy"), attention.uniform_entropy));
    }
    metrics
}

/// `per_view.json`: the metrics of every held-out view, by the name of its images.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct PerView {
    /// The protocol of the metrics.
    pub protocol: String,
    /// The held-out views.
    pub test: BTreeMap<String, ViewScores>,
    /// The metrics under the names that the scripts of 3DGS expect.
    #[serde(flatten, skip_deserializing)]
    pub field: BTreeMap<String, FieldPerView>,
}

impl PerView {
    /// The views of an evaluation after `steps` steps of training.
    pub fn of(protocol: Protocol, evaluation: &Evaluation, steps: usize) -> Self {
        let test: BTreeMap<_, _> =
            evaluation.views.iter().enumerate().map(|(index, view)| (picture_file(index), view.clone())).collect();
        let field = FieldPerView::of(protocol, steps, &test);
        Self { protocol: protocol.statement().to_owned(), test, field }
    }
}

/// Results for tests, of a run without weights of LPIPS.
#[cfg(test)]
pub(crate) fn specimen(test: Scores) -> Results {
    Results {
        protocol: "p".into(),
        test,
        training_views: None,
        refinement: None,
        gaussians: GaussianCounts { static_: Some(12), dynamic: 3 },
        train: Some(TrainCost { seconds: 171.2, steps: 1400, skipped: 0, peak_memory: Some(300 << 20) }),
        eval: EvalTime { seconds: 9.0 },
        speed: None,
        lpips: LpipsWeights::of(&Evaluator::without_lpips(Protocol::Mvfusion)),
        params_sha256: "0".into(),
        config_sha256: "1".into(),
        predictions_sha256: "2".into(),
        photos_sha256: "3".into(),
        masks_sha256: None,
        lpips_folder: None,
        program: None,
        machine: None,
        size: None,
        device: "flex".into(),
        threads: 2,
        seed: 0,
        field: BTreeMap::new(),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn results() -> Results {
        specimen(Scores {
            composed: LayerScores { psnr: Some(1.0 / 0.3), ssim: Some(0.1 + 0.2), ..Default::default() },
            ..Default::default()
        })
    }

    #[test]
    fn unknown_metrics_are_absent_and_known_ones_are_whole() {
        let json = serde_json::to_value(results()).expect("written");
        assert_eq!(json["test"]["composed"]["ssim"], 0.1 + 0.2);
        assert_eq!(json["gaussians"]["static"], 12);
        for unknown in ["static", "mask_iou", "movers", "small_movers", "dynamic_minus_still_psnr"] {
            assert!(json["test"].get(unknown).is_none(), "{unknown}: {json}");
        }
        assert!(json.get("speed").is_none());
        assert_eq!(json["lpips"]["vgg"]["absent"], "no folder of weights was given");
        assert_eq!(serde_json::from_value::<Results>(json).expect("read"), results());
    }

    #[test]
    fn what_earlier_versions_did_not_record_is_absent() {
        let mut json = serde_json::to_value(results()).expect("written");
        for name in ["lpips_folder", "program", "machine", "size"] {
            assert!(json.get(name).is_none(), "{name}: {json}");
        }
        json.as_object_mut().expect("an object").retain(|name, _| name != "lpips");
        assert_eq!(serde_json::from_value::<Results>(json).expect("read").program, None);
        let program = Some(Program { git: None, ..Program::this() });
        let size = Some(DiskSize { parameters: 12, run: 345 });
        let results = Results { program, size, ..results() };
        let json = serde_json::to_value(&results).expect("written");
        assert_eq!((&json["size"]["run"], json["program"].get("git")), (&345.into(), None));
        assert_eq!(serde_json::from_value::<Results>(json).expect("read"), results);
    }

    #[test]
    fn a_metric_that_changed_or_became_known_is_a_difference() {
        let mut other = results();
        assert!(results().differences(&other).is_empty());
        let module = |norm| ModuleFigures {
            norm,
            constant: 0.75,
            over_gaussians: 0.125,
            over_time: 0.125,
            active: None,
            silent: None,
        };
        let figures = |norm| Some(RefinementFigures { mvg: Some(module(norm)), mfta: None, attention: None });
        other.refinement = figures(0.5);
        assert!(results().differences(&other).is_empty(), "earlier versions did not measure the modules");
        let own = Results { refinement: figures(0.25), ..results() };
        assert_eq!(own.differences(&other), ["refinement.mvg.norm 0.25 instead of 0.5"]);
        other.eval.seconds = 7.0;
        other.test.composed.psnr = Some(3.0);
        other.test.mask_iou = Some(0.5);
        other.test.static_ = Some(LayerScores { lpips_vgg_raw: Some(0.25), ..Default::default() });
        let differences = results().differences(&other);
        assert_eq!(differences.len(), 3);
        assert!(differences[0].starts_with("test.composed.psnr 3.33"), "{differences:?}");
        assert_eq!(differences[1], "test.mask_iou not measured instead of 0.5");
        assert_eq!(differences[2], "test.static.lpips_vgg_raw not measured instead of 0.25");
    }
}
