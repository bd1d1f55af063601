//! The frame rate of a model, as `eval` measures it.

use mvfusion_data::View;
use mvfusion_model::ModelError;
use mvfusion_model::evaluation::{Speed, WARM_UP, measure_speed};
use mvfusion_model::model::{DeformationLevel, Model, RenderContext};

use crate::progress::{Progress, Verbosity};
use crate::run::RenderSpeed;

/// Measures the frame rate of a model without autodiff over `frames` frames, with MFTA and, if that makes a difference,
/// without it. `None` for 0 frames.
///
/// # Errors
/// If the device fails or an op refuses its input.
pub(super) fn measure(
    model: &Model,
    views: &[View],
    level: DeformationLevel,
    context: &RenderContext,
    frames: usize,
    verbosity: Verbosity,
) -> Result<Option<RenderSpeed>, ModelError> {
    let measure = |model: &Model| -> Result<Option<Speed>, ModelError> {
        let mut progress = Progress::new("speed", WARM_UP + frames, verbosity);
        let speed = measure_speed(model, views, level, context, frames, || progress.advance())?;
        progress.finish();
        Ok(speed)
    };
    let (Some(view), Some(speed)) = (views.first(), measure(model)?) else { return Ok(None) };
    let without = match model.without_mfta(level) {
        Some(cheaper) => measure(&cheaper)?,
        None => None,
    };
    Ok(Some(RenderSpeed {
        width: view.camera.width,
        height: view.camera.height,
        warm_up: WARM_UP,
        frames,
        fps: speed.per_second(),
        fps_without_mfta: without.map(|speed| speed.per_second()),
    }))
}
