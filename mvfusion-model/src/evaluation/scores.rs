//! What an evaluation found, and its means over views.

use serde::{Deserialize, Serialize};

use super::figure::Figure;
use super::metrics::{RegionSource, TemporalScores};

/// Figures of a layer, or of a part of it. A figure that is not known is absent.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct LayerScores {
    /// Mean PSNR in dB, of 8-bit pictures.
    #[serde(skip_serializing_if = "Option::is_none", default)]
    pub psnr: Option<f64>,
    /// Mean PSNR in dB without the 8-bit round trip.
    #[serde(skip_serializing_if = "Option::is_none", default)]
    pub psnr_exact: Option<f64>,
    /// Mean SSIM as 3DGS computes it: zeros outside the picture.
    #[serde(skip_serializing_if = "Option::is_none", default)]
    pub ssim: Option<f64>,
    /// Mean SSIM as scikit-image computes it: without the 5 outermost pixels of the picture, also in a part of it.
    #[serde(skip_serializing_if = "Option::is_none", default)]
    pub ssim_valid: Option<f64>,
    /// Mean MS-SSIM; pictures of more than 160 pixels a side have one, parts of them have none.
    #[serde(skip_serializing_if = "Option::is_none", default)]
    pub ms_ssim: Option<f64>,
    /// Mean D-SSIM, `(1 - MS-SSIM) / 2`.
    #[serde(skip_serializing_if = "Option::is_none", default)]
    pub d_ssim: Option<f64>,
    /// Mean LPIPS by AlexNet on `[-1, 1]`.
    #[serde(skip_serializing_if = "Option::is_none", default)]
    pub lpips_alex: Option<f64>,
    /// Mean LPIPS by VGG-16 on `[-1, 1]`.
    #[serde(skip_serializing_if = "Option::is_none", default)]
    pub lpips_vgg: Option<f64>,
    /// Mean LPIPS by AlexNet on `[0, 1]`, as the code of 3DGS' descendants prints it.
    #[serde(skip_serializing_if = "Option::is_none", default)]
    pub lpips_alex_raw: Option<f64>,
    /// Mean LPIPS by VGG-16 on `[0, 1]`, as the code of 3DGS prints it.
    #[serde(skip_serializing_if = "Option::is_none", default)]
    pub lpips_vgg_raw: Option<f64>,
}

/// What the composed picture of a held-out photo shows. Its moment was not trained on: a photo has a moment of its own.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum HeldOutPhoto {
    /// The static branch alone, at the brightness 1: a clean view.
    StaticBranch,
    /// All branches at the photo's time, in which what moves is that of the photos before and after it, if anything.
    AllBranches,
}

/// Figures of a set of views.
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
    /// Overlap of predicted and given mask.
    #[serde(skip_serializing_if = "Option::is_none", default)]
    pub mask_iou: Option<f64>,
    /// Flicker: each frame with the one before it.
    #[serde(skip_serializing_if = "Option::is_none", default)]
    pub temporal: Option<TemporalScores>,
}

/// Figures of one view.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct ViewScores {
    /// The view's name.
    pub view: String,
    /// Its figures.
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
        let optional =
            [("static", &self.static_), ("dynamic_region", &self.dynamic_region), ("still_region", &self.still_region)];
        let known = optional.into_iter().filter_map(|(name, scores)| Some((name, scores.as_ref()?)));
        std::iter::once(("composed", &self.composed)).chain(known)
    }

    /// Means over the views that have the figure; absent if none has. The overlap of masks is not averaged but pooled,
    /// elsewhere.
    pub(super) fn mean(views: &[ViewScores]) -> Self {
        let layer = |of: fn(&Scores) -> Option<LayerScores>| {
            let layers: Vec<LayerScores> = views.iter().filter_map(|view| of(&view.scores)).collect();
            let mut means = LayerScores::default();
            for figure in Figure::ALL {
                *figure.place(&mut means) = mean(layers.iter().map(|layer| figure.of(layer)));
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
            mask_iou: None,
            temporal: (temporal != TemporalScores::default()).then_some(temporal),
        }
    }
}

/// The mean of the numbers that are known.
fn mean(figures: impl Iterator<Item = Option<f64>>) -> Option<f64> {
    let known: Vec<f64> = figures.flatten().collect();
    (!known.is_empty()).then(|| known.iter().sum::<f64>() / known.len() as f64)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn means_are_over_the_views_that_know_a_figure() {
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
        assert_eq!((mean.static_, mean.still_region), (None, None));
    }
}
