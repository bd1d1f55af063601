//! Curves as SVG: the values of a training over its steps.

mod chart;
mod thin;

pub use chart::{Chart, Mark, Series, Weight};
pub use thin::{Point, running_mean};
