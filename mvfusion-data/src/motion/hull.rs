//! The motion hull: seeds for Gaussians where something moves, at the moment at which it is there.

use std::fmt::{self, Display};

use rand::SeedableRng;
use rand_chacha::ChaCha8Rng;
use rayon::prelude::*;

use super::choice::{choose, quotas};
use super::eye::Eye;
use super::places::{Place, Search};
use super::reach::reaches;
use super::rig::Moment;
use super::{MotionFilm, MotionHullOptions, MotionMap};
use crate::{PointCloud, Scene};

/// The number of the first moment's random stream: those of other purposes have small numbers.
const STREAM: u64 = 1 << 32;

/// Places where something moves, each at one moment.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct MotionSeeds {
    /// Positions in world units and colours, in order of time. May be empty.
    pub points: PointCloud,
    /// The moment of each point, in `[0, 1]`.
    pub times: Vec<f64>,
    /// What there is to say about them.
    pub summary: MotionSummary,
}

/// What there is to say about a motion hull.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct MotionSummary {
    /// Cameras that stand still.
    pub cameras: usize,
    /// Moments that at least three of them film.
    pub moments: usize,
    /// Each side of the pictures was made shorter by this.
    pub reduction: usize,
    /// Mean share of a picture's pixels that move.
    pub moving_share: f64,
    /// Places that were found.
    pub candidates: usize,
    /// Places that were chosen.
    pub seeds: usize,
    /// Moments that have a seed.
    pub seeded_moments: usize,
}

impl Display for MotionSummary {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self { cameras, moments, reduction, moving_share, candidates, seeds, seeded_moments } = self;
        write!(f, "{seeds} seeds at {seeded_moments} of {moments} moments, of {candidates} places where {cameras} ")?;
        write!(f, "cameras see motion ({:.2} % of their pixels", 100.0 * moving_share)?;
        if *reduction > 1 {
            write!(f, ", pictures reduced {reduction} times")?;
        }
        write!(f, ")")
    }
}

/// Places where, at one moment, nearly all cameras that see them see motion, in one colour. No place at all is no
/// error.
///
/// For each moment, rays through moving pixels, drawn by how much these differ, are searched at jittered places that
/// lie evenly in inverse depth; of each ray the place stays in whose colour the cameras agree best, and seeds are drawn
/// of these. Each moment has a random stream of its own, so that the result is the same for any number of threads.
///
/// `film` must be of `scene`.
pub fn motion_hull(scene: &Scene, film: &MotionFilm, options: &MotionHullOptions, seed: u64) -> MotionSeeds {
    let rig = &film.rig;
    let amounts: Vec<u64> = rig.moments.par_iter().map(|moment| amount(film, moment)).collect();
    let quotas = quotas(options.points, &amounts, options.even_over_moments);
    let reaches = reaches(scene, rig, options);
    let found: Vec<Found> = (rig.moments.par_iter().zip(quotas).enumerate())
        .map(|(number, (moment, wanted))| {
            let mut rng = ChaCha8Rng::seed_from_u64(seed);
            rng.set_stream(STREAM + number as u64);
            let eyes = Eye::of_moment(film, moment, &reaches);
            let places = Search::new(eyes, options).places(options.rays_per_point * wanted, &mut rng);
            let chosen = choose(&places, wanted, options, &mut rng);
            Found { candidates: places.len(), seeds: chosen.into_iter().map(|index| places[index]).collect() }
        })
        .collect();
    gathered(film, &found)
}

/// What was found at a moment.
struct Found {
    candidates: usize,
    seeds: Vec<Place>,
}

/// How much moves at a moment.
fn amount(film: &MotionFilm, moment: &Moment) -> u64 {
    moment.shots.iter().filter_map(|shot| film.moving().map(shot.view)).map(MotionMap::amount).sum()
}

fn gathered(film: &MotionFilm, found: &[Found]) -> MotionSeeds {
    let (mut points, mut times) = (PointCloud::default(), Vec::new());
    for (moment, found) in film.rig.moments.iter().zip(found) {
        for place in &found.seeds {
            points.push(place.position.as_vec3(), place.colour / 255.0);
            times.push(moment.time);
        }
    }
    let summary = MotionSummary {
        cameras: film.rig.cameras.len(),
        moments: film.rig.moments.len(),
        reduction: film.factor(),
        moving_share: film.moving().mean_share(),
        candidates: found.iter().map(|found| found.candidates).sum(),
        seeds: points.len(),
        seeded_moments: found.iter().filter(|found| !found.seeds.is_empty()).count(),
    };
    MotionSeeds { points, times, summary }
}
