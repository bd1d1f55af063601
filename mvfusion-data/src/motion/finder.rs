//! World positions of given pixels, for Gaussians that are added during training.

use std::collections::BTreeMap;

use glam::{DVec2, DVec3};
use rand::SeedableRng;
use rand_chacha::ChaCha8Rng;

use super::eye::Eye;
use super::film::MotionFilm;
use super::options::MotionHullOptions;
use super::places::Search;
use super::reach::reaches;
use crate::scene::Scene;

/// Finds the world position of motion in a training view, by the rule of the motion hull.
#[derive(Clone, Debug)]
pub struct MotionFinder {
    film: MotionFilm,
    options: MotionHullOptions,
    /// Depth ranges of the rig's cameras.
    reaches: Vec<[f64; 2]>,
    /// Moment and shot of each training view.
    shots: BTreeMap<usize, (usize, usize)>,
}

impl MotionFinder {
    /// A finder for the film of a scene.
    pub fn new(scene: &Scene, film: MotionFilm, options: MotionHullOptions) -> Self {
        let reaches = reaches(scene, &film.rig, &options);
        let moments = film.rig.moments.iter().enumerate();
        let shots = moments
            .flat_map(|(number, moment)| {
                moment.shots.iter().enumerate().map(move |(shot, seen)| (seen.view, (number, shot)))
            })
            .collect();
        Self { film, options, reaches, shots }
    }

    /// The film.
    pub fn film(&self) -> &MotionFilm {
        &self.film
    }

    /// Whether enough fixed cameras film the moment of a training view, so that places can be found in it.
    pub fn films(&self, view: usize) -> bool {
        self.shots.contains_key(&view)
    }

    /// The places behind pixel positions of a training view, in world units. At such a place, nearly all cameras that
    /// see it see motion in one colour at the view's moment. `None` if there is no such place.
    pub fn locate(&self, view: usize, positions: &[DVec2], seed: u64) -> Vec<Option<DVec3>> {
        let Some(&(moment, shot)) = self.shots.get(&view) else { return vec![None; positions.len()] };
        let moment = &self.film.rig.moments[moment];
        let Some(eye) = Eye::of_shot(&self.film, &moment.shots[shot], &self.reaches) else {
            return vec![None; positions.len()];
        };
        let search = Search::new(Eye::of_moment(&self.film, moment, &self.reaches), &self.options);
        let mut rng = ChaCha8Rng::seed_from_u64(seed);
        positions.iter().map(|&position| Some(search.place_through(&eye, position, &mut rng)?.position)).collect()
    }
}
