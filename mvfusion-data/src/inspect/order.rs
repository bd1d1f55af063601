//! Whether each picture belongs to its pose, or to that of another.

use super::problem::{Problem, Subject};
use super::rig::stands_still;
use super::sight::{Cloud, Witness, agreement};
use crate::Scene;

/// What another place must reach to fit much better than the own one.
struct Much {
    /// The correlation.
    agreement: f64,
    /// How much larger it must be than that of picture and pose as they are.
    gain: f64,
}

/// For the picture of another camera.
const PICTURE: Much = Much { agreement: 0.35, gain: 0.25 };
/// For the pose of another camera, where the picture only has to belong rather than to be the best of all.
const POSE: Much = Much { agreement: 0.25, gain: 0.15 };
/// Where each camera has one photo, so many must be out of place: one may be by chance.
const FEWEST_PHOTOS: usize = 2;

/// Cameras to whose pose another's picture fits much better than their own, and whose own picture fits another pose better. Where somebody stands in front of a camera, the first holds as well, but the second does not.
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
        "for {} of {} cameras looked at, the picture of another fits the pose much better than their own: for {} that of {}",
        strangers.len(),
        witnesses.len(),
        witnesses[pose].name,
        witnesses[picture].name
    );
    let remedy = "Check the order: rows of poses_bounds.npy follow the sorted names of the cameras, and other formats name \
                  the picture of each pose.";
    Some(Problem::warning(Subject::Poses, what, remedy))
}

/// How well each picture fits each pose.
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

    /// The other place that fits much better than the own one, if there is one.
    fn better(&self, place: usize, much: &Much, fit: impl Fn(usize) -> Option<f64>) -> Option<usize> {
        let own = self.at(place, place)?;
        let others = (0..self.count).filter_map(|other| Some((other, fit(other)?)));
        let (best, most) = others.max_by(|a, b| a.1.total_cmp(&b.1))?;
        (most >= much.agreement.max(own + much.gain)).then_some(best)
    }
}
