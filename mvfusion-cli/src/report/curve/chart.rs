//! A chart: axes, curves and marks as inline SVG, in the colours of the page.

use std::fmt::Write;

use maud::{Markup, html};

use super::thin::{Point, thin};
use crate::drawing::{Axis, Frame, Spacing, path, shown};

/// Size of the drawing in its own units. The page scales it.
const SIZE: [f64; 2] = [560.0, 250.0];
/// Room around the curves: left, top, right, bottom.
const MARGINS: [f64; 4] = [54.0, 30.0, 14.0, 36.0];
/// Left, top, right and bottom of the part with the curves.
const EDGES: [f64; 4] = [MARGINS[0], MARGINS[1], SIZE[0] - MARGINS[2], SIZE[1] - MARGINS[3]];
/// Minimum ratio of the largest to the smallest value for a logarithmic axis.
const LOGARITHMIC_FROM: f64 = 10.0;
/// Maximum number of points of a curve.
const MOST_POINTS: usize = 1000;
/// Maximum number of points that are marked by dots.
const DOTTED: usize = 40;
/// Desired number of ticks along x and y.
const TICKS: [usize; 2] = [6, 5];
/// Width of a letter in the name of a mark, estimated generously.
const LETTER: f64 = 6.2;

/// How strongly a curve is drawn.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Weight {
    /// A main curve.
    Bold,
    /// A background curve.
    Faint,
}

/// A curve.
#[derive(Clone, Debug)]
pub struct Series {
    /// Name for the legend. Curves without a name are not in the legend.
    pub name: Option<String>,
    /// Index of its colour in the page, from 0.
    pub colour: usize,
    /// How strongly it is drawn.
    pub weight: Weight,
    /// Its points, by x.
    pub points: Vec<Point>,
}

/// A vertical line with a name, at the start of something.
#[derive(Clone, Debug, PartialEq)]
pub struct Mark {
    /// Position.
    pub x: f64,
    /// Name of what starts there.
    pub name: String,
}

/// A chart.
#[derive(Clone, Debug)]
pub struct Chart<'a> {
    /// Name of the values, with their unit.
    pub title: &'a str,
    /// Name of x.
    pub x_title: &'a str,
    /// The curves.
    pub series: Vec<Series>,
    /// The marks, by x.
    pub marks: &'a [Mark],
    /// Axis of the values.
    pub values: Axis,
}

impl<'a> Chart<'a> {
    /// A chart with an axis that fits the values: logarithmic if they span a decade or more.
    pub fn fitting(title: &'a str, series: Vec<Series>, marks: &'a [Mark]) -> Self {
        let values = series.iter().flat_map(|series| series.points.iter().map(|point| point.y));
        let values = Axis::logarithmic_from(LOGARITHMIC_FROM, values);
        Self { title, x_title: "step", series, marks, values }
    }

    /// A chart with a linear axis.
    pub fn linear(title: &'a str, series: Vec<Series>, marks: &'a [Mark]) -> Self {
        let values = Axis::linear(series.iter().flat_map(|series| series.points.iter().map(|point| point.y)));
        Self { title, x_title: "step", series, marks, values }
    }

    /// A chart of amounts, with a linear axis from zero.
    pub fn amounts(title: &'a str, series: Vec<Series>, marks: &'a [Mark]) -> Self {
        let chart = Self::linear(title, series, marks);
        Self { values: chart.values.down_to_zero(), ..chart }
    }

    /// The chart as a figure with title, legend and drawing, or a sentence if there is nothing to draw.
    pub fn draw(&self) -> Markup {
        let is_empty = self.series.iter().all(|series| series.points.iter().all(|point| !point.y.is_finite()));
        let logarithmic = self.values.spacing() == Spacing::Logarithmic;
        html! {
            figure.chart {
                figcaption {
                    b { (self.title) }
                    @if logarithmic { " (logarithmic)" }
                    @for series in &self.series {
                        @if let Some(name) = &series.name { " " span class={ "key c" (series.colour) } { (name) } }
                    }
                }
                @if is_empty {
                    p.missing { "Nothing was recorded." }
                } @else {
                    (self.drawing())
                }
            }
        }
    }

    fn drawing(&self) -> Markup {
        let xs = self.series.iter().flat_map(|series| series.points.iter().map(|point| point.x));
        let xs = Axis::linear(xs.chain(self.marks.iter().map(|mark| mark.x)));
        let frame = Frame { x: xs, y: self.values, edges: EDGES };
        let [left, top, right, bottom] = EDGES;
        html! {
            svg viewBox=(format!("0 0 {} {}", SIZE[0], SIZE[1])) role="img" aria-label=(self.summary()) {
                @for tick in frame.y.ticks(TICKS[1]) {
                    @let y = shown(frame.down(tick.value));
                    line.grid x1=(left) x2=(right) y1=(y) y2=(y) {}
                    text.tick x=(left - 6.0) y=(y) text-anchor="end" dominant-baseline="middle" { (tick.label) }
                }
                @for tick in frame.x.ticks(TICKS[0]) {
                    @let x = shown(frame.right(tick.value));
                    line.grid x1=(x) x2=(x) y1=(bottom) y2=(bottom + 4.0) {}
                    text.tick x=(x) y=(bottom + 15.0) text-anchor="middle" { (tick.label) }
                }
                text.tick x=((left + right) / 2.0) y=(SIZE[1] - 4.0) text-anchor="middle" { (self.x_title) }
                line.axis x1=(left) x2=(right) y1=(bottom) y2=(bottom) {}
                line.axis x1=(left) x2=(left) y1=(top) y2=(bottom) {}
                (self.marks(&frame))
                @for series in &self.series { (curve(series, &frame)) }
            }
        }
    }

