//! The selection of each step's views.

use mvfusion_data::motion::{MovingPixels, loneliness};
use serde::{Deserialize, Serialize};

use super::TrainingView;
use crate::random::Stream;
use crate::timeline::Timeline;

/// Draws views without replacement; a new round starts when all were shown (METHOD §4.2).
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Sampler {
    remaining: Vec<usize>,
    /// Whether a round ended since this flag was last taken.
    pub round_ended: bool,
}

/// Mean number of visits of each view per round, at least one.
#[derive(Clone, Debug, PartialEq)]
pub struct Visits(Vec<f64>);

impl Sampler {
    /// The next `size` views.
    pub fn draw(&mut self, size: usize, visits: &Visits, stream: &mut Stream) -> Vec<usize> {
        let next = |_| {
            if self.remaining.is_empty() {
                self.remaining = visits.round(stream);
            }
            let view = self.remaining.swap_remove(stream.index(self.remaining.len()));
            self.round_ended |= self.remaining.is_empty();
            view
        };
        (0..size).map(next).collect()
    }

    /// Strikes views that were chosen elsewhere off this round, each once. A view that the round no longer has counts
    /// for nothing.
    pub fn strike(&mut self, views: &[usize], visits: &Visits, stream: &mut Stream) {
        for view in views {
            if self.remaining.is_empty() {
                self.remaining = visits.round(stream);
            }
            if let Some(place) = self.remaining.iter().position(|other| other == view) {
                self.remaining.swap_remove(place);
                self.round_ended |= self.remaining.is_empty();
            }
        }
    }

    /// The highest number of a view that this round will still show.
    pub(super) fn last(&self) -> Option<usize> {
        self.remaining.iter().max().copied()
    }

    /// The next `size` views, without drawing them.
    pub fn upcoming(&self, size: usize, visits: &Visits, stream: &Stream) -> Vec<usize> {
        self.clone().draw(size, visits, &mut stream.clone())
    }
}

impl Visits {
    /// Every view once.
    pub fn even(views: usize) -> Self {
        Self(vec![1.0; views])
    }

    /// Every view once, plus `lonely` times the [`loneliness`] of its moment.
    pub fn by_loneliness(photos: &[TrainingView], moving: &MovingPixels, timeline: &Timeline, lonely: f64) -> Self {
        let times = timeline.times();
        let moment = |photo: &TrainingView| times.partition_point(|&time| time < photo.time).min(times.len() - 1);
        let mut amounts = vec![0; times.len()];
        for (view, photo) in photos.iter().enumerate() {
            amounts[moment(photo)] += moving.map(view).map_or(0, |map| map.amount());
        }
        let loneliness = loneliness(&amounts);
        Self(photos.iter().map(|photo| 1.0 + lonely * loneliness[moment(photo)]).collect())
    }

    /// The views of a round, in order. The fraction of a visit is a probability.
    fn round(&self, stream: &mut Stream) -> Vec<usize> {
        let mut round = Vec::with_capacity(self.0.len());
        for (view, &visits) in self.0.iter().enumerate() {
            let chance = visits.fract();
            // Integers draw no random number, so that the order of even rounds does not depend on this.
            let more = chance > 0.0 && stream.unit() < chance;
            round.extend(std::iter::repeat_n(view, visits as usize + usize::from(more)));
        }
        round
    }
}

#[cfg(test)]
mod tests {
    use glam::{DMat3, DVec3};
    use mvfusion_data::Camera;
    use mvfusion_data::motion::{MotionMap, PixelMotion};

    use super::*;

    #[test]
    fn every_view_is_shown_once_a_round() {
        let mut sampler = Sampler::default();
        let mut stream = Stream::new(1, 0);
        let mut shown: Vec<usize> = (0..4).flat_map(|_| sampler.draw(3, &Visits::even(12), &mut stream)).collect();
        shown.sort_unstable();
        assert_eq!(shown, (0..12).collect::<Vec<_>>());
        assert!(sampler.round_ended);
    }

    #[test]
    fn what_is_upcoming_is_drawn_next() {
        let visits = Visits(vec![1.0, 1.5, 1.0, 2.0, 1.0, 1.0, 1.0]);
        let (mut sampler, mut stream) = (Sampler::default(), Stream::new(3, 0));
        sampler.draw(5, &visits, &mut stream);
        let upcoming = sampler.upcoming(12, &visits, &stream);
        let drawn: Vec<usize> = (0..4).flat_map(|_| sampler.draw(3, &visits, &mut stream)).collect();
        assert_eq!(drawn, upcoming);
    }

    #[test]
    fn a_round_of_chosen_views_ends_when_each_was_shown() {
        let (mut sampler, mut stream) = (Sampler::default(), Stream::new(1, 0));
        for (views, ended) in [([0, 1], false), ([1, 0], false), ([2, 2], true)] {
            sampler.strike(&views, &Visits::even(3), &mut stream);
            assert_eq!(std::mem::take(&mut sampler.round_ended), ended, "{views:?}");
        }
        // The second 2 belongs to the next round.
        assert_eq!(sampler.draw(2, &Visits::even(3), &mut stream).iter().sum::<usize>(), 1);
    }

    #[test]
    fn a_batch_may_reach_into_the_next_round() {
        let mut sampler = Sampler::default();
        assert_eq!(sampler.draw(5, &Visits::even(2), &mut Stream::new(1, 0)).len(), 5);
    }

    #[test]
    fn a_part_of_a_visit_is_a_chance() {
        let (visits, mut stream) = (Visits(vec![1.0, 1.25, 3.0]), Stream::new(1, 0));
        let rounds: Vec<usize> = (0..1000).flat_map(|_| visits.round(&mut stream)).collect();
        let count = |view| rounds.iter().filter(|&&other| other == view).count();
        assert_eq!((count(0), count(2)), (1000, 3000));
        // A quarter, within five standard deviations.
        assert!((1180..1320).contains(&count(1)), "{}", count(1));
    }

    #[test]
    fn moments_without_a_neighbour_are_shown_more_often() {
        let camera = Camera::centred(2, 1, 2.0, DMat3::IDENTITY, DVec3::ZERO);
        let times = [0.0, 0.25, 0.5, 0.75, 1.0];
        let photos = times.map(|time| TrainingView { camera, time, number: 0 });
        let map = |levels| MotionMap::new((2, 1), 1, vec![PixelMotion::moving(levels), PixelMotion::still(9)]);
        // At the third of five moments, twice as much moves as at the others.
        let moving = MovingPixels::from_maps([9, 9, 19, 9, 9].map(map).to_vec());
        let visits = Visits::by_loneliness(&photos, &moving, &Timeline::new(times.to_vec()), 3.0);
        for (found, expected) in visits.0.iter().zip([4.0, 2.0, 4.0, 2.0, 4.0]) {
            assert!((found - expected).abs() < 1e-12, "{visits:?}");
        }
    }
}
