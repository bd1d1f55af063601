//! The drawing of a metric over a swept key, as an SVG file that needs nothing else.

use maud::{Markup, PreEscaped, html};

use super::Spread;
use super::plots::{Plot, Point, Series};
use super::scale;
use crate::drawing::{Axis, Frame, Tick, path, shown};

/// Width of the drawing, and height without the legend.
const SIZE: [f64; 2] = [640.0, 380.0];
/// Room around the curves: left, top, right, bottom.
const MARGINS: [f64; 4] = [76.0, 40.0, 20.0, 56.0];
/// Height of a line of the legend.
const LINE: f64 = 18.0;
/// Left, top, right and bottom of the part with the curves.
const EDGES: [f64; 4] = [MARGINS[0], MARGINS[1], SIZE[0] - MARGINS[2], SIZE[1] - MARGINS[3] - LINE];
/// Room between the values and the edges, as a share of their range.
const ROOM: f64 = 0.06;
/// Half the width of the ends of a spread's bar.
const CAP: f64 = 4.0;
/// Ticks that are aimed at along the metrics.
const TICKS: usize = 6;
/// Width of a letter of a tick, a little too wide rather than too narrow.
const LETTER: f64 = 7.0;
/// Most letters of the title and of a line of the legend.
const MOST_LETTERS: usize = 88;
/// Colours that the colour-blind can tell apart as well (Okabe and Ito).
const COLOURS: [&str; 7] = ["#0072b2", "#d55e00", "#009e73", "#cc79a7", "#e69f00", "#56b4e9", "#000000"];

/// What the file needs to look the same everywhere.
const STYLE: &str = "text{font:12px \"Helvetica Neue\",Arial,sans-serif;fill:#1c2024}\
    .title{font-size:14px;font-weight:600}.grid{stroke:#dde1e6}.axis{stroke:#5b636c}\
    .mean{fill:none;stroke-width:1.8;stroke-linejoin:round}.spread{stroke-width:1.2}\
    .paper{fill:none;stroke-width:1.4;stroke-dasharray:5 4}.hollow{fill:#fff;stroke-width:1.4}";

impl Plot {
    /// The file.
    pub fn svg(&self) -> String {
        let swept = self.swept();
        let metrics = self.points().flat_map(|point| {
            let (mean, deviation) = point.spread.map_or((None, 0.0), |s| (Some(s.mean), s.deviation.unwrap_or(0.0)));
            [mean.map(|mean| mean - deviation), mean.map(|mean| mean + deviation), point.paper].into_iter().flatten()
        });
        let frame = frame(scale::axis(&swept), Axis::linear(metrics));
        let height = SIZE[1] + LINE * self.legend_lines() as f64;
        let drawing = html! {
            svg xmlns="http://www.w3.org/2000/svg" width=(SIZE[0]) height=(height)
                viewBox=(format!("0 0 {} {height}", SIZE[0])) role="img" {
                title { (clean(&format!("{}: {} over {}", self.title, self.y_title, self.x_title))) }
                style { (PreEscaped(STYLE)) }
                rect width="100%" height="100%" fill="#fff" {}
                text.title x=(MARGINS[0]) y="24" { (clean(&self.title)) }
                (self.axes(&frame, &swept))
                @for (index, series) in self.series.iter().enumerate() { (line(series, index, &frame)) }
                (self.legend())
            }
        };
        drawing.into_string() + "\n"
    }

    fn points(&self) -> impl Iterator<Item = &Point> {
        self.series.iter().flat_map(|series| &series.points)
    }

    /// The different values of the key, in order.
    fn swept(&self) -> Vec<f64> {
        let mut swept: Vec<f64> = self.points().map(|point| point.x).collect();
        swept.sort_by(f64::total_cmp);
        swept.dedup();
        swept
    }

    fn axes(&self, frame: &Frame, swept: &[f64]) -> Markup {
        let [left, top, right, bottom] = EDGES;
        let x_ticks = with_room(scale::ticks(&frame.x, swept), frame);
        let middle = (top + bottom) / 2.0;
        html! {
            @for tick in frame.y.ticks(TICKS) {
                @let y = shown(frame.down(tick.value));
                line.grid x1=(left) x2=(right) y1=(y) y2=(y) {}
                text x=(left - 8.0) y=(y) text-anchor="end" dominant-baseline="middle" { (tick.label) }
            }
            @for (tick, has_room) in x_ticks {
                @let x = shown(frame.right(tick.value));
                line.axis x1=(x) x2=(x) y1=(bottom) y2=(bottom + 5.0) {}
                @if has_room { text x=(x) y=(bottom + 19.0) text-anchor="middle" { (tick.label) } }
            }
            line.axis x1=(left) x2=(right) y1=(bottom) y2=(bottom) {}
            line.axis x1=(left) x2=(left) y1=(top) y2=(bottom) {}
            text x=((left + right) / 2.0) y=(bottom + 40.0) text-anchor="middle" { (clean(&self.x_title)) }
            text x="16" y=(middle) text-anchor="middle" transform=(format!("rotate(-90 16 {middle})")) {
                (clean(&self.y_title))
            }
        }
    }

