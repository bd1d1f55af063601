//! Checks whether each image belongs to its own pose or to another camera's pose.

use super::problem::{Problem, Subject};
use super::rig::stands_still;
use super::sight::{Cloud, Witness, agreement};
use crate::scene::Scene;

/// Thresholds for another match to count as much better.
struct Much {
    /// The correlation.
    agreement: f64,
    /// Its minimum gain over the current match.
    gain: f64,
}

/// For the image of another camera.
const PICTURE: Much = Much { agreement: 0.35, gain: 0.25 };
/// For the pose of another camera. Here the image only has to fit, and need not be the best of all.
const POSE: Much = Much { agreement: 0.25, gain: 0.15 };
/// With one photo per camera, at least this many must be misplaced. A single one may be chance.
const FEWEST_PHOTOS: usize = 2;

/// Finds cameras whose pose fits another image much better than its own, while their own image fits another pose
/// better. If a person is in front of a camera, the first condition holds, too, but the second does not.
pub(super) fn problem(scene: &Scene, cloud: &Cloud, witnesses: &[Witness<'_>]) -> Option<Problem> {
    let fits = Fits::of(cloud, witnesses);
    let misplaced = |place: usize| {
        let picture = fits.better(place, &PICTURE, |other| fits.at(place, other))?;
        fits.better(place, &POSE, |other| fits.at(other, place))?;
        Some((place, picture))
    };
    let strangers: Vec<(usize, usize)> = (0..witnesses.len()).filter_map(misplaced).collect();
    let &(pose, picture) = strangers.first()?;
    if !stands_still(scene) && strangers.len() < FEWEST_PHOTOS {
        return None;
    }
    let what = format!(
        "for {} of {} cameras looked at, the image of another fits the pose much better than their own: for {} that of \
         {}",
        strangers.len(),
        witnesses.len(),
        witnesses[pose].name,
        witnesses[picture].name
    );
    let remedy = "Check the order: rows of poses_bounds.npy follow the sorted names of the cameras, and other formats name \
                  the image of each pose.";
    Some(Problem::warning(Subject::Poses, what, remedy))
}

/// The correlation of each image with each pose.
struct Fits {
    count: usize,
    agreements: Vec<Option<f64>>,
}

impl Fits {
    fn of(cloud: &Cloud, witnesses: &[Witness<'_>]) -> Self {
        let pair = |pose: &Witness<'_>, picture: &Witness<'_>| agreement(cloud, pose.camera, picture.picture?);
        let agreements = witnesses.iter().flat_map(|pose| witnesses.iter().map(move |picture| pair(pose, picture)));
        Self { count: witnesses.len(), agreements: agreements.collect() }
    }

    fn at(&self, pose: usize, picture: usize) -> Option<f64> {
        self.agreements[pose * self.count + picture]
    }

    /// The other match that fits much better than the current one, if there is one.
    fn better(&self, place: usize, much: &Much, fit: impl Fn(usize) -> Option<f64>) -> Option<usize> {
        let own = self.at(place, place)?;
        let others = (0..self.count).filter_map(|other| Some((other, fit(other)?)));
        let (best, most) = others.max_by(|a, b| a.1.total_cmp(&b.1))?;
        (most >= much.agreement.max(own + much.gain)).then_some(best)
    }
}
