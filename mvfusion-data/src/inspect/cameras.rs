//! Checks of the cameras: lenses and positions.

use glam::DVec3;

use super::problem::{Problem, Severity, Subject, count, few, median};
use super::rig::all_views;
use crate::scene::{Camera, Scene, View, by_camera, nearest_to_axes};

/// Bounds of plausible fields of view, degrees. A focal length for another image size exceeds them.
const NARROW: f64 = 5.0;
const WIDE: f64 = 150.0;
/// Distance of the cameras from the origin, in extents, above which single precision is coarser than a thousandth of an
/// extent.
const REMOTE: f64 = 1e4;
/// Extent below which cameras are nearly in one spot, in distances of the points.
const ONE_SPOT: f64 = 1e-3;
/// Extent below which single precision cannot tell cameras apart, in distances of the points or the origin.
const ROUNDING: f64 = 1e-7;
/// Length of the mean viewing direction below which cameras surround a scene or are in its middle.
const PARALLEL: f64 = 0.9;
/// Determinant of the mean normal equations above which the optical axes have a nearest point.
const MEETING: f64 = 1e-9;
/// Fraction of the cameras that must look away from the common region for a warning.
const MOSTLY: f64 = 0.9;

pub(super) fn problems(scene: &Scene) -> Vec<Problem> {
    let mut problems: Vec<Problem> = [fields_of_view(scene), principal_points(scene)].into_iter().flatten().collect();
    if by_camera(scene.train.iter()).len() >= 2 {
        problems.extend(places(scene));
        if scene.points.is_empty() {
            problems.extend(directions(scene));
        }
    }
    problems
}

/// Names of the views whose cameras fulfil a condition.
fn those(scene: &Scene, is: impl Fn(&Camera) -> bool) -> Vec<&str> {
    let name = |view: &'_ &View| is(&view.camera);
    all_views(scene).filter(name).map(|view| view.name.as_str()).collect()
}

fn fields_of_view(scene: &Scene) -> Option<Problem> {
    let widest = |camera: &Camera| camera.field_of_view().max_element().to_degrees();
    let odd = those(scene, |camera| !(NARROW..=WIDE).contains(&widest(camera)));
    let first = all_views(scene).find(|view| view.name == *odd.first().copied().unwrap_or_default())?;
    let what = format!(
        "the field of view of {} is implausible: {:.1} degrees in {}",
        count(odd.len(), "view"),
        widest(&first.camera),
        first.name
    );
    let remedy =
        "Usual are 20 to 120 degrees. Check that the focal length is in pixels, and for this size of the images.";
    Some(Problem::warning(Subject::Cameras, what, remedy))
}

fn principal_points(scene: &Scene) -> Option<Problem> {
    let outside = |camera: &Camera| {
        let inside = |at: f64, side: usize| (0.0..=side as f64).contains(&at);
        !(inside(camera.cx, camera.width) && inside(camera.cy, camera.height))
    };
    let odd = those(scene, outside);
    (!odd.is_empty()).then(|| {
        let what =
            format!("the principal point of {} lies outside the image ({})", count(odd.len(), "view"), few(&odd));
        let remedy = "Check cx and cy: they are in pixels from the upper left corner, for this size of the images.";
        Problem::warning(Subject::Cameras, what, remedy)
    })
}

/// Cameras in one spot, or far from the origin.
fn places(scene: &Scene) -> Option<Problem> {
    let (extent, centre) = (scene.extent(), scene.training_centre());
    let distances = scene.points.positions.iter().map(|point| point.as_dvec3().distance(centre)).collect();
    let distance = median(distances).unwrap_or(0.0);
    if extent <= ONE_SPOT * distance || extent <= ROUNDING * centre.length() {
        let what =
            format!("all training cameras stand in one spot (extent {extent:.2e}): depths cannot be told from it");
        let remedy = "Train on images from several places. If these are, the translations of the poses are lost.";
        let problem = Problem::warning(Subject::Cameras, what, remedy);
        // Losses and learning rates scale with the extent (METHOD §3).
        let is_nothing = extent <= ROUNDING * distance.max(centre.length());
        return Some(if is_nothing { Problem { severity: Severity::Error, ..problem } } else { problem });
    }
    (centre.length() > REMOTE * extent).then(|| {
        let what = format!(
            "the cameras stand {:.0} extents away from the origin: single precision is too coarse there",
            centre.length() / extent
        );
        Problem::warning(Subject::Cameras, what, "Move cameras and points so that the origin is amid them.")
    })
}

/// Without points, only the directions can be checked: cameras around a scene should look towards it.
fn directions(scene: &Scene) -> Option<Problem> {
    let cameras: Vec<&Camera> = scene.train.iter().map(|view| &view.camera).collect();
    let mean = cameras.iter().map(|camera| camera.forward()).sum::<DVec3>() / cameras.len() as f64;
    if mean.length() > PARALLEL {
        return None;
    }
    let meeting = nearest_to_axes(&cameras, MEETING)?;
    let away = cameras.iter().filter(|camera| camera.to_camera(meeting).z < 0.0).count();
    (away as f64 > MOSTLY * cameras.len() as f64).then(|| {
        let what = format!("{away} of {} training cameras look away from where their axes meet", cameras.len());
        let remedy = "Right for a capture from within, such as a panorama. Otherwise the axes of the poses are those of \
                      another convention (OpenGL: y up, z backward; OpenCV: y down, z forward).";
        Problem::warning(Subject::Poses, what, remedy)
    })
}
