//! The section that shows held-out views over time: two screens, a slider through time, and a button that plays.

use maud::{Markup, html};
use mvfusion_model::evaluation::Layer;

use super::{Film, FilmFrame};
use crate::drawing::{Axis, Frame, path};
use crate::report::album::without_layers;
use crate::report::files::RunFiles;
use crate::report::snippet::{notice, number};
use crate::run::PictureKind;

/// The first choices of the two screens.
const FIRST: [PictureKind; 2] = [PictureKind::GroundTruth, PictureKind::Model(Layer::Composed)];
/// Size of the curve above the slider, in its own units.
const TRACE: [f64; 2] = [1000.0, 60.0];

/// The whole section.
pub(in crate::report) fn section(files: &RunFiles, film: &Film) -> Markup {
    html! {
        @if film.frames.len() < 2 {
            @if film.frames.is_empty() { (notice(&without_layers(files))) }
            @else { p.note { "Only one held-out view has images, so there is nothing to play." } }
        } @else {
            p.note.script {
                "Drag the slider or a picture, use the arrow keys, or play. "
                @if film.frames.len() < film.in_folder {
                    (film.frames.len()) " of the " (film.in_folder) " held-out views are shown, evenly spaced."
                }
            }
            noscript { p.missing { "The film needs JavaScript. Single views are shown below." } }
            (figure(film))
        }
    }
}

fn figure(film: &Film) -> Markup {
    let last = film.frames.len() - 1;
    let [width, height] = film.size;
    let choices = choices(film);
    html! {
        figure.film.script data-frames=(film.frames.len()) {
            div.screens {
                @for (side, chosen) in ["left", "right"].into_iter().zip(choices) {
                    div.screen {
                        (choice(film, chosen, side))
                        img draggable="false" data-kind=(chosen.folder()) alt=(format!("{side} picture of the film"))
                            style=(format!("aspect-ratio: {width} / {height}"));
                    }
                }
            }
            (trace(&film.frames))
            div.controls {
                button.play type="button" aria-pressed="false" { "Play" }
                input.moment type="range" min="0" max=(last) step="1" value="0" autocomplete="off"
                    aria-label="held-out view, by time";
                output.caption { (caption(&film.frames[0])) }
            }
            ol.frames hidden {
                @for frame in &film.frames {
                    li data-caption=(caption(frame)) {
                        @for (kind, uri) in &frame.images { data class=(kind.folder()) value=(uri) {} }
                    }
                }
            }
        }
    }
}

/// The layers that the screens show first.
fn choices(film: &Film) -> [PictureKind; 2] {
    let has = |kind: &PictureKind| film.kinds.contains(kind);
    let other = |index: usize| film.kinds.get(index).or(film.kinds.last()).copied().unwrap_or(FIRST[1]);
    [0, 1].map(|side| if has(&FIRST[side]) { FIRST[side] } else { other(side) })
}

fn choice(film: &Film, chosen: PictureKind, side: &str) -> Markup {
    html! {
        select autocomplete="off" aria-label=(format!("layer on the {side}")) {
            @for kind in &film.kinds {
                option value=(kind.folder()) selected[*kind == chosen] { (kind.label()) }
            }
        }
    }
}

/// A frame in words.
fn caption(frame: &FilmFrame) -> String {
    let time = frame.time.map(|time| format!("time {time:.3}"));
    let psnr = frame.psnr.map(|psnr| format!("{} dB", number(psnr, 2)));
    let parts = std::iter::once(frame.name.clone()).chain(time).chain(psnr);
    parts.collect::<Vec<_>>().join(" \u{00b7} ")
}

/// The PSNR of the frames as a curve above the slider, with a line that the script moves.
fn trace(frames: &[FilmFrame]) -> Markup {
    let known: Vec<f64> = frames.iter().filter_map(|frame| frame.psnr).filter(|psnr| psnr.is_finite()).collect();
    let low = known.iter().copied().fold(f64::INFINITY, f64::min);
    let high = known.iter().copied().fold(f64::NEG_INFINITY, f64::max);
    let [width, height] = TRACE;
    let axis = Axis::linear(known.iter().copied()).with_room(0.1);
    let plot = Frame {
        x: Axis::linear([0.0, frames.len() as f64 - 1.0].into_iter()),
        y: axis,
        edges: [0.0, 0.0, width, height],
    };
    let points = frames.iter().enumerate().map(|(index, frame)| {
        let psnr = frame.psnr.filter(|psnr| psnr.is_finite())?;
        Some([plot.right(index as f64), plot.down(psnr)])
    });
    html! {
        @if known.len() > 1 {
            p.note.scale { "PSNR of the composed render, " (number(low, 2)) " to " (number(high, 2)) " dB" }
            div.trace {
                svg viewBox=(format!("0 0 {width} {height}")) preserveAspectRatio="none" role="img"
                    aria-label=(format!("PSNR of the composed render over the film, {low:.2} to {high:.2} dB")) {
                    path.curve.bold.c0 d=(path(points)) vector-effect="non-scaling-stroke" {}
                }
                span.now {}
            }
        }
    }
}
