//! What is read from a run's `results.json`.

use std::fs;
use std::path::Path;

use anyhow::Context;
use serde_json::Value;

/// The figures of a layer, or of a part of it. One that is not known is absent.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Layer {
    /// PSNR in dB.
    pub psnr: Option<f64>,
    /// SSIM.
    pub ssim: Option<f64>,
    /// LPIPS by AlexNet on `[-1, 1]`.
    pub lpips: Option<f64>,
}

/// The figures of a run. One that is not known is absent.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Figures {
    /// Composed picture of the held-out views.
    pub composed: Layer,
    /// Static branch against the clean background.
    pub static_: Layer,
    /// Composed picture inside the dynamic region; of the training views where they were scored.
    pub dynamic: Layer,
    /// What the dynamic region was taken from, by its name in `results.json`.
    pub region_source: Option<String>,
    /// Composed picture where a mover is in front; of the training views where they were scored.
    pub movers: Layer,
    /// PSNR of the dynamic region less that of the still one; of the training views where they were scored.
    pub dynamic_minus_still: Option<f64>,
    /// Share of the small movers that the mask covers; of the training views where they were scored.
    pub small_movers_recall: Option<f64>,
    /// Number of dynamic Gaussians.
    pub dynamic_gaussians: Option<f64>,
    /// Seconds of training a step.
    pub seconds_a_step: Option<f64>,
    /// Why there is no LPIPS; `None` if there is one.
    pub why_no_lpips: Option<String>,
}

impl Figures {
    /// Reads the figures of a finished run.
    pub fn read(folder: &Path) -> anyhow::Result<Self> {
        let path = folder.join("results.json");
        let text = fs::read_to_string(&path).with_context(|| format!("cannot read {}", path.display()))?;
        let json = serde_json::from_str(&text).with_context(|| format!("{} is no JSON", path.display()))?;
        Ok(Self::of(&json))
    }

    fn of(json: &Value) -> Self {
        let number = |pointer: &str| json.pointer(pointer).and_then(Value::as_f64);
        let layer = |pointer: &str| Layer {
            psnr: number(&format!("{pointer}/psnr")),
            ssim: number(&format!("{pointer}/ssim")),
            lpips: number(&format!("{pointer}/lpips_alex")),
        };
        let moving = if json.get("training_views").is_some() { "/training_views" } else { "/test" };
        let (seconds, steps) = (number("/train/seconds"), number("/train/steps"));
        Self {
            composed: layer("/test/composed"),
            static_: layer("/test/static"),
            dynamic: layer(&format!("{moving}/dynamic_region")),
            region_source: json.pointer(&format!("{moving}/region_source")).and_then(Value::as_str).map(str::to_owned),
            movers: layer(&format!("{moving}/movers")),
            dynamic_minus_still: number(&format!("{moving}/dynamic_minus_still_psnr")),
            small_movers_recall: number(&format!("{moving}/small_movers/recall")),
            dynamic_gaussians: number("/gaussians/dynamic"),
            seconds_a_step: seconds.zip(steps).map(|(seconds, steps)| seconds / steps),
            why_no_lpips: why_no_lpips(json),
        }
    }
}

/// Why the composed pictures have no LPIPS by AlexNet; `None` if they have one.
fn why_no_lpips(json: &Value) -> Option<String> {
    if json.pointer("/test/composed/lpips_alex").is_some() {
        return None;
    }
    let network = json.pointer("/lpips/alex");
    let said = network.and_then(|network| network.get("absent")).and_then(Value::as_str);
    Some(match (said, network) {
        (Some(reason), _) => reason.to_owned(),
        // A network that was there has been shown pictures that it shrinks to nothing.
        (None, Some(_)) => "its pictures are smaller than 31 pixels a side".to_owned(),
        (None, None) => "results.json does not say why".to_owned(),
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn figures_are_found_by_their_names_and_unknown_ones_are_absent() {
        let json = serde_json::json!({
            "test": { "composed": { "psnr": 27.5, "ssim": 0.9 }, "dynamic_region": { "psnr": 15.0, "lpips_alex": 0.3 } },
            "gaussians": { "dynamic": 40 },
            "train": { "seconds": 10.0, "steps": 4 },
        });
        let figures = Figures::of(&json);
        assert_eq!(figures.composed, Layer { psnr: Some(27.5), ssim: Some(0.9), lpips: None });
        assert_eq!(figures.static_, Layer::default());
        assert_eq!(figures.dynamic, Layer { psnr: Some(15.0), ssim: None, lpips: Some(0.3) });
        assert_eq!((figures.dynamic_gaussians, figures.seconds_a_step), (Some(40.0), Some(2.5)));
    }

    #[test]
    fn a_run_without_lpips_says_why() {
        let why = |composed: Value, lpips: Value| {
            Figures::of(&serde_json::json!({ "test": { "composed": composed }, "lpips": lpips })).why_no_lpips
        };
        let nothing = || serde_json::json!({});
        let absent = || serde_json::json!({ "alex": { "absent": "no folder of weights was given" } });
        let given = || serde_json::json!({ "alex": { "weights_sha256": "0" } });
        assert_eq!(why(nothing(), absent()).as_deref(), Some("no folder of weights was given"));
        assert!(why(nothing(), given()).is_some_and(|reason| reason.contains("31 pixels")));
        assert!(why(nothing(), nothing()).is_some_and(|reason| reason.contains("does not say")));
        assert_eq!(why(serde_json::json!({ "lpips_alex": 0.25 }), given()), None);
    }

    #[test]
    fn the_dynamic_region_is_that_of_the_training_views_where_they_were_scored() {
        let json = serde_json::json!({
            "test": { "dynamic_region": { "psnr": 15.0 }, "region_source": "given_masks" },
            "training_views": {
                "dynamic_region": { "psnr": 20.0 },
                "region_source": "true_masks",
                "dynamic_minus_still_psnr": -9.5,
                "movers": { "ssim": 0.5 },
                "small_movers": { "recall": 0.25, "components": 4 },
            },
        });
        let figures = Figures::of(&json);
        assert_eq!((figures.dynamic.psnr, figures.region_source.as_deref()), (Some(20.0), Some("true_masks")));
        assert_eq!((figures.dynamic_minus_still, figures.movers.ssim), (Some(-9.5), Some(0.5)));
        assert_eq!(
            (figures.small_movers_recall, Figures::of(&serde_json::json!({})).movers),
            (Some(0.25), Layer::default())
        );
    }
}
