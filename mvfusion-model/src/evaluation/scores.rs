//! The results of an evaluation, and their means over views.

use serde::{Deserialize, Serialize};

use super::layer_scores::LayerScores;
use super::metric::Metric;
use super::metrics::{RegionSource, SmallMoversRecall, TemporalScores};

/// The content of the composed render of a held-out photo. Its moment was not trained, because each photo has its own
/// moment.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum HeldOutPhoto {
    /// Only the static branch, at brightness 1: a clean view.
    StaticBranch,
    /// All branches at the photo's time. Moving objects, if any, are those of the previous and next photo.
    AllBranches,
}

/// Metrics of a set of views.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Scores {
    /// The composed render against the photo.
    pub composed: LayerScores,
    /// The content of the composed renders, if the views are held-out photos. Otherwise they show the view's moment.
    #[serde(skip_serializing_if = "Option::is_none", default)]
    pub composed_shows: Option<HeldOutPhoto>,
    /// The static branch against the clean background.
    #[serde(rename = "static", skip_serializing_if = "Option::is_none", default)]
    pub static_: Option<LayerScores>,
    /// The composed render against the photo, inside the dynamic region.
    #[serde(skip_serializing_if = "Option::is_none", default)]
    pub dynamic_region: Option<LayerScores>,
    /// The composed render against the photo, outside the dynamic region.
    #[serde(skip_serializing_if = "Option::is_none", default)]
    pub still_region: Option<LayerScores>,
    /// The source of the dynamic region.
    #[serde(skip_serializing_if = "Option::is_none", default)]
    pub region_source: Option<RegionSource>,
    /// `dynamic_region.psnr - still_region.psnr` in dB: the deficit of moving regions. Variations of the whole image
    /// between runs are in both terms, so the difference varies less.
    #[serde(skip_serializing_if = "Option::is_none", default)]
    pub dynamic_minus_still_psnr: Option<f64>,
    /// The composed render against the photo on visible movers, which change their position; only for scenes with known
    /// movers.
    #[serde(skip_serializing_if = "Option::is_none", default)]
    pub movers: Option<LayerScores>,
    /// The part of the small movers that the mask covers; absent without small movers.
    #[serde(skip_serializing_if = "Option::is_none", default)]
    pub small_movers: Option<SmallMoversRecall>,
    /// IoU of predicted and given mask.
    #[serde(skip_serializing_if = "Option::is_none", default)]
    pub mask_iou: Option<f64>,
    /// Flicker: each frame compared with the previous one.
    #[serde(skip_serializing_if = "Option::is_none", default)]
    pub temporal: Option<TemporalScores>,
}

/// Metrics of one view.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct ViewScores {
    /// The view's name.
    pub view: String,
    /// Its metrics.
    #[serde(flatten)]
    pub scores: Scores,
}

/// The result of an evaluation.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Evaluation {
    /// Means over the views.
    pub mean: Scores,
    /// Each view.
    pub views: Vec<ViewScores>,
}

impl Scores {
    /// The evaluated layers and regions, by their names in files.
    pub fn layers(&self) -> impl Iterator<Item = (&'static str, &LayerScores)> {
        let optional = [
            ("static", &self.static_),
            ("dynamic_region", &self.dynamic_region),
            ("still_region", &self.still_region),
            ("movers", &self.movers),
        ];
        let known = optional.into_iter().filter_map(|(name, scores)| Some((name, scores.as_ref()?)));
        std::iter::once(("composed", &self.composed)).chain(known)
    }

    /// A label for a layer of [`Scores::layers`]. A region names the source of its masks:
    /// `dynamic region (given masks)`.
    pub fn label(&self, layer: &str) -> String {
        let (name, source) = self.label_and_source(layer);
        name + &source.map_or(String::new(), |source| format!(" ({})", source.words()))
    }

    /// A label for a layer of [`Scores::layers`], and separately the source of a region's masks, for use after a
    /// metric's name.
    pub fn label_and_source(&self, layer: &str) -> (String, Option<RegionSource>) {
        let source = match layer {
            "dynamic_region" | "still_region" => self.region_source,
            // Only exact ground truth contains movers.
            "movers" => Some(RegionSource::TrueMasks),
            _ => None,
        };
        (layer.replace('_', " "), source)
    }

    /// Adds the difference of the regions, if both have a PSNR.
    pub(super) fn with_difference(mut self) -> Self {
        let psnr = |region: Option<LayerScores>| region.and_then(|scores| scores.psnr);
        let regions = psnr(self.dynamic_region).zip(psnr(self.still_region));
        self.dynamic_minus_still_psnr = regions.map(|(dynamic, still)| dynamic - still);
        self
    }

