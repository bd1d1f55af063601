//! Checks whether the poses follow their format's convention, by the points or by the directions of the cameras.

use super::mistakes::Mistake;
use super::problem::{Problem, Subject, percent};
use super::sight::{Cloud, Fit, Witness};
use super::{mistakes, order, sight};
use crate::readers::{Format, reader_of};
use crate::scene::Scene;

/// Fraction of the points that a camera normally sees. Sound scenes in our tests have 36 % to 96 %.
const SEEN: f64 = 0.10;
/// Below this fraction something is wrong even if no common mistake explains it.
const HARDLY_SEEN: f64 = 0.03;
/// Fraction of the points that undoing a mistake must bring into view, if there are no colours to compare.
const WELL_SEEN: f64 = 0.3;
/// Factor by which undoing it must increase that fraction.
const MORE: f64 = 3.0;
/// Correlation of colours below which poses and photos do not seem to belong together. Sound scenes in our tests have
/// 0.5 to 0.9.
const DISAGREEMENT: f64 = 0.15;
/// Correlation that undoing a mistake must reach, and its minimum gain.
const AGREEMENT: f64 = 0.35;
const GAIN: f64 = 0.2;
/// If several mistakes explain nearly as much as the best, the most likely one is named.
const NEARLY: f64 = 0.03;
/// Minimum number of photos to report disagreement.
const ENOUGH_PHOTOS: usize = 2;

pub(super) fn problems(
    scene: &Scene,
    cloud: &Cloud,
    witnesses: &[Witness<'_>],
    fit: Option<Fit>,
    format: Option<Format>,
) -> Vec<Problem> {
    let Some(fit) = fit else { return Vec::new() };
    if let Some((mistake, undone)) = explanation(cloud, witnesses, fit) {
        return vec![mistaken(&mistake, fit, undone, format)];
    }
    if let Some(problem) = order::problem(scene, cloud, witnesses) {
        return vec![problem];
    }
    unexplained(witnesses, fit, format).into_iter().collect()
}

/// The common mistake that explains a poor fit, and the fit after undoing it.
fn explanation(cloud: &Cloud, witnesses: &[Witness<'_>], own: Fit) -> Option<(Mistake, Fit)> {
    let tried: Vec<(Mistake, Fit)> = mistakes::all()
        .into_iter()
        .filter_map(|mistake| sight::fit(cloud, witnesses, &mistake.warp).map(|fit| (mistake, fit)))
        .collect();
    let by_colours = |_: &Mistake, fit: &Fit| match fit.agreement {
        Some(agreement) if fit.seen >= SEEN => agreement,
        _ => f64::NEG_INFINITY,
    };
    // On a long walk a camera sees few of the points, but sees them in the right colours.
    let own_agreement = own.agreement.unwrap_or(f64::NEG_INFINITY);
    let needed = AGREEMENT.max(own_agreement + GAIN);
    let found = likeliest(&tried, by_colours, needed).or_else(|| {
        // Colours that disagree rule a mistake out. Cameras that are moved far away see everything.
        let by_share = |mistake: &Mistake, fit: &Fit| {
            let is_none = mistake.warp.scale > 1.0 || fit.agreement.is_some_and(|a| a < DISAGREEMENT);
            if is_none { 0.0 } else { fit.seen }
        };
        let needed = WELL_SEEN.max(MORE * own.seen);
        (own.seen < SEEN && own_agreement < AGREEMENT).then(|| likeliest(&tried, by_share, needed)).flatten()
    });
    tried.into_iter().nth(found?)
}

/// The first mistake that scores nearly as well as the best, if the best reaches `needed`. Mistakes of the unit come
/// last.
fn likeliest(tried: &[(Mistake, Fit)], score: impl Fn(&Mistake, &Fit) -> f64, needed: f64) -> Option<usize> {
    let among = |units: bool| {
        let tried = tried.iter().enumerate().filter(move |(_, (mistake, _))| (mistake.warp.scale != 1.0) == units);
        let scores: Vec<(usize, f64)> = tried.map(|(index, (mistake, fit))| (index, score(mistake, fit))).collect();
        let best = scores.iter().map(|(_, score)| *score).fold(f64::NEG_INFINITY, f64::max);
        let first = scores.into_iter().find(|(_, score)| *score >= best - NEARLY)?;
        (best >= needed).then_some(first.0)
    };
    among(false).or_else(|| among(true))
}

fn mistaken(mistake: &Mistake, own: Fit, undone: Fit, format: Option<Format>) -> Problem {
    let gain = match (own.agreement, undone.agreement) {
        (own_colours, Some(colours)) if own.seen >= SEEN => format!(
            "the points' colours would agree with the photos (correlation {colours:.2}) where they now {}",
            own_colours.map_or("do not".into(), |own| format!("hardly do ({own:.2})"))
        ),
        _ => format!(
            "a camera would see {} of the points instead of {} (the median over the cameras)",
            percent(undone.seen),
            percent(own.seen)
        ),
    };
    let what = format!("the poses seem to follow another convention: {}, {gain}", mistake.undone);
    let remedy = format!("It looks as if {}. {}", mistake.cause, convention(format));
    Problem::warning(Subject::Poses, what, remedy)
}

/// A poor fit without a known reason.
fn unexplained(witnesses: &[Witness<'_>], fit: Fit, format: Option<Format>) -> Option<Problem> {
    let share = percent(fit.seen);
    if fit.seen < HARDLY_SEEN && fit.agreement.is_none_or(|agreement| agreement < AGREEMENT) {
        let what = format!(
            "a camera sees {share} of the points (the median over the cameras): poses and points do not seem to belong \
             together"
        );
        let remedy = format!("Check that both are of one scene and in one unit. {}", convention(format));
        return Some(Problem::warning(Subject::Poses, what, remedy));
    }
    let photos = witnesses.iter().filter(|witness| witness.picture.is_some()).count();
    if let Some(agreement) = fit.agreement.filter(|&agreement| agreement < DISAGREEMENT && photos >= ENOUGH_PHOTOS) {
        let what = format!(
            "the points' colours do not agree with the photos where they fall (correlation {agreement:.2}): poses, \
             points and images do not seem to belong together"
        );
        let remedy = format!(
            "Look at the points drawn over the photos. Check that the images are in the order of the poses, and that \
             the points are of this scene and have the colours of its photos. {}",
            convention(format)
        );
        return Some(Problem::warning(Subject::Poses, what, remedy));
    }
    (fit.seen < SEEN).then(|| {
        let what = format!("a camera sees {share} of the points (the median over the cameras)");
        Problem::note(Subject::Poses, what, "Usual for a long walk; otherwise check poses and points.")
    })
}

/// The convention of a format's poses.
fn convention(format: Option<Format>) -> &'static str {
    const OURS: &str = "A camera's rotation leads from the world to the camera: x right, y down, z forward.";
    format.and_then(reader_of).map_or(OURS, |reader| reader.hints.poses)
}
