//! What drawings of curves share: their axes, and lines between values on the way to SVG.

mod axis;
mod frame;

pub use axis::{Axis, Spacing, Tick};
pub use frame::{Frame, path, shown};
