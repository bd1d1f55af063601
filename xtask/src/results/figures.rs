//! What is read from a run's `results.json`.

use std::fs;
use std::path::Path;

use anyhow::Context;
use serde_json::Value;

/// The figures of a run. One that is not known is absent.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Figures {
    /// Composed picture of the held-out views: PSNR in dB.
    pub composed_psnr: Option<f64>,
    /// The same: SSIM.
    pub composed_ssim: Option<f64>,
    /// Static branch against the clean background: PSNR in dB.
    pub static_psnr: Option<f64>,
    /// The same: SSIM.
    pub static_ssim: Option<f64>,
    /// Composed picture inside the true dynamic masks: PSNR in dB; of the training views where they were scored.
    pub dynamic_psnr: Option<f64>,
    /// Number of dynamic Gaussians.
    pub dynamic_gaussians: Option<f64>,
    /// Seconds of training a step.
    pub seconds_a_step: Option<f64>,
    /// Seconds of training.
    pub seconds: Option<f64>,
    /// Steps of training.
    pub steps: Option<f64>,
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
        let (seconds, steps) = (number("/train/seconds"), number("/train/steps"));
        Self {
            composed_psnr: number("/test/composed/psnr"),
            composed_ssim: number("/test/composed/ssim"),
            static_psnr: number("/test/static/psnr"),
            static_ssim: number("/test/static/ssim"),
            dynamic_psnr: match json.get("training_views") {
                Some(_) => number("/training_views/dynamic_region/psnr"),
                None => number("/test/dynamic_region/psnr"),
            },
            dynamic_gaussians: number("/gaussians/dynamic"),
            seconds_a_step: seconds.zip(steps).map(|(seconds, steps)| seconds / steps),
            seconds,
            steps,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn figures_are_found_by_their_names_and_unknown_ones_are_absent() {
        let json = serde_json::json!({
            "test": { "composed": { "psnr": 27.5, "ssim": 0.9 }, "dynamic_region": { "psnr": 15.0 } },
            "gaussians": { "dynamic": 40 },
            "train": { "seconds": 10.0, "steps": 4 },
        });
        let figures = Figures::of(&json);
        assert_eq!((figures.composed_psnr, figures.static_psnr), (Some(27.5), None));
        assert_eq!((figures.dynamic_psnr, figures.seconds_a_step), (Some(15.0), Some(2.5)));
    }

    #[test]
    fn the_dynamic_region_is_that_of_the_training_views_where_they_were_scored() {
        let json = serde_json::json!({
            "test": { "dynamic_region": { "psnr": 15.0 } },
            "training_views": { "dynamic_region": { "psnr": 20.0 } },
        });
        assert_eq!(Figures::of(&json).dynamic_psnr, Some(20.0));
    }
}
