//! How close exported Gaussians come to the model that they stand for.

use std::fmt;

use image::RgbImage;
use mvfusion_data::GaussianCloud;
use mvfusion_model::evaluation::{Layer, LayerRenderer, blended_picture, psnr};

use super::Exporter;
use super::compared_views::{ComparedTimes, ComparedView, compared_views};
use crate::progress::{Progress, Verbosity};
use crate::run::OpenRun;

/// PSNR of equal images, which has no bound, dB.
const EQUAL: f64 = 99.0;

/// Gaussians as a viewer shows them: one cloud, or two branches that the masks of the second one blend.
#[derive(Clone, Debug, PartialEq)]
pub struct ShownGaussians {
    /// The static branch, if branches are blended.
    pub static_: Option<GaussianCloud>,
    /// The dynamic branch, or all Gaussians.
    pub dynamic: GaussianCloud,
}

impl From<GaussianCloud> for ShownGaussians {
    /// One cloud, which is how other programs see a scene.
    fn from(cloud: GaussianCloud) -> Self {
        Self { static_: None, dynamic: cloud }
    }
}

/// The composed renders of a model, as `mvfusion render` makes them, for comparison with exported Gaussians.
#[derive(Debug)]
pub struct Fidelity<'a> {
    run: &'a OpenRun,
    exporter: &'a Exporter,
    references: Vec<(ComparedView, RgbImage)>,
    /// The time of all renders, if it is one.
    time: Option<f64>,
}

/// The PSNR of exported Gaussians against the composed renders.
#[derive(Clone, Debug, PartialEq)]
pub struct Loss {
    /// Of each view at a trained or chosen time, dB; 99 for equal images.
    pub at_times: Vec<f64>,
    /// Of each view in the middle between two keyframes.
    pub between: Vec<f64>,
    time: Option<f64>,
}

impl<'a> Fidelity<'a> {
    /// Renders the views that are compared.
    ///
    /// # Errors
    /// If the device fails.
    pub fn new(
        run: &'a OpenRun,
        exporter: &'a Exporter,
        times: ComparedTimes<'_>,
        verbosity: Verbosity,
    ) -> anyhow::Result<Self> {
        let Exporter { model, level, context } = exporter;
        let renderer = LayerRenderer::new(model, *level, context, &[Layer::Composed], context.motion.weights)?;
        let views = compared_views(&run.scene, times);
        let mut progress = Progress::new("comparison", views.len(), verbosity);
        let mut references = Vec::new();
        for view in views {
            let rendered = renderer.render(&view.camera, view.time)?;
            // Proof: one layer was asked for.
            references.push((view, renderer.picture(rendered.first().expect("the composed layer"))?));
            progress.advance();
        }
        progress.finish();
        let time = if let ComparedTimes::At([time]) = times { Some(*time) } else { None };
        Ok(Self { run, exporter, references, time })
    }

    /// Compares Gaussians with the renders. `shown_at` has them at a time.
    ///
    /// # Errors
    /// If the Gaussians cannot be had, or the device fails.
    pub fn loss(&self, mut shown_at: impl FnMut(f64) -> anyhow::Result<ShownGaussians>) -> anyhow::Result<Loss> {
        let (context, device) = (&self.exporter.context, &self.run.device.device);
        let mut loss = Loss { at_times: Vec::new(), between: Vec::new(), time: self.time };
        for (view, composed) in &self.references {
            let ShownGaussians { static_, dynamic } = shown_at(view.time)?;
            let picture = blended_picture(static_.as_ref(), &dynamic, &view.camera, context, device)?;
            let ratios = if view.is_between { &mut loss.between } else { &mut loss.at_times };
            ratios.push(psnr(&picture, composed).map_or(EQUAL, |ratio| ratio.min(EQUAL)));
        }
        Ok(loss)
    }
}

impl Loss {
    /// Mean PSNR of all views; `None` if all images are equal.
    pub fn mean(&self) -> Option<f64> {
        let all = || self.at_times.iter().chain(&self.between);
        all().any(|&ratio| ratio < EQUAL).then(|| all().sum::<f64>() / all().count() as f64)
    }

    /// Lowest PSNR of all views.
    pub fn worst(&self) -> f64 {
        self.at_times.iter().chain(&self.between).copied().fold(EQUAL, f64::min)
    }
}

impl fmt::Display for Loss {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let mean = |ratios: &[f64]| ratios.iter().sum::<f64>() / ratios.len() as f64;
        match self.mean() {
            None => f.write_str("equal to `mvfusion render`")?,
            Some(all) if self.between.is_empty() => write!(f, "{all:.2} dB against `mvfusion render`")?,
            Some(_) => {
                let (trained, between) = (mean(&self.at_times), mean(&self.between));
                write!(
                    f,
                    "{trained:.2} dB against `mvfusion render` at training times, {between:.2} dB between keyframes"
                )?;
            }
        }
        let views = self.at_times.len() + self.between.len();
        if views > 1 && self.mean().is_some() {
            write!(f, ", worst {:.2} dB", self.worst())?;
        }
        let plural = if views == 1 { "" } else { "s" };
        match self.time {
            Some(time) => write!(f, ", {views} camera{plural} at time {time}"),
            None => write!(f, ", {views} view{plural}"),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_loss_says_what_was_compared() {
        let loss = |at_times: &[f64], between: &[f64], time| Loss {
            at_times: at_times.to_vec(),
            between: between.to_vec(),
            time,
        };
        let said = loss(&[36.456], &[], Some(0.5)).to_string();
        assert_eq!(said, "36.46 dB against `mvfusion render`, 1 camera at time 0.5");
        // Equal images count, so that one view does not speak for all.
        let said = loss(&[EQUAL, 41.0], &[], None).to_string();
        assert_eq!(said, "70.00 dB against `mvfusion render`, worst 41.00 dB, 2 views");
        let said = loss(&[50.0, 52.0], &[47.0], None).to_string();
        assert_eq!(
            said,
            "51.00 dB against `mvfusion render` at training times, 47.00 dB between keyframes, worst 47.00 dB, 3 views"
        );
        assert_eq!(loss(&[EQUAL; 8], &[], None).to_string(), "equal to `mvfusion render`, 8 views");
    }
}
