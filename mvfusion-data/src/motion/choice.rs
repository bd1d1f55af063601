//! How many seeds each moment has, and which of its places.

use rand::RngExt;
use rand_chacha::ChaCha8Rng;

use super::MotionHullOptions;
use super::clusters::sizes_of_things;
use super::places::Place;

/// Places that a thing must have to be one: single ones may be chance.
const LEAST_PLACES: usize = 3;

/// How many of `points` seeds each moment has: a share in equal parts for all in which something moves, the rest by how
/// much does.
pub(super) fn quotas(points: usize, amounts: &[u64], even: f64) -> Vec<usize> {
    let (total, moments) = (amounts.iter().sum::<u64>(), amounts.iter().filter(|&&amount| amount > 0).count());
    let mut sum = 0.0;
    let mut given = 0;
    let quota = |&amount: &u64| {
        if amount > 0 {
            sum += points as f64 * (even / moments as f64 + (1.0 - even) * amount as f64 / total as f64);
        }
        // Of the sums so far, so that rounding loses none.
        let quota = sum.round() as usize - given;
        given += quota;
        quota
    };
    amounts.iter().map(quota).collect()
}

/// Which of a moment's places become seeds: at most `wanted`, drawn by their motion. For a share of them the weight of a
/// thing grows with the root of its places only, so that a ball has seeds beside people. Places belong to one thing if
/// cubes of side `side` that hold them touch.
pub(super) fn choose(
    places: &[Place],
    wanted: usize,
    side: f64,
    options: &MotionHullOptions,
    rng: &mut ChaCha8Rng,
) -> Vec<usize> {
    let positions: Vec<_> = places.iter().map(|place| place.position).collect();
    let by_motion = |place: &Place| place.motion + 1.0;
    let things = sizes_of_things(&positions, side);
    let by_thing = |(place, &size): (&Place, &usize)| by_motion(place) / (size.max(LEAST_PLACES) as f64).sqrt();
    let even = (options.even_over_things * wanted as f64).round() as usize;
    let weights: Vec<f64> = places.iter().zip(&things).map(by_thing).collect();
    let mut chosen = draw(&weights, even, rng);
    let mut weights: Vec<f64> = places.iter().map(by_motion).collect();
    for &index in &chosen {
        weights[index] = 0.0;
    }
    chosen.extend(draw(&weights, wanted.saturating_sub(chosen.len()), rng));
    chosen.sort_unstable();
    chosen
}

/// Draws at most so many indices without replacement, in proportion to their weights; none of weight 0. Each has a waiting
/// time that is exponential with its weight as its rate, and the first to come are drawn (Efraimidis and Spirakis 2006).
fn draw(weights: &[f64], wanted: usize, rng: &mut ChaCha8Rng) -> Vec<usize> {
    let waiting = |(index, &weight): (usize, &f64)| {
        // In (0, 1], whose logarithm is finite.
        let uniform = 1.0 - rng.random::<f64>();
        (-uniform.ln() / weight, index)
    };
    let mut times: Vec<(f64, usize)> = weights.iter().enumerate().map(waiting).collect();
    times.retain(|(time, _)| time.is_finite());
    times.sort_by(|a, b| a.0.total_cmp(&b.0).then(a.1.cmp(&b.1)));
    times.into_iter().take(wanted).map(|(_, index)| index).collect()
}
