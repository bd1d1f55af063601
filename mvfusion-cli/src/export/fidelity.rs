//! How close exported Gaussians come to the model that they stand for.

use std::fmt;

use image::RgbImage;
use mvfusion_data::{Camera, GaussianCloud, View};
use mvfusion_model::evaluation::{Layer, LayerRenderer, blended_picture, psnr};
use mvfusion_model::model::RenderContext;
use mvfusion_model::timeline::spread;

use super::Exporter;
use crate::device::OpenDevice;

/// Maximum number of renders that are compared.
const MOST_VIEWS: usize = 8;

/// The composed renders of a model, as `mvfusion render` makes them, for comparison with exported Gaussians.
#[derive(Debug)]
pub struct Fidelity<'a> {
    context: &'a RenderContext,
    device: &'a OpenDevice,
    references: Vec<Reference>,
    /// The time of all renders, if it is one.
    time: Option<f64>,
}

#[derive(Debug)]
struct Reference {
    camera: Camera,
    time: f64,
    composed: RgbImage,
}

/// The PSNR of exported Gaussians against the composed renders.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Loss {
    /// Mean over the views that differ; `None` if all are equal.
    pub psnr: Option<f64>,
    views: usize,
    time: Option<f64>,
}

impl<'a> Fidelity<'a> {
    /// Renders some of the views: the distinct cameras at `time`, or each view at its own time.
    ///
    /// # Errors
    /// If the device fails.
    pub fn new(
        exporter: &'a Exporter,
        views: &[View],
        device: &'a OpenDevice,
        time: Option<f64>,
    ) -> anyhow::Result<Self> {
        let Exporter { model, level, context } = exporter;
        let renderer = LayerRenderer::new(model, *level, context, &[Layer::Composed], context.motion.weights)?;
        let mut references = Vec::new();
        for (camera, time) in chosen(views, time) {
            let rendered = renderer.render(&camera, time)?;
            // Proof: one layer was asked for.
            let composed = renderer.picture(rendered.first().expect("the composed layer"))?;
            references.push(Reference { camera, time, composed });
        }
        Ok(Self { context, device, references, time })
    }

    /// Compares Gaussians with the renders. `cloud_at` has them at a time.
    ///
    /// # Errors
    /// If the Gaussians cannot be had, or the device fails.
    pub fn loss(&self, mut cloud_at: impl FnMut(f64) -> anyhow::Result<GaussianCloud>) -> anyhow::Result<Loss> {
        let mut ratios = Vec::new();
        for Reference { camera, time, composed } in &self.references {
            // As one cloud without masks, which is how other programs see it.
            let picture = blended_picture(None, &cloud_at(*time)?, camera, self.context, &self.device.device)?;
            ratios.extend(psnr(&picture, composed));
        }
        let mean = (!ratios.is_empty()).then(|| ratios.iter().sum::<f64>() / ratios.len() as f64);
        Ok(Loss { psnr: mean, views: self.references.len(), time: self.time })
    }
}

/// The cameras and times to compare.
fn chosen(views: &[View], time: Option<f64>) -> Vec<(Camera, f64)> {
    let mut found: Vec<(Camera, f64)> = Vec::new();
    for view in views {
        let one = (view.camera, time.unwrap_or(view.time));
        // A fixed camera at one time shows one picture.
        if !found.contains(&one) {
            found.push(one);
        }
    }
    spread(found.len(), MOST_VIEWS).into_iter().map(|index| found[index]).collect()
}

impl fmt::Display for Loss {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self.psnr {
            Some(psnr) => write!(f, "{psnr:.2} dB against `mvfusion render`")?,
            None => f.write_str("equal to `mvfusion render`")?,
        }
        let plural = if self.views == 1 { "" } else { "s" };
        match self.time {
            Some(time) => write!(f, ", {} camera{plural} at time {time}", self.views),
            None => write!(f, ", {} view{plural}", self.views),
        }
    }
}

#[cfg(test)]
mod tests {
    use mvfusion_data::{BuiltinKind, BuiltinOptions, builtin};

    use super::*;

    #[test]
    fn one_time_is_compared_from_each_camera_once_and_a_film_at_many_times() {
        let options = BuiltinOptions { width: 48, height: 36, ..BuiltinOptions::of_kind(BuiltinKind::Video) };
        let scene = builtin::builtin(&options);
        let mut cameras: Vec<Camera> = Vec::new();
        scene.test.iter().for_each(|view| {
            if !cameras.contains(&view.camera) {
                cameras.push(view.camera);
            }
        });
        let still = chosen(&scene.test, Some(0.5));
        assert_eq!(still.len(), cameras.len().min(MOST_VIEWS));
        assert!(still.iter().all(|(_, time)| *time == 0.5));
        let film = chosen(&scene.test, None);
        assert_eq!(film.len(), scene.test.len().min(MOST_VIEWS));
        assert_eq!(film[0].1, scene.test[0].time);
    }

    #[test]
    fn a_loss_says_what_was_compared() {
        let loss = Loss { psnr: Some(36.456), views: 1, time: Some(0.5) };
        assert_eq!(loss.to_string(), "36.46 dB against `mvfusion render`, 1 camera at time 0.5");
        let loss = Loss { psnr: None, views: 8, time: None };
        assert_eq!(loss.to_string(), "equal to `mvfusion render`, 8 views");
    }
}
