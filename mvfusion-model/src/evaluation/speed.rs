//! Frames a second (METHOD A35): deformation, refinement and rasterisation of whole pictures, with nothing read or
//! written and no picture handed back to the host.

use std::time::Instant;

use mvfusion_data::View;
use serde::{Deserialize, Serialize};

use super::layer::Layer;
use super::layers::LayerRenderer;
use crate::ModelError;
use crate::model::{DeformationLevel, Model, RenderContext};

/// Frames before the clock starts.
pub const WARM_UP: usize = 20;

/// How fast a model without autodiff renders.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Speed {
    /// Frames between the two looks at the clock.
    pub frames: usize,
    /// Seconds they took.
    pub seconds: f64,
}

impl Speed {
    /// Frames a second.
    pub fn per_second(&self) -> f64 {
        self.frames as f64 / self.seconds
    }
}

/// Renders `views` in turn, over and over: [`WARM_UP`] frames, then `frames` under the clock. `each` is called after
/// every frame. `None` if there is nothing to render.
///
/// # Errors
/// If the device fails or an op refuses its input.
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
