//! The section of the training curves.

use maud::{Markup, html};
use mvfusion_model::Config;

use super::curve::{Chart, Mark, Point, Series, Weight, running_mean};
use super::files::RunFiles;
use super::log::Log;
use super::snippet::notice;

/// Curves with more points than this are drawn with their running mean over [`WINDOW`].
const NOISY: usize = 60;
/// The window of the mean is the number of points divided by this: wide enough to be smooth, and too short to hide the
/// start of a stage.
const WINDOW: usize = 30;

/// Loss, PSNR, numbers of Gaussians and speed over the steps.
pub(super) fn training(files: &RunFiles) -> Markup {
    match &files.log {
        Ok(log) => curves(log, &marks(files, log)),
        Err(missing) => notice(missing),
    }
}

fn curves(log: &Log, marks: &[Mark]) -> Markup {
    let count =
        |name: &str, colour, points| Series { name: Some(name.to_owned()), colour, weight: Weight::Bold, points };
    let gaussians = vec![
        count("static", 0, log.curve(|line| line.gaussians.static_)),
        count("dynamic", 1, log.curve(|line| line.gaussians.dynamic)),
    ];
    let pace = noisy(log.curve(|line| line.steps_per_second));
    html! {
        div.charts {
            (Chart::fitting("Loss", noisy(log.curve(|line| line.loss)), marks).draw())
            (Chart::linear("PSNR of the training batch, dB", noisy(log.curve(|line| line.psnr)), marks).draw())
            (Chart::amounts("Gaussians", known(gaussians), marks).draw())
            (Chart::amounts("Steps per second", pace, marks).draw())
        }
        p.note {
            "From metrics.jsonl, " (log.lines.len()) " lines. "
            @if log.lines.len() > NOISY {
                "Pale curves show single batches, strong curves their running mean. "
            }
            @if log.unreadable > 0 { b { (log.unreadable) " lines could not be read and are left out." } }
        }
    }
}

/// A curve. A long one is smoothed, and the unsmoothed curve comes before it.
fn noisy(points: Vec<Point>) -> Vec<Series> {
    let series = |weight, points| Series { name: None, colour: 0, weight, points };
    if points.len() <= NOISY {
        return vec![series(Weight::Bold, points)];
    }
    let mean = running_mean(&points, points.len() / WINDOW);
    vec![series(Weight::Faint, points), series(Weight::Bold, mean)]
}

/// The curves that have a value. Models with one branch have no static curve.
fn known(series: Vec<Series>) -> Vec<Series> {
    series.into_iter().filter(|series| series.points.iter().any(|point| point.y.is_finite())).collect()
}

/// The starts of the stages: from the configuration, which includes stages without a line, otherwise from the lines.
fn marks(files: &RunFiles, log: &Log) -> Vec<Mark> {
    match &files.config {
        Ok(config) => planned(config),
        Err(_) => log.stages(),
    }
}

fn planned(config: &Config) -> Vec<Mark> {
    let stages = config.scaled().train.stages;
    let mut start = 0usize;
    let mut marks = Vec::new();
    for (stage, length) in stages.lengths() {
        if length > 0 {
            marks.push(Mark { x: start as f64, name: stage.name().to_owned() });
        }
        start = start.saturating_add(length);
    }
    marks
}

#[cfg(test)]
mod tests {
    use mvfusion_model::config::StageConfig;

    use super::*;

    #[test]
    fn stages_without_steps_have_no_mark() {
        let mut config = Config::default();
        config.train.stages = StageConfig::of([10, 0, 5]);
        let mark = |x, name: &str| Mark { x, name: name.to_owned() };
        assert_eq!(planned(&config), [mark(0.0, "geometry"), mark(10.0, "refinement")]);
    }
}