    /// Means over the views that have the metric, and the difference of these means; absent if no view has it. Mask IoU
    /// and recall of small movers are pooled elsewhere, not averaged.
    pub(super) fn mean(views: &[ViewScores]) -> Self {
        let layer = |of: fn(&Scores) -> Option<LayerScores>| {
            let layers: Vec<LayerScores> = views.iter().filter_map(|view| of(&view.scores)).collect();
            let mut means = LayerScores::default();
            for metric in Metric::ALL {
                *metric.place(&mut means) = mean(layers.iter().map(|layer| metric.of(layer)));
            }
            (means != LayerScores::default()).then_some(means)
        };
        let pairs = |of: fn(&TemporalScores) -> Option<f64>| {
            mean(views.iter().map(|view| view.scores.temporal.as_ref().and_then(of)))
        };
        let temporal = TemporalScores {
            t_lpips_alex: pairs(|pair| pair.t_lpips_alex),
            t_lpips_vgg: pairs(|pair| pair.t_lpips_vgg),
            consecutive_lpips_alex: pairs(|pair| pair.consecutive_lpips_alex),
            consecutive_lpips_vgg: pairs(|pair| pair.consecutive_lpips_vgg),
        };
        Self {
            composed: layer(|scores| Some(scores.composed)).unwrap_or_default(),
            composed_shows: views.iter().find_map(|view| view.scores.composed_shows),
            static_: layer(|scores| scores.static_),
            dynamic_region: layer(|scores| scores.dynamic_region),
            still_region: layer(|scores| scores.still_region),
            region_source: views.iter().find_map(|view| view.scores.region_source),
            movers: layer(|scores| scores.movers),
            temporal: (temporal != TemporalScores::default()).then_some(temporal),
            ..Self::default()
        }
        .with_difference()
    }
}

/// The mean of the known values.
fn mean(metrics: impl Iterator<Item = Option<f64>>) -> Option<f64> {
    let known: Vec<f64> = metrics.flatten().collect();
    (!known.is_empty()).then(|| known.iter().sum::<f64>() / known.len() as f64)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn means_are_over_the_views_that_know_a_metric() {
        let view = |psnr, lpips_vgg_raw, t_lpips_alex: Option<f64>| ViewScores {
            view: String::new(),
            scores: Scores {
                composed: LayerScores { psnr, lpips_vgg_raw, ..LayerScores::default() },
                temporal: Some(TemporalScores { t_lpips_alex, ..TemporalScores::default() }),
                ..Scores::default()
            },
        };
        let mean = Scores::mean(&[view(Some(20.0), None, None), view(Some(30.0), Some(0.5), Some(0.25))]);
        assert_eq!(mean.composed, LayerScores { psnr: Some(25.0), lpips_vgg_raw: Some(0.5), ..LayerScores::default() });
        assert_eq!(mean.temporal, Some(TemporalScores { t_lpips_alex: Some(0.25), ..TemporalScores::default() }));
        assert_eq!((mean.static_, mean.still_region, mean.movers), (None, None, None));
        assert_eq!((mean.dynamic_minus_still_psnr, mean.small_movers), (None, None));
    }

    #[test]
    fn the_difference_of_the_regions_is_that_of_their_means() {
        let psnr = |psnr: Option<f64>| psnr.map(|psnr| LayerScores { psnr: Some(psnr), ..LayerScores::default() });
        let view = |dynamic, still, movers| ViewScores {
            view: String::new(),
            scores: Scores {
                dynamic_region: psnr(dynamic),
                still_region: psnr(still),
                movers: psnr(movers),
                ..Scores::default()
            },
        };
        // Nothing moves in the second view.
        let mean = Scores::mean(&[view(Some(20.0), Some(30.0), Some(15.0)), view(None, Some(36.0), None)]);
        assert_eq!(mean.dynamic_minus_still_psnr, Some(20.0 - 33.0));
        assert_eq!(mean.movers, psnr(Some(15.0)));
        assert_eq!(Scores::mean(&[view(Some(20.0), None, None)]).dynamic_minus_still_psnr, None);
    }

    #[test]
    fn a_region_names_its_masks() {
        let scores = Scores { region_source: Some(RegionSource::GivenMasks), ..Scores::default() };
        assert_eq!(scores.label("dynamic_region"), "dynamic region (given masks)");
        assert_eq!(scores.label("movers"), "movers (true masks)");
        assert_eq!(scores.label("static"), "static");
        // As in files of versions without a source.
        assert_eq!(Scores::default().label("still_region"), "still region");
    }
}
