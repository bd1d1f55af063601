//! The colours of times, for cameras that look at different ones.

use colorgrad::Gradient;
use maud::{Markup, html};

use crate::run::{SceneCamera, SceneFile};

/// Steps of the colours in the legend.
const COLOURS: usize = 6;
/// The part of the colour map that is visible on light and on dark ground.
const MAP: [f32; 2] = [0.1, 0.85];
/// Share of the whole time below which a camera's views count as one moment.
const MOMENT: f64 = 0.5;

/// The colours of times, where cameras have moments of their own.
pub(super) struct TimeColours {
    range: [f64; 2],
}

impl TimeColours {
    /// The colours of a scene; `None` if its cameras film the same moments.
    pub fn of(scene: &SceneFile) -> Option<Self> {
        let times = scene.cameras.iter().flat_map(|camera| camera.times);
        let range = times.fold([f64::INFINITY, f64::NEG_INFINITY], |[low, high], time| [low.min(time), high.max(time)]);
        let whole = range[1] - range[0];
        let timed = Self { range };
        let moments = scene.cameras.iter().filter(|camera| timed.of_camera(camera).is_some()).count();
        (whole > 0.0 && 2 * moments > scene.cameras.len()).then_some(timed)
    }

    /// The colour of a camera that looks at one moment.
    pub fn of_camera(&self, camera: &SceneCamera) -> Option<String> {
        let [first, last] = self.range;
        let [begin, end] = camera.times;
        let is_moment = end - begin < MOMENT * (last - first);
        is_moment.then(|| colour((0.5 * (begin + end) - first) / (last - first)))
    }

    /// The first and last time, with the colours in between.
    pub fn legend(&self) -> Markup {
        let colours: Vec<String> = (0..COLOURS).map(|step| colour(step as f64 / (COLOURS - 1) as f64)).collect();
        html! {
            span.ramp {
                (format!("time {:.2}", self.range[0]))
                span style=(format!("background: linear-gradient(to right, {})", colours.join(", "))) {}
                (format!("{:.2}", self.range[1]))
            }
        }
    }
}

/// A colour of the map plasma of Matplotlib, whose steps look equally large.
pub(super) fn colour(share: f64) -> String {
    let [low, high] = MAP;
    let [r, g, b, _] = colorgrad::preset::plasma().at(low + (high - low) * share as f32).to_rgba8();
    format!("#{r:02x}{g:02x}{b:02x}")
}
