//! The distinction of movers, which change their position, from objects that only sway.
//!
//! An object that sways by less than a pixel is as easy to render as a still one. A metric over all moving objects
//! therefore says little about visible motion. For this reason, the ground truth has a second mask with only the
//! movers.

use std::collections::{BTreeMap, BTreeSet};

use super::choreography::MovingObject;
use super::solid::Pose;

/// Maximum distance in metres of an object's points from their first position, unless the object is a mover. It is
/// three pixels of the default images at the middle of the stage. The lamp sways by 2.6 centimetres, the block flies
/// for metres.
const LEAST_TRAVEL: f64 = 0.1;

/// The names of the movers of a sequence.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub(super) struct Movers(BTreeSet<String>);

impl Movers {
    /// The movers among the objects at each moment of a sequence. An object is a mover if it moves more than 0.1 m away
    /// from its first position. An object that is not always present is also a mover.
    pub(super) fn of(moments: impl Iterator<Item = Vec<MovingObject>>) -> Self {
        let mut seen: BTreeMap<String, Track> = BTreeMap::new();
        let mut count = 0;
        for object in moments.inspect(|_| count += 1).flatten() {
            let track = seen.entry(object.name.clone()).or_insert_with(|| Track::first(&object));
            track.moments += 1;
            track.travel = track.travel.max(object.pose.travel(&track.first, object.reach));
        }
        let is_mover = |track: &Track| track.moments < count || track.travel > LEAST_TRAVEL;
        Self(seen.into_iter().filter(|(_, track)| is_mover(track)).map(|(name, _)| name).collect())
    }

    /// Marks the object's solids as parts of a mover, if it is one.
    pub(super) fn marked(&self, mut object: MovingObject) -> MovingObject {
        let is_mover = self.0.contains(&object.name);
        object.solids.iter_mut().for_each(|solid| solid.is_mover = is_mover);
        object
    }
}

/// The motion of an object in a sequence.
struct Track {
    first: Pose,
    /// Number of moments at which it is present.
    moments: usize,
    /// Upper bound of the distance of its points from their first position, in metres.
    travel: f64,
}

impl Track {
    fn first(object: &MovingObject) -> Self {
        Self { first: object.pose, moments: 0, travel: 0.0 }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::builtin::choreography::in_video;

    fn names(moments: &[Vec<MovingObject>]) -> Vec<String> {
        Movers::of(moments.iter().cloned()).0.into_iter().collect()
    }

    #[test]
    fn what_comes_or_goes_or_turns_far_is_a_mover_and_what_sways_is_none() {
        let moments: Vec<_> = (0..24).map(|frame| in_video(f64::from(frame) / 24.0)).collect();
        assert_eq!(names(&moments), ["block", "visitor"]);
        // The lamp alone, which was taken away for the last moment.
        let lamp: Vec<_> = moments.iter().map(|all| vec![all[1].clone()]).collect();
        assert_eq!((lamp[0][0].name.as_str(), names(&lamp)), ("lamp", vec![]));
        assert_eq!(names(&[&lamp[..], &[vec![]]].concat()), ["lamp"]);
        // The block spins where it is: its corners go further than a tenth of a metre.
        let mut spinning: Vec<_> = moments.iter().map(|all| vec![all[0].clone()]).collect();
        let place = spinning[0][0].pose.position;
        spinning.iter_mut().for_each(|objects| objects[0].pose.position = place);
        assert_eq!(names(&spinning), ["block"]);
    }

    #[test]
    fn one_moment_shows_no_movers() {
        assert_eq!(names(&[in_video(0.5)]), Vec::<String>::new());
    }
}
