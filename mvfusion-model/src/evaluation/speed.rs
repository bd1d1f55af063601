//! FPS (METHOD A35): deformation, refinement and rasterisation of whole images. No files are read or written, and no
//! image is copied to the host.

use std::time::Instant;

use mvfusion_data::View;
use serde::{Deserialize, Serialize};

use super::layer::Layer;
use super::layers::LayerRenderer;
use crate::ModelError;
use crate::model::{DeformationLevel, Model, RenderContext};

/// Frames before the measurement.
pub const WARM_UP: usize = 20;

/// The rendering speed of a model without autodiff.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Speed {
    /// Number of measured frames.
    pub frames: usize,
    /// Duration of these frames in seconds.
    pub seconds: f64,
}

impl Speed {
    /// Frames per second.
    pub fn per_second(&self) -> f64 {
        self.frames as f64 / self.seconds
    }
}

/// Renders `views` cyclically: [`WARM_UP`] frames, then `frames` measured frames. `each` is called after every frame.
/// Returns `None` if there is nothing to render.
///
/// # Errors
/// If the device fails or an op rejects its input.
pub fn measure_speed(
    model: &Model,
    views: &[View],
    level: DeformationLevel,
    context: &RenderContext,
    frames: usize,
    mut each: impl FnMut(),
) -> Result<Option<Speed>, ModelError> {
    if views.is_empty() || frames == 0 {
        return Ok(None);
    }
    let device = model.dynamic.means.device();
    let sync = || device.sync().map_err(|error| ModelError::Device(error.to_string()));
    let renderer = LayerRenderer::as_trained(model, level, context, &[Layer::Composed])?;
    let mut turns = views.iter().cycle();
    let mut render = |count: usize| {
        turns.by_ref().take(count).try_for_each(|view| {
            renderer.render(&view.camera, view.time)?;
            each();
            Ok::<(), ModelError>(())
        })
    };
    render(WARM_UP)?;
    sync()?;
    let started = Instant::now();
    render(frames)?;
    sync()?;
    Ok(Some(Speed { frames, seconds: started.elapsed().as_secs_f64() }))
}
