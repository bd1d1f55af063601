//! The motion hull: seeds for Gaussians where something moves, at the right moment.

use std::fmt::{self, Display};

use rand::SeedableRng;
use rand_chacha::ChaCha8Rng;
use rayon::prelude::*;

use super::choice::{choose, quotas};
use super::eye::Eye;
use super::film::MotionFilm;
use super::moving_pixels::MotionMap;
use super::options::MotionHullOptions;
use super::places::{Place, Search};
use super::reach::reaches;
use super::rig::Moment;
use crate::scene::{PointCloud, Scene};

/// Random stream of the first moment. Streams of other purposes have small numbers.
const STREAM: u64 = 1 << 32;

/// Places with motion, each at one moment.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct MotionSeeds {
    /// Positions in world units and colours, sorted by time. May be empty.
    pub points: PointCloud,
    /// The moment of each point, in `[0, 1]`.
    pub times: Vec<f64>,
    /// Statistics.
    pub summary: MotionSummary,
}

/// Statistics of a motion hull.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct MotionSummary {
    /// Number of fixed cameras.
    pub cameras: usize,
    /// Number of moments that at least three cameras film.
    pub moments: usize,
    /// The factor by which each side of the images was reduced.
    pub reduction: usize,
    /// Mean fraction of moving pixels in an image.
    pub moving_share: f64,
    /// Number of places found.
    pub candidates: usize,
    /// Number of places chosen.
    pub seeds: usize,
    /// Number of moments with a seed.
    pub seeded_moments: usize,
}

impl Display for MotionSummary {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self { cameras, moments, reduction, moving_share, candidates, seeds, seeded_moments } = self;
        write!(f, "{seeds} seeds at {seeded_moments} of {moments} moments, of {candidates} places where {cameras} ")?;
        write!(f, "cameras see motion ({:.2} % of their pixels", 100.0 * moving_share)?;
        if *reduction > 1 {
            write!(f, ", images reduced {reduction} times")?;
        }
        write!(f, ")")
    }
}

/// Places where, at one moment, nearly all cameras that see them see motion in one colour. The result may be empty.
///
/// For each moment, rays through moving pixels are drawn in proportion to the pixels' differences. Each ray is searched
/// at jittered depths, evenly spaced in inverse depth. Its best place is the one where the cameras' colours agree best,
/// and seeds are drawn from these places. Each moment has its own random stream, so the result does not depend on the
/// number of threads.
///
/// `film` must belong to `scene`.
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

/// The result for one moment.
struct Found {
    candidates: usize,
    seeds: Vec<Place>,
}

/// The amount of motion at a moment.
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
