//! The Gaussians of a page, rendered by the rasteriser, compared with the renders of the model.

use mvfusion_data::View;
use mvfusion_data::keyframes::Keyframes;
use mvfusion_model::evaluation::{Layer, LayerRenderer, blended_picture, psnr};
use mvfusion_model::timeline::spread;

use crate::export::Exporter;
use crate::progress::{Progress, Verbosity};
use crate::run::OpenRun;

/// Number of compared views.
const VIEWS: usize = 8;
/// PSNR of equal images, which has no bound.
const EQUAL: f64 = 99.0;

/// PSNR of some views in dB.
#[derive(Clone, Debug, PartialEq)]
pub struct Quality {
    /// PSNR of each compared view against `mvfusion render`, 8 bits; 99 for equal images.
    pub views: Vec<f64>,
}

impl Quality {
    /// Compares `branches` with the model at views that are spread over the held-out ones, or over the training views
    /// of a photo collection, whose held-out photos have no trained time.
    ///
    /// # Errors
    /// If the device fails.
    pub(super) fn measure(
        run: &OpenRun,
        exporter: &Exporter,
        branches: &[Keyframes],
        verbosity: Verbosity,
    ) -> anyhow::Result<Self> {
        let (Exporter { model, level, context }, device) = (exporter, &run.device.device);
        let renderer = LayerRenderer::new(model, *level, context, &[Layer::Composed], run.config.motion.weights)?;
        let scene = &run.scene;
        let is_timed = scene.capture == mvfusion_data::Capture::Video && !scene.test.is_empty();
        let views: &[View] = if is_timed { &scene.test } else { &scene.train };
        let chosen = spread(views.len(), VIEWS);
        let mut progress = Progress::new("comparison", chosen.len(), verbosity);
        let mut found = Vec::new();
        for index in chosen {
            let View { camera, time, .. } = &views[index];
            let clouds: Vec<_> = branches.iter().map(|branch| branch.at(*time)).collect();
            let [static_ @ .., dynamic] = clouds.as_slice() else { continue };
            let packed = blended_picture(static_.first(), dynamic, camera, context, device)?;
            let rendered = renderer.render(camera, *time)?;
            let model = renderer.picture(&rendered[0])?;
            found.push(psnr(&packed, &model).unwrap_or(EQUAL));
            progress.advance();
        }
        progress.finish();
        Ok(Self { views: found })
    }

    /// Mean over the views, in dB.
    pub fn mean(&self) -> f64 {
        self.views.iter().sum::<f64>() / self.views.len().max(1) as f64
    }

    /// The view with the lowest PSNR, in dB.
    pub fn worst(&self) -> f64 {
        self.views.iter().copied().fold(EQUAL, f64::min)
    }
}
