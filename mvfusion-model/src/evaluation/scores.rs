//! What an evaluation found, and its means over views.

use serde::{Deserialize, Serialize};

use super::layer_scores::LayerScores;
use super::metric::Metric;
use super::metrics::{RegionSource, SmallMoversRecall, TemporalScores};

/// What the composed picture of a held-out photo shows. Its moment was not trained on: a photo has a moment of its own.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum HeldOutPhoto {
    /// The static branch alone, at the brightness 1: a clean view.
    StaticBranch,
    /// All branches at the photo's time, in which what moves is that of the photos before and after it, if anything.
    AllBranches,
}

/// Metrics of a set of views.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Scores {
    /// The blended picture against the photo.
    pub composed: LayerScores,
    /// What the composed pictures show, where the views are held-out photos. Else they show the view's moment.
    #[serde(skip_serializing_if = "Option::is_none", default)]
    pub composed_shows: Option<HeldOutPhoto>,
    /// The static branch against the clean background.
    #[serde(rename = "static", skip_serializing_if = "Option::is_none", default)]
    pub static_: Option<LayerScores>,
    /// The blended picture against the photo, inside the dynamic region.
    #[serde(skip_serializing_if = "Option::is_none", default)]
    pub dynamic_region: Option<LayerScores>,
    /// The blended picture against the photo, outside the dynamic region.
    #[serde(skip_serializing_if = "Option::is_none", default)]
    pub still_region: Option<LayerScores>,
    /// What the dynamic region was taken from.
    #[serde(skip_serializing_if = "Option::is_none", default)]
    pub region_source: Option<RegionSource>,
    /// `dynamic_region.psnr - still_region.psnr` in dB: how much worse what moves is than what does not. What changes the
    /// whole picture from run to run is in both, so it varies less than they do.
    #[serde(skip_serializing_if = "Option::is_none", default)]
    pub dynamic_minus_still_psnr: Option<f64>,
    /// The blended picture against the photo, where a mover is in front: something that goes somewhere. Of scenes whose
    /// movers are known.
    #[serde(skip_serializing_if = "Option::is_none", default)]
    pub movers: Option<LayerScores>,
    /// How much of the small movers the mask covers; absent where there are none.
    #[serde(skip_serializing_if = "Option::is_none", default)]
    pub small_movers: Option<SmallMoversRecall>,
    /// Overlap of predicted and given mask.
    #[serde(skip_serializing_if = "Option::is_none", default)]
    pub mask_iou: Option<f64>,
    /// Flicker: each frame with the one before it.
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
    /// The layers and parts that were scored, by their names in files.
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

    /// A layer of [`Scores::layers`] in words. A region names the masks that it was taken from: `dynamic region (given
    /// masks)`.
    pub fn label(&self, layer: &str) -> String {
        let (name, source) = self.label_and_source(layer);
        name + &source.map_or(String::new(), |source| format!(" ({})", source.words()))
    }

    /// A layer of [`Scores::layers`] in words, and the masks of a region apart, to stand behind a metric's name.
    pub fn label_and_source(&self, layer: &str) -> (String, Option<RegionSource>) {
        let source = match layer {
            "dynamic_region" | "still_region" => self.region_source,
            // Nobody but the truth knows them.
            "movers" => Some(RegionSource::TrueMasks),
            _ => None,
        };
        (layer.replace('_', " "), source)
    }

    /// With the difference of the regions, where both have a PSNR.
    pub(super) fn with_difference(mut self) -> Self {
        let psnr = |region: Option<LayerScores>| region.and_then(|scores| scores.psnr);
        let regions = psnr(self.dynamic_region).zip(psnr(self.still_region));
        self.dynamic_minus_still_psnr = regions.map(|(dynamic, still)| dynamic - still);
        self
    }

    /// Means over the views that have the metric, and the difference of these means; absent if no view has it. The
    /// overlap of masks and the recall of small movers are not averaged but pooled, elsewhere.
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

/// The mean of the numbers that are known.
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
        // As in files of versions that did not say.
        assert_eq!(Scores::default().label("still_region"), "still region");
    }
}
