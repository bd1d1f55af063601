//! Looks a scene over before any time is spent on it: what was found, what is wrong with it, and what to do.
//!
//! Each kind of problem has a file here. None of them stops at the first problem, and none changes the scene.

mod cameras;
mod mistakes;
mod order;
mod pictures;
mod points;
mod poses;
mod problem;
mod refusal;
mod rig;
mod sheet;
mod sight;
mod size;
mod split;
mod summary;
mod times;

use std::collections::BTreeMap;
use std::path::Path;

use serde::Serialize;

pub use problem::{Problem, Severity, Subject};
pub(crate) use rig::by_camera;
pub use sheet::{ContactSheet, points_over_photos};
pub use summary::Summary;

use crate::reader::{Format, open, recognise};
use crate::{DataError, ReadOptions, Scene, View, dnerf, masks};
use pictures::Looked;
use sight::{Cloud, Witness};

/// What was found in a scene's folder.
#[derive(Clone, Debug, Serialize)]
pub struct Inspection {
    /// The format, if one was recognised.
    pub format: Option<Format>,
    /// What the scene holds; absent if it could not be read.
    pub summary: Option<Summary>,
    /// What is wrong, the worst first.
    pub problems: Vec<Problem>,
}

impl Inspection {
    /// Whether nothing stands in the way of training.
    pub fn can_train(&self) -> bool {
        self.problems.iter().all(|problem| problem.severity != Severity::Error)
    }

    /// Attaches the masks of what moves that lie in `folder`, as training does, and adds what is wrong with them. Those of the
    /// held-out views, which are scored with them, are decoded.
    pub fn attach_masks(&mut self, scene: &mut Scene, folder: &Path) {
        let decoded = |view: &View| view.truth.dynamic_mask.as_ref().map_or(Ok(()), |mask| mask.mask().map(drop));
        let attached = masks::attach_masks(scene, folder);
        if let Err(error) = attached.and_then(|_| scene.test.iter().try_for_each(decoded)) {
            self.problems.insert(0, refusal::problem(&error));
        }
    }
}

/// How closely the pictures are looked at.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Pictures {
    /// Only their headers, which the reader needs anyway.
    Headers,
    /// One of each camera, of at most 24 cameras: a matter of seconds. The points' colours are compared with these, which
    /// finds wrong poses that no other test finds.
    #[default]
    Sampled,
    /// Every picture and mask is decoded, which takes as long as the first round of training does. Finds broken, empty and
    /// repeated pictures.
    Decoded,
}

/// Where a scene came from, as far as that helps to judge it.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Origin {
    /// Its format; absent for one that was not read from a folder.
    pub format: Option<Format>,
    /// The factor by which its pictures were made smaller. Default 1.
    pub downscale: f64,
    /// How its points came to be.
    pub points: PointsOrigin,
}

/// How a scene's points came to be.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum PointsOrigin {
    /// Measured; colours are those of the photos. The default.
    #[default]
    Measured,
    /// Strewn at random by the reader; colours say nothing.
    Strewn,
}

impl Default for Origin {
    fn default() -> Self {
        Self { format: None, downscale: 1.0, points: PointsOrigin::default() }
    }
}

/// Reads the scene in `folder` and looks it over. The scene comes back where it could be read, to be trained on or drawn.
///
/// Whatever is wrong, an error of the reader included, stands in [`Inspection::problems`].
pub fn inspect(folder: &Path, options: &ReadOptions, pictures: Pictures) -> (Inspection, Option<Scene>) {
    let refused = |format, error: &DataError| {
        let problems = vec![refusal::problem(error)];
        (Inspection { format, summary: None, problems }, None)
    };
    let format = match recognise(folder, options.format) {
        Ok(format) => format,
        Err(error) => return refused(None, &error),
    };
    let points = match format {
        Format::DNerf if !dnerf::has_points(folder) => PointsOrigin::Strewn,
        _ => PointsOrigin::Measured,
    };
    let origin = Origin { format: Some(format), downscale: options.downscale, points };
    match open(folder, &ReadOptions { format: Some(format), ..options.clone() }) {
        Ok(scene) => (inspect_scene(&scene, &origin, pictures), Some(scene)),
        Err(error) => refused(Some(format), &error),
    }
}

/// Looks over a scene that is read already.
pub fn inspect_scene(scene: &Scene, origin: &Origin, pictures: Pictures) -> Inspection {
    let numbers = rig::witnesses(scene);
    let looks: BTreeMap<usize, Looked<'_>> = pictures::look(scene, pictures, &numbers);
    let views: Vec<&View> = rig::all_views(scene).collect();
    let witness = |&number: &usize| {
        let picture = looks.get(&number).and_then(|looked| looked.look.as_ref().ok()?.thumbnail.as_ref());
        Witness { camera: &views[number].camera, name: &views[number].name, picture }
    };
    let witnesses: Vec<Witness<'_>> = numbers.iter().map(witness).collect();
    let cloud = Cloud::of(&scene.points, origin.points);
    let fit = sight::fit(&cloud, &witnesses, &sight::Warp::NONE);

    let mut problems = pictures::problems(scene, &looks);
    problems.extend(split::problems(scene));
    problems.extend(cameras::problems(scene));
    problems.extend(points::problems(scene, origin, &cloud, &witnesses));
    problems.extend(poses::problems(scene, &cloud, &witnesses, fit, origin.format));
    problems.extend(times::problems(scene));
    problems.extend(size::problems(scene, origin));
    problems.sort_by_key(|problem| problem.severity);
    Inspection { format: origin.format, summary: Some(Summary::of(scene, looks.len(), fit)), problems }
}

#[cfg(test)]
mod tests;
