//! Whether the poses follow the convention of their format: the points tell, or else the directions of the cameras.

use super::mistakes::{self, Mistake};
use super::order;
use super::problem::{Problem, Subject, percent};
use super::sight::{self, Cloud, Fit, Witness};
use crate::{Format, Scene};

/// Share of the points that a camera usually sees at the least; the sound scenes at hand show 36 % to 96 %.
const SEEN: f64 = 0.10;
/// Below this share something is wrong even where no usual mistake explains it.
const HARDLY_SEEN: f64 = 0.03;
/// Share that an undone mistake must bring into view, where there are no colours to tell.
const WELL_SEEN: f64 = 0.3;
/// By what factor it must bring more into view.
const MORE: f64 = 3.0;
/// Correlation of colours below which poses and photos do not seem to belong together; the sound scenes at hand reach
/// 0.5 to 0.9.
const DISAGREEMENT: f64 = 0.15;
/// Correlation that an undone mistake must reach, and what it must gain.
const AGREEMENT: f64 = 0.35;
const GAIN: f64 = 0.2;
/// Of mistakes that explain nearly as much as the best does, the likeliest is named.
const NEARLY: f64 = 0.03;
/// Fewest photos whose disagreement is told.
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

/// The usual mistake that explains a poor fit, and the fit once it is undone.
fn explanation(cloud: &Cloud, witnesses: &[Witness<'_>], own: Fit) -> Option<(Mistake, Fit)> {
    let tried: Vec<(Mistake, Fit)> = mistakes::all()
        .into_iter()
        .filter_map(|mistake| sight::fit(cloud, witnesses, &mistake.warp).map(|fit| (mistake, fit)))
        .collect();
    let by_colours = |_: &Mistake, fit: &Fit| match fit.agreement {
        Some(agreement) if fit.seen >= SEEN => agreement,
        _ => f64::NEG_INFINITY,
    };
    // On a long walk a camera sees few of the points, but these in the right colours.
    let own_agreement = own.agreement.unwrap_or(f64::NEG_INFINITY);
    let needed = AGREEMENT.max(own_agreement + GAIN);
    let found = likeliest(&tried, by_colours, needed).or_else(|| {
        // What colours speak against is not an explanation, and cameras that are moved far away see everything.
        let by_share = |mistake: &Mistake, fit: &Fit| {
            let is_none = mistake.warp.scale > 1.0 || fit.agreement.is_some_and(|a| a < DISAGREEMENT);
            if is_none { 0.0 } else { fit.seen }
        };
        let needed = WELL_SEEN.max(MORE * own.seen);
        (own.seen < SEEN && own_agreement < AGREEMENT).then(|| likeliest(&tried, by_share, needed)).flatten()
    });
    tried.into_iter().nth(found?)
}

/// The first of those that score nearly as well as the best, if that scores as much as is needed. Another unit comes last.
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
             points and pictures do not seem to belong together"
        );
        let remedy = format!(
            "Look at the points drawn over the photos. Check that the pictures are in the order of the poses, and that \
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

/// What a format's poses must be.
fn convention(format: Option<Format>) -> &'static str {
    match format {
        Some(Format::Colmap | Format::MultipleView) => {
            "COLMAP's poses lead from the world to the camera: quaternion w, x, y, z and translation, x right, y down, z \
             forward."
        }
        Some(Format::Neu3d) => {
            "Rows of poses_bounds.npy lead from the camera to the world, and their columns are the camera's down, right and \
             backward axes and its centre."
        }
        Some(Format::DNerf | Format::OnTheGo | Format::Nerfstudio) => {
            "A transform_matrix leads from the camera to the world, in OpenGL's axes: x right, y up, z backward."
        }
        Some(Format::HyperNerf) => {
            "An orientation leads from the world to the camera (x right, y down, z forward), a position is the camera's centre."
        }
        Some(Format::Panoptic) => "A w2c leads from the world to the camera: x right, y down, z forward.",
        None => "A camera's rotation leads from the world to the camera: x right, y down, z forward.",
    }
}
