//! A plot of cameras: what is to the right and upwards, and where things are drawn.

use glam::DVec3;
use maud::{Markup, html};
use mvfusion_model::timeline::spread;

use super::time_colours::TimeColours;
use crate::drawing::{Axis, Frame, path, shown};
use crate::run::{SceneCamera, SceneFile};

/// Size of a plot in its own units.
const SIZE: [f64; 2] = [480.0, 400.0];
/// Left, top, right and bottom of the part with the cameras.
const EDGES: [f64; 4] = [46.0, 14.0, 470.0, 368.0];
/// Maximum number of cameras that are drawn of each kind.
pub(super) const MOST_CAMERAS: usize = 200;
/// Depth of a drawn camera, as a share of the plot's range.
const DEPTH: f64 = 0.06;
/// Desired number of ticks of each axis.
const TICKS: usize = 8;

/// What is drawn to the right and upwards.
pub(super) struct Projection {
    /// Where the plot looks from.
    pub title: &'static str,
    /// To the right.
    pub right: DVec3,
    /// Upwards.
    pub up: DVec3,
    /// Names of both.
    pub names: [&'static str; 2],
}

impl Projection {
    fn place(&self, point: DVec3) -> [f64; 2] {
        [point.dot(self.right), point.dot(self.up)]
    }

    /// The plot as a figure.
    pub fn draw(&self, scene: &SceneFile, timed: Option<&TimeColours>) -> Markup {
        let centre = self.place(DVec3::from_array(scene.centre));
        let corners: Vec<[f64; 2]> = scene.points.map_or(Vec::new(), |points| self.corners(points));
        let places = scene.cameras.iter().map(|camera| self.place(DVec3::from_array(camera.position)));
        let around = [-1.0, 1.0].map(|sign| [0, 1].map(|axis| centre[axis] + sign * scene.extent));
        let all: Vec<[f64; 2]> = places.chain(corners.iter().copied()).chain(around).collect();
        let (frame, scale, range) = fitted(&all);
        let [left, top, right, bottom] = EDGES;
        let at = |[x, y]: [f64; 2]| [frame.right(x), frame.down(y)];
        let [x, y] = at(centre);
        html! {
            figure.chart {
                figcaption { b { (self.title) } " (" (self.names[0]) ", " (self.names[1]) ")" }
                svg viewBox=(format!("0 0 {} {}", SIZE[0], SIZE[1])) role="img"
                    aria-label=(format!("the cameras of the scene {}", self.title.to_lowercase())) {
                    @for tick in frame.x.ticks(TICKS) {
                        @let x = shown(frame.right(tick.value));
                        line.grid x1=(x) x2=(x) y1=(top) y2=(bottom) {}
                        text.tick x=(x) y=(bottom + 15.0) text-anchor="middle" { (tick.label) }
                    }
                    @for tick in frame.y.ticks(TICKS) {
                        @let y = shown(frame.down(tick.value));
                        line.grid x1=(left) x2=(right) y1=(y) y2=(y) {}
                        text.tick x=(left - 6.0) y=(y) text-anchor="end" dominant-baseline="middle" { (tick.label) }
                    }
                    circle.extent cx=(shown(x)) cy=(shown(y)) r=(shown(scene.extent * scale)) {}
                    @if !corners.is_empty() {
                        path.box d=(closed(&corners.iter().map(|&corner| at(corner)).collect::<Vec<_>>())) {}
                    }
                    @for is_held_out in [false, true] {
                        @let kind: Vec<&SceneCamera> =
                            scene.cameras.iter().filter(|camera| camera.is_held_out == is_held_out).collect();
                        @for index in spread(kind.len(), MOST_CAMERAS) {
                            (self.camera(kind[index], DEPTH * range, &at, timed))
                        }
                    }
                }
            }
        }
    }

    /// The outline of a box, whose edges run along the axes of the world: the hull of its corners.
    fn corners(&self, [low, high]: [[f64; 3]; 2]) -> Vec<[f64; 2]> {
        let corner = |bits: usize| {
            let pick = |axis: usize| if bits >> axis & 1 == 1 { high[axis] } else { low[axis] };
            self.place(DVec3::new(pick(0), pick(1), pick(2)))
        };
        hull((0..8).map(corner).collect())
    }