    fn papers(&self) -> impl Iterator<Item = &Point> {
        self.series.iter().flat_map(Series::papers)
    }

    fn legend_lines(&self) -> usize {
        self.series.len() + usize::from(self.papers().next().is_some())
    }

    /// A line for each series, and one for what is hollow.
    fn legend(&self) -> Markup {
        let left = MARGINS[0];
        let y = |row: usize| SIZE[1] + LINE * row as f64;
        html! {
            @for (row, series) in self.series.iter().enumerate() {
                line x1=(left) x2=(left + 24.0) y1=(y(row)) y2=(y(row)) stroke=(colour(row)) stroke-width="1.8" {}
                (dot(row, [left + 12.0, y(row)]))
                text x=(left + 32.0) y=(y(row)) dominant-baseline="middle" { (clean(&series.name)) }
            }
            @if self.papers().next().is_some() {
                @let y = y(self.series.len());
                @let is_comparable = self.papers().all(|point| point.is_comparable);
                @let words = if is_comparable { "the paper" } else { "the paper, not comparable\u{2020}" };
                line.paper x1=(left) x2=(left + 24.0) y1=(y) y2=(y) stroke="#5b636c" {}
                circle.hollow cx=(left + 12.0) cy=(y) r="3.5" stroke="#5b636c" {}
                text x=(left + 32.0) y=(y) dominant-baseline="middle" { (words) ", in the same colours" }
            }
        }
    }
}

fn frame(x: Axis, y: Axis) -> Frame {
    Frame { x: x.with_room(ROOM), y: y.with_room(ROOM), edges: EDGES }
}

/// Ticks, and whether the label of each would stand clear of the last one that is written.
fn with_room(ticks: Vec<Tick>, frame: &Frame) -> Vec<(Tick, bool)> {
    let mut end = f64::NEG_INFINITY;
    let placed = ticks.into_iter().map(|tick| {
        let half = LETTER * tick.label.len() as f64 / 2.0;
        let middle = frame.right(tick.value);
        let has_room = middle - half > end;
        if has_room {
            end = middle + half;
        }
        (tick, has_room)
    });
    placed.collect()
}

/// The paper's dots below ours, with their lines and the bars of the spread.
fn line(series: &Series, index: usize, frame: &Frame) -> Markup {
    let colour = colour(index);
    let ours: Vec<_> = series.points.iter().map(|point| (point.x, point.spread)).collect();
    let means: Vec<_> = ours.iter().map(|(x, spread)| spread.map(|s| [frame.right(*x), frame.down(s.mean)])).collect();
    // The paper need not have every value that was trained.
    let paper = series.points.iter().filter_map(|point| Some([frame.right(point.x), frame.down(point.paper?)]));
    let paper: Vec<_> = paper.map(Some).collect();
    let bars = ours.iter().filter_map(|(x, spread)| {
        let Spread { mean, deviation } = (*spread)?;
        let deviation = deviation?;
        Some([frame.right(*x), frame.down(mean + deviation), frame.down(mean - deviation)])
    });
    html! {
        @if !paper.is_empty() { path.paper stroke=(colour) d=(path(paper.iter().copied())) {} }
        @for [x, y] in paper.iter().flatten() {
            circle.hollow stroke=(colour) cx=(shown(*x)) cy=(shown(*y)) r="3.5" {}
        }
        @for [x, high, low] in bars {
            @let (start, end) = (shown(x - CAP), shown(x + CAP));
            path.spread fill="none" stroke=(colour)
                d=(format!("M{start} {0}H{end}M{1} {0}V{2}M{start} {2}H{end}", shown(high), shown(x), shown(low))) {}
        }
        path.mean stroke=(colour) d=(path(means.iter().copied())) {}
        @for place in means.iter().flatten() { (dot(index, *place)) }
    }
}

/// A mark of ours: round, and square or a triangle where the colours begin anew.
fn dot(index: usize, [x, y]: [f64; 2]) -> Markup {
    let (at, colour) = (format!("M{} {}", shown(x), shown(y)), colour(index));
    html! {
        @match index / COLOURS.len() % 3 {
            0 => circle.dot fill=(colour) cx=(shown(x)) cy=(shown(y)) r="3" {},
            1 => path.dot fill=(colour) d={ (at) "m-3-3h6v6h-6z" } {},
            _ => path.dot fill=(colour) d={ (at) "m0-4l4 7h-8z" } {},
        }
    }
}

fn colour(index: usize) -> &'static str {
    COLOURS[index % COLOURS.len()]
}

/// A text that fits, without the letters that XML does not have.
fn clean(text: &str) -> String {
    let mut letters = text.chars().map(|letter| if letter.is_control() { ' ' } else { letter });
    let mut text: String = letters.by_ref().take(MOST_LETTERS).collect();
    if letters.next().is_some() {
        text.pop();
        text.push('\u{2026}');
    }
    text
}

#[cfg(test)]
#[path = "plot_tests.rs"]
mod tests;
