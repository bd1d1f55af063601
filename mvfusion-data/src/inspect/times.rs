//! Checks of the times of the views.

use super::problem::{Problem, Subject, count, few, median};
use super::rig::all_views;
use crate::scene::{Capture, Scene, View, by_camera};

/// Gaps between frames longer than this many usual gaps are reported.
const LONG_GAP: f64 = 2.5;
/// Largest relative deviation of a usual gap.
const REGULAR: f64 = 0.1;
/// Fraction of usual gaps above which a video counts as regularly sampled.
const MOSTLY: f64 = 0.8;
/// Minimum number of gaps to define a usual gap.
const ENOUGH_GAPS: usize = 6;
/// Largest distance, in usual gaps, of a held-out view from the nearest training moment.
const FAR: f64 = 2.5;

pub(super) fn problems(scene: &Scene) -> Vec<Problem> {
    let outside: Vec<&View> = all_views(scene).filter(|view| !(0.0..=1.0).contains(&view.time)).collect();
    if let Some(first) = outside.first() {
        let what = format!("times outside 0 to 1 in {} ({}: {})", count(outside.len(), "view"), first.name, first.time);
        return vec![Problem::error(Subject::Times, what, "Divide the times by the last one.")];
    }
    let moments = scene.training_times();
    if moments.len() < 2 {
        return standstill(scene).into_iter().collect();
    }
    let gaps: Vec<f64> = moments.windows(2).map(|pair| pair[1] - pair[0]).collect();
    let Some(usual) = median(gaps.clone()) else { return Vec::new() };
    // The numbers of photos may have gaps of any length, and held-out photos are evaluated without moving objects.
    match scene.capture {
        Capture::Video => missing(&moments, &gaps, usual).into_iter().chain(far(scene, &moments, usual)).collect(),
        Capture::Photos => Vec::new(),
    }
}

/// All training views show one moment.
fn standstill(scene: &Scene) -> Option<Problem> {
    let views = scene.train.len();
    if views < 2 {
        return None;
    }
    let filmed = by_camera(scene.train.iter()).iter().any(|views| views.len() > 1);
    Some(match (scene.capture, filmed) {
        (Capture::Video, false) => Problem::note(
            Subject::Times,
            format!("the {views} training views show one moment: nothing can be learned of what moves"),
            "Fine for something still. Otherwise add the other frames.",
        ),
        (Capture::Video, true) => Problem::warning(
            Subject::Times,
            format!("all {views} training views have one time, though cameras have several views"),
            "Give every frame its time.",
        ),
        (Capture::Photos, _) => Problem::warning(
            Subject::Times,
            format!("all {views} photos to train on have one time: what passes by cannot be told apart"),
            "Number the photos in the order in which they were taken.",
        ),
    })
}

/// Long gaps in an otherwise regular video.
fn missing(moments: &[f64], gaps: &[f64], usual: f64) -> Option<Problem> {
    let regular = gaps.iter().filter(|gap| (*gap / usual - 1.0).abs() < REGULAR).count();
    if gaps.len() < ENOUGH_GAPS || (regular as f64) < MOSTLY * gaps.len() as f64 {
        return None;
    }
    let long: Vec<usize> = (0..gaps.len()).filter(|&i| gaps[i] > LONG_GAP * usual).collect();
    let &first = long.first()?;
    let lost: f64 = long.iter().map(|&i| (gaps[i] / usual).round() - 1.0).sum();
    let what = format!(
        "about {} missing in {}, the first between the times {:.4} and {:.4}",
        count(lost as usize, "frame"),
        count(long.len(), "place"),
        moments[first],
        moments[first + 1]
    );
    Some(Problem::warning(Subject::Times, what, "Extract the frames again, or train on the part without gaps."))
}

/// Held-out views that are far in time from every training view.
fn far(scene: &Scene, moments: &[f64], usual: f64) -> Option<Problem> {
    let distance = |time: f64| {
        let after = moments.partition_point(|&moment| moment < time);
        let neighbours = [after.checked_sub(1), Some(after)].into_iter().flatten();
        neighbours.filter_map(|i| Some((moments.get(i)? - time).abs())).fold(f64::INFINITY, f64::min)
    };
    let far = scene.test.iter().filter(|view| distance(view.time) > FAR * usual);
    let names: Vec<&str> = far.map(|view| view.name.as_str()).collect();
    (!names.is_empty()).then(|| {
        let what = format!(
            "{} of {} held-out views are far from every moment that is trained on ({})",
            names.len(),
            scene.test.len(),
            few(&names)
        );
        Problem::warning(Subject::Times, what, "Hold out views of moments between others, or of another camera.")
    })
}
