//! Curves as SVG: what a training's numbers did over its steps.

mod chart;
mod thin;

pub use chart::{Chart, Mark, Series, Weight};
pub use thin::{Point, running_mean};
