//! Pictures that are larger than those on which anybody trains.

use super::Origin;
use super::problem::{Problem, Subject};
use crate::{Format, Scene};

/// Widest pictures that 3DGS trains on without being told to.
const WIDE: f64 = 1600.0;
/// Width at which Neu3D is trained and scored.
const NEU3D_WIDTH: f64 = 1352.0;
/// Scenes of NeRF On-the-go that were published half as large as the others.
const SMALL_ON_THE_GO: [&str; 2] = ["patio", "arcdetriomphe"];

pub(super) fn problems(scene: &Scene, origin: &Origin) -> Vec<Problem> {
    let Some(view) = scene.train.first() else { return Vec::new() };
    let (width, height) = view.image.size();
    if f64::from(width) <= WIDE {
        return Vec::new();
    }
    // The factor counts from the files' size.
    let on_disk = f64::from(width) * origin.downscale;
    let (factor, whose) = usual_factor(scene, origin.format, on_disk);
    let what = format!("the pictures are {width}x{height}: training is slow, and {whose}");
    vec![Problem::note(Subject::Size, what, format!("Add `--set scene.downscale={factor}`."))]
}

/// By which factor pictures of a width are usually made smaller, and who says so.
fn usual_factor(scene: &Scene, format: Option<Format>, width: f64) -> (f64, &'static str) {
    let named = |word: &str| scene.train.iter().all(|view| view.name.contains(word));
    match format {
        Some(Format::Neu3d) => ((width / NEU3D_WIDTH).round().max(2.0), "papers train Neu3D at 1352x1014"),
        Some(Format::OnTheGo) | Some(Format::Colmap) if named("clutter") || format == Some(Format::OnTheGo) => {
            let small = SMALL_ON_THE_GO.contains(&scene.name.trim_end_matches("_new"));
            (
                if small { 4.0 } else { 8.0 },
                "papers train photos with passers-by at an 8th of their size (patio and arcdetriomphe: a 4th)",
            )
        }
        _ => ((width / WIDE).ceil(), "3DGS, too, trains on at most 1600 pixels across"),
    }
}
