//! How fast a model renders, as `eval` measures it.

use mvfusion_data::View;
use mvfusion_model::ModelError;
use mvfusion_model::evaluation::{Speed, WARM_UP, measure_speed};
use mvfusion_model::model::{Model, Movement, Surroundings};

use crate::progress::{Progress, Talk};
use crate::run::RenderSpeed;

/// Measures the speed of a model without autodiff over so many frames, with MFTA and, where it has an effect, without.
/// `None` for no frames.
///
/// # Errors
/// If the device fails or an op refuses its input.
pub(super) fn measure(
    model: &Model,
    views: &[View],
    movement: Movement,
    surroundings: &Surroundings,
    frames: usize,
    talk: Talk,
) -> Result<Option<RenderSpeed>, ModelError> {
    let measure = |surroundings: &Surroundings| -> Result<Option<Speed>, ModelError> {
        let mut progress = Progress::new("speed", WARM_UP + frames, talk);
        let speed = measure_speed(model, views, movement, surroundings, frames, || progress.advance())?;
        progress.finish();
        Ok(speed)
    };
    let (Some(view), Some(speed)) = (views.first(), measure(surroundings)?) else { return Ok(None) };
    let without = match surroundings.without_mfta(model, movement) {
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
