//! Where values stand in a drawing, whose coordinates run right and down.

use std::fmt::Write;

use super::axis::Axis;

/// The part of a drawing with the curves.
#[derive(Clone, Copy, Debug)]
pub struct Frame {
    /// Axis to the right.
    pub x: Axis,
    /// Axis upwards.
    pub y: Axis,
    /// Left, top, right and bottom, in the drawing's units.
    pub edges: [f64; 4],
}

impl Frame {
    /// The horizontal coordinate of a value.
    pub fn right(&self, x: f64) -> f64 {
        let [left, _, right, _] = self.edges;
        left + (right - left) * self.x.place(x)
    }

    /// The vertical coordinate of a value.
    pub fn down(&self, y: f64) -> f64 {
        let [_, top, _, bottom] = self.edges;
        bottom - (bottom - top) * self.y.place(y)
    }
}

/// The line through points, interrupted where there is none.
pub fn path(points: impl IntoIterator<Item = Option<[f64; 2]>>) -> String {
    let mut path = String::new();
    let mut is_down = false;
    for point in points {
        if let Some([x, y]) = point {
            // Writing to a string cannot fail.
            let _ = write!(path, "{}{} {}", if is_down { 'L' } else { 'M' }, shown(x), shown(y));
        }
        is_down = point.is_some();
    }
    path
}

/// A coordinate, to a tenth of a unit.
pub fn shown(coordinate: f64) -> String {
    format!("{coordinate:.1}")
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_line_stops_at_a_gap_and_goes_on_behind_it() {
        let points = [Some([0.0, 1.0]), Some([1.0, 2.0]), None, Some([3.0, 0.25])];
        assert_eq!(path(points), "M0.0 1.0L1.0 2.0M3.0 0.2");
        assert_eq!(path([None]), "");
    }

    #[test]
    fn values_grow_to_the_right_and_upwards() {
        let axis = Axis::linear([0.0, 4.0].into_iter());
        let frame = Frame { x: axis, y: axis, edges: [10.0, 20.0, 110.0, 220.0] };
        assert_eq!([frame.right(1.0), frame.down(1.0)], [35.0, 170.0]);
    }
}