    /// A camera as a pyramid of lines from its centre.
    fn camera(
        &self,
        camera: &SceneCamera,
        depth: f64,
        at: &impl Fn([f64; 2]) -> [f64; 2],
        timed: Option<&TimeColours>,
    ) -> Markup {
        let centre = DVec3::from_array(camera.position);
        let [right, down, forward] = camera.axes.map(DVec3::from_array);
        let [half_width, half_height] = camera.half_size;
        // The longest ray has the given length, whatever the field of view.
        let reach = depth / (1.0 + half_width * half_width + half_height * half_height).sqrt();
        let corner = |(x, y): (f64, f64)| {
            at(self.place(centre + reach * (forward + x * half_width * right + y * half_height * down)))
        };
        let base = [(-1.0, -1.0), (1.0, -1.0), (1.0, 1.0), (-1.0, 1.0)].map(corner);
        let tip = at(self.place(centre));
        // Numbers of a damaged file may be beyond all bounds.
        if !base.iter().chain([&tip]).flatten().all(|coordinate| coordinate.is_finite()) {
            return html! {};
        }
        let rays: String = base.iter().map(|&corner| path([Some(tip), Some(corner)])).collect();
        let kind = if camera.is_held_out { "camera held" } else { "camera" };
        let colour = timed.and_then(|timed| timed.of_camera(camera));
        html! {
            g class=(kind) style=[colour.map(|colour| format!("--curve: {colour}"))] {
                title { (camera.name) ", " (camera.views) " views" }
                path d=(closed(&base) + &rays) {}
                circle cx=(shown(tip[0])) cy=(shown(tip[1])) r="2.2" {}
            }
        }
    }
}

/// A frame with one scale along both axes that shows all points, the scale in units of the drawing, and the range.
fn fitted(points: &[[f64; 2]]) -> (Frame, f64, f64) {
    let ends = [0, 1].map(|axis| {
        let finite = points.iter().map(|point| point[axis]).filter(|value| value.is_finite());
        finite.fold((f64::INFINITY, f64::NEG_INFINITY), |(low, high), value| (low.min(value), high.max(value)))
    });
    let [left, top, right, bottom] = EDGES;
    let room = [right - left, bottom - top];
    let middle = ends.map(|(low, high)| if low <= high { 0.5 * (low + high) } else { 0.0 });
    let needed = [0, 1].map(|axis| (1.12 * (ends[axis].1 - ends[axis].0) / room[axis]).max(0.0));
    let unit = needed[0].max(needed[1]);
    let unit = if unit > 0.0 && unit.is_finite() { unit } else { 1.0 / room[0] };
    let axis = |axis: usize| {
        let half = 0.5 * unit * room[axis];
        Axis::linear([middle[axis] - half, middle[axis] + half].into_iter())
    };
    (Frame { x: axis(0), y: axis(1), edges: EDGES }, 1.0 / unit, unit * room[0].max(room[1]))
}

/// The outline of points, closed.
fn closed(points: &[[f64; 2]]) -> String {
    if points.is_empty() { String::new() } else { path(points.iter().copied().map(Some)) + "Z" }
}

/// The convex hull of points, by the monotone chain of Andrew.
fn hull(mut points: Vec<[f64; 2]>) -> Vec<[f64; 2]> {
    points.sort_by(|a, b| a[0].total_cmp(&b[0]).then(a[1].total_cmp(&b[1])));
    let turns_left =
        |a: [f64; 2], b: [f64; 2], c: [f64; 2]| (b[0] - a[0]) * (c[1] - a[1]) - (b[1] - a[1]) * (c[0] - a[0]) > 0.0;
    let chain = |points: &mut dyn Iterator<Item = [f64; 2]>| {
        let mut chain: Vec<[f64; 2]> = Vec::new();
        for point in points {
            while let [.., a, b] = chain[..]
                && !turns_left(a, b, point)
            {
                chain.pop();
            }
            chain.push(point);
        }
        chain.pop();
        chain
    };
    let mut lower = chain(&mut points.iter().copied());
    lower.extend(chain(&mut points.iter().rev().copied()));
    lower
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn both_axes_have_one_scale() {
        let (frame, scale, range) = fitted(&[[0.0, 0.0], [10.0, 1.0]]);
        assert!((frame.right(10.0) - frame.right(0.0) - 10.0 * scale).abs() < 1e-9);
        assert!((frame.down(0.0) - frame.down(1.0) - scale).abs() < 1e-9 && range > 10.0);
        // One place, or none, still has a frame.
        for points in [vec![], vec![[3.0, 3.0]], vec![[f64::NAN, 1.0]]] {
            let (frame, scale, _) = fitted(&points);
            assert!(scale.is_finite() && frame.right(3.0).is_finite(), "{points:?}");
        }
    }

    #[test]
    fn a_hull_leaves_out_what_is_inside() {
        let square = [[0.0, 0.0], [1.0, 0.0], [1.0, 1.0], [0.0, 1.0]];
        let inside = [[0.5, 0.5], [0.25, 0.75]];
        let mut found = hull(square.into_iter().chain(inside).collect());
        found.sort_by(|a, b| a[0].total_cmp(&b[0]).then(a[1].total_cmp(&b[1])));
        assert_eq!(found, [[0.0, 0.0], [0.0, 1.0], [1.0, 0.0], [1.0, 1.0]]);
    }
}