    /// The marks. A name that would overlap the previous one is placed one line higher.
    fn marks(&self, frame: &Frame) -> Markup {
        let [_, top, right, bottom] = EDGES;
        let mut ends = [f64::NEG_INFINITY; 2];
        let placed = self.marks.iter().map(|mark| {
            let x = frame.right(mark.x);
            let width = LETTER * mark.name.chars().count() as f64;
            let start = (x + 3.0).min(right - width);
            let row = usize::from(start < ends[0] && ends[1] < ends[0]);
            ends[row] = start + width + LETTER;
            (mark, x, start, top - 5.0 - 12.0 * row as f64)
        });
        html! {
            @for (mark, x, start, y) in placed {
                line.mark x1=(shown(x)) x2=(shown(x)) y1=(y + 2.0) y2=(bottom) {}
                text.stage x=(shown(start)) y=(y) { (mark.name) }
            }
        }
    }

    /// A description of the chart, for screen readers.
    fn summary(&self) -> String {
        let mut text = self.title.to_owned();
        for series in self.series.iter().filter(|series| series.weight == Weight::Bold) {
            let finite = || series.points.iter().filter(|point| point.y.is_finite());
            if let (Some(first), Some(last)) = (finite().next(), finite().next_back()) {
                let name = series.name.as_ref().map_or(String::new(), |name| format!(" {name}"));
                // Writing to a string cannot fail.
                let _ = write!(
                    text,
                    ";{name} from {:.4} at {1} {2} to {3:.4} at {1} {4}",
                    first.y, self.x_title, first.x, last.y, last.x
                );
            }
        }
        text
    }
}

/// The line of a curve, interrupted at its gaps, and its dots if there are few.
fn curve(series: &Series, frame: &Frame) -> Markup {
    let points: Vec<Option<[f64; 2]>> = thin(&series.points, MOST_POINTS)
        .iter()
        .map(|point| point.y.is_finite().then(|| [frame.right(point.x), frame.down(point.y)]))
        .collect();
    let dots = points.iter().flatten().filter(|_| points.len() <= DOTTED);
    let weight = if series.weight == Weight::Bold { "bold" } else { "faint" };
    let colour = format!("c{}", series.colour);
    html! {
        path class={ "curve " (weight) " " (colour) } d=(path(points.iter().copied())) {}
        @if series.weight == Weight::Bold {
            @for [x, y] in dots { circle class={ "dot " (colour) } cx=(shown(*x)) cy=(shown(*y)) r="2.5" {} }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn series(values: &[f64]) -> Series {
        let points = values.iter().enumerate().map(|(x, &y)| Point { x: x as f64, y }).collect();
        Series { name: None, colour: 0, weight: Weight::Bold, points }
    }

    #[test]
    fn no_number_of_a_drawing_is_not_finite() {
        for values in [vec![f64::NAN, 1.0], vec![f64::INFINITY, 2.0, 0.0], vec![5.0], vec![1e-300, 1e300]] {
            let drawn = Chart::fitting("loss", vec![series(&values)], &[]).draw().into_string();
            assert!(drawn.contains("<svg") && !drawn.contains("NaN") && !drawn.contains("inf"), "{values:?}: {drawn}");
        }
    }

    #[test]
    fn without_values_it_says_so() {
        for values in [vec![], vec![f64::NAN]] {
            let drawn = Chart::linear("PSNR", vec![series(&values)], &[]).draw().into_string();
            assert!(drawn.contains("Nothing was recorded") && !drawn.contains("<svg"), "{drawn}");
        }
    }

    #[test]
    fn names_of_marks_do_not_run_into_each_other() {
        let mark = |x, name: &str| Mark { x, name: name.to_owned() };
        let marks = [mark(0.0, "geometry"), mark(1.0, "deformation"), mark(50.0, "<b>&")];
        let drawn = Chart::linear("loss", vec![series(&[1.0; 100])], &marks).draw().into_string();
        let rows: Vec<&str> = drawn
            .split("<text class=\"stage\"")
            .skip(1)
            .filter_map(|rest| rest.split("y=\"").nth(1)?.split('"').next())
            .collect();
        assert_eq!(rows, ["25", "13", "25"], "{drawn}");
        assert!(drawn.contains("&lt;b&gt;&amp;"), "{drawn}");
    }
}
