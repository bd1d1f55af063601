//! Checks of the initial points: their number and their positions.

use glam::{DVec3, Vec3};

use super::origin::{Origin, PointsOrigin};
use super::problem::{Problem, Subject, median, percent};
use super::sight::{Cloud, Witness, pixel};
use crate::scene::{Capture, Scene};

/// Fewer points than this are useless.
const FEW: usize = 20;
/// Fraction of the coordinates outside the bulk, at either end.
const TAIL: f64 = 0.01;
/// Largest ratio of the box of all points to the box of the bulk.
const STRAY: f64 = 10.0;
/// Near plane of the rasteriser, in world units (METHOD: as in 3DGS).
const NEAR_PLANE: f64 = 0.2;
/// Fraction of the visible points that may be nearer.
const TOO_NEAR: f64 = 0.05;

pub(super) fn problems(scene: &Scene, origin: &Origin, cloud: &Cloud, witnesses: &[Witness<'_>]) -> Vec<Problem> {
    const REMEDY: &str = "Add a point cloud: COLMAP's points3D, or a PLY file under a name that the format knows.";
    if origin.points == PointsOrigin::Random {
        let what = format!("no point cloud: {} random points stand in for it", scene.points.len());
        return vec![Problem::note(Subject::Points, what, "Usual for synthetic scenes. Otherwise add a fused.ply.")];
    }
    match scene.points.len() {
        0 => {
            vec![Problem::warning(Subject::Points, "there are no points: training starts from random points", REMEDY)]
        }
        few if few < FEW => {
            let what = format!("there are only {few} points to start from");
            vec![Problem::warning(Subject::Points, what, REMEDY)]
        }
        _ => [strays(scene), too_near(cloud, witnesses)].into_iter().flatten().collect(),
    }
}

/// A few points so far away that they alone determine the size of the bounding box.
fn strays(scene: &Scene) -> Option<Problem> {
    let (low, high) = bulk(&scene.points.positions);
    let (min, max) = scene.points.bounds()?;
    let times = f64::from((max - min).length() / (high - low).length());
    // A flat cloud has no bulk to compare with.
    if !times.is_finite() || times < STRAY {
        return None;
    }
    let margin = (high - low).length();
    let far = |point: &&Vec3| (**point - point.clamp(low, high)).length() > margin;
    let count = scene.points.positions.iter().filter(far).count();
    let what = format!(
        "{count} of {} points lie far from all others: the box of all points is {times:.0} times as large as that of the \
         middle {}",
        scene.points.len(),
        percent(1.0 - 2.0 * TAIL)
    );
    let remedy =
        "Remove the outliers, for example with CloudCompare's SOR filter: the grid of what moves spans the box.";
    Some(match scene.capture {
        Capture::Video => Problem::warning(Subject::Points, what, remedy),
        Capture::Photos => Problem::note(Subject::Points, what, remedy),
    })
}

/// The box around the middle of the coordinates.
fn bulk(positions: &[Vec3]) -> (Vec3, Vec3) {
    let (mut low, mut high) = (Vec3::ZERO, Vec3::ZERO);
    for axis in 0..3 {
        let mut along: Vec<f32> = positions.iter().map(|point| point[axis]).collect();
        along.sort_by(f32::total_cmp);
        let tail = (TAIL * along.len() as f64) as usize;
        (low[axis], high[axis]) = (along[tail], along[along.len() - 1 - tail]);
    }
    (low, high)
}

/// A scene whose unit is so large that the near plane clips it.
fn too_near(cloud: &Cloud, witnesses: &[Witness<'_>]) -> Option<Problem> {
    let depth =
        |witness: &Witness<'_>, point: DVec3| pixel(witness.camera, point).map(|_| witness.camera.to_camera(point).z);
    let depths: Vec<f64> = witnesses
        .iter()
        .flat_map(|witness| cloud.positions().iter().filter_map(move |&point| depth(witness, point)))
        .collect();
    let near = depths.iter().filter(|&&depth| depth < NEAR_PLANE).count() as f64 / depths.len().max(1) as f64;
    if near <= TOO_NEAR {
        return None;
    }
    let what = format!(
        "{} of what the cameras see lies nearer than {NEAR_PLANE} world units, where nothing is drawn (the median depth is \
         {:.3})",
        percent(near),
        median(depths).unwrap_or(0.0)
    );
    Some(Problem::warning(
        Subject::Points,
        what,
        "Make the scene larger: multiply all camera centres and points by 10 or 100.",
    ))
}
