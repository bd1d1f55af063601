//! Checks a scene before training: its contents, its problems, and their remedies.
//!
//! Each kind of problem has its own file. All problems are reported, and the scene is not changed.

mod cameras;
mod masks;
mod mistakes;
mod order;
mod origin;
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
#[cfg(test)]
mod tests;
mod times;

use std::collections::BTreeMap;
use std::path::Path;

use serde::Serialize;

pub use origin::{Origin, PointsOrigin};
pub use pictures::Pictures;
pub use problem::{Problem, Severity, Subject};
pub use sheet::{ContactSheet, points_over_photos};
pub use summary::Summary;

use crate::error::DataError;
use crate::readers::{self, Format, ReadOptions, open, reader_for};
use crate::scene::{Scene, View};
use pictures::Looked;
use sight::{Cloud, Witness};

/// The result of inspecting a scene's folder.
#[derive(Clone, Debug, Serialize)]
pub struct Inspection {
    /// The format, if one was recognised.
    pub format: Option<Format>,
    /// The scene's summary; absent if it could not be read.
    pub summary: Option<Summary>,
    /// The problems, the worst first.
    pub problems: Vec<Problem>,
}

impl Inspection {
    /// Whether training can start.
    pub fn can_train(&self) -> bool {
        self.problems.iter().all(|problem| problem.severity != Severity::Error)
    }

    /// Attaches the motion masks in `folder`, as training does, and adds the problems with them. Masks of held-out
    /// views are decoded, because evaluation uses them.
    pub fn attach_masks(&mut self, scene: &mut Scene, folder: &Path) {
        let decoded = |view: &View| view.truth.dynamic_mask.as_ref().map_or(Ok(()), |mask| mask.mask().map(drop));
        let attached = readers::attach_masks(scene, folder);
        if let Err(error) = attached.and_then(|_| scene.test.iter().try_for_each(decoded)) {
            self.problems.insert(0, refusal::problem(&error));
        }
    }
}

/// Reads and inspects the scene in `folder`. The scene is returned if it could be read.
///
/// All problems, including an error of the reader, are in [`Inspection::problems`].
pub fn inspect(folder: &Path, options: &ReadOptions, pictures: Pictures) -> (Inspection, Option<Scene>) {
    let refused = |format, error: &DataError| {
        let problems = vec![refusal::problem(error)];
        (Inspection { format, summary: None, problems }, None)
    };
    let reader = match reader_for(folder, options.format) {
        Ok(reader) => reader,
        Err(error) => return refused(None, &error),
    };
    let points = match (reader.hints.has_random_points)(folder) {
        true => PointsOrigin::Random,
        false => PointsOrigin::Measured,
    };
    let format = Some(reader.format);
    let origin = Origin { format, downscale: options.downscale, points };
    match open(folder, &ReadOptions { format, ..options.clone() }) {
        Ok(scene) => {
            let mut inspection = inspect_scene(&scene, &origin, pictures);
            inspection.problems.extend(size::odd_shape(reader, folder, &scene));
            inspection.problems.extend(masks::ignored(reader, folder, &scene));
            inspection.problems.sort_by_key(|problem| problem.severity);
            (inspection, Some(scene))
        }
        Err(error) => refused(format, &error),
    }
}

/// What keeps a scene from being trained at all: too few training views, or none that shows depths.
pub fn obstacle(scene: &Scene) -> Option<Problem> {
    split::obstacle(scene)
}

/// Inspects a scene that was read already.
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
