//! The number of seeds of each moment, and the selection of their positions.

use rand::RngExt;
use rand_chacha::ChaCha8Rng;

use super::clusters::sizes_of_things;
use super::options::MotionHullOptions;
use super::places::Place;

/// Minimum number of places of an object. Fewer may be chance.
const LEAST_PLACES: usize = 3;

/// Weight of loneliness in a moment's quota. With 1, the first frame of the built-in video stays 3 dB below the mean.
const LONELY: f64 = 2.0;

/// Weights of the next neighbour and the one after it in a moment's loneliness, on either side.
const NEIGHBOURS: [f64; 2] = [2.0 / 3.0, 1.0 / 3.0];

/// Loneliness of each moment, from 0 to 2: the number of sides without neighbours that show the same motion. `amounts`
/// is the amount of motion at each moment. With steady motion, it is 1 at the first and last moment, 1/3 next to them,
/// and 0 elsewhere. Otherwise, it is larger by the fractions of the motion that appear and disappear there. It is 0 if
/// nothing moves.
pub fn loneliness(amounts: &[u64]) -> Vec<f64> {
    let amount =
        |moment: Option<usize>| moment.and_then(|moment| amounts.get(moment)).map_or(0.0, |&amount| amount as f64);
    let of = |moment: usize| {
        let own = amount(Some(moment));
        let lacks = |neighbour: Option<usize>| (own - amount(neighbour)).max(0.0);
        let around =
            |(weight, away): (f64, usize)| weight * (lacks(moment.checked_sub(away)) + lacks(moment.checked_add(away)));
        if own > 0.0 { NEIGHBOURS.into_iter().zip(1..).map(around).sum::<f64>() / own } else { 0.0 }
    };
    (0..amounts.len()).map(of).collect()
}

/// The number of seeds of each moment, `points` in total. The fraction `even` is shared equally by all moments with
/// motion, the rest in proportion to its amount. Lonely moments count more, because a moment borrows from its
/// neighbours.
pub(super) fn quotas(points: usize, amounts: &[u64], even: f64) -> Vec<usize> {
    let lonely = loneliness(amounts).into_iter().map(|loneliness| 1.0 + LONELY * loneliness);
    let evenly: Vec<f64> = lonely.zip(amounts).map(|(lonely, &amount)| if amount > 0 { lonely } else { 0.0 }).collect();
    let by_amount: Vec<f64> = evenly.iter().zip(amounts).map(|(lonely, &amount)| lonely * amount as f64).collect();
    let totals = [&evenly, &by_amount].map(|weights| weights.iter().sum::<f64>().max(f64::MIN_POSITIVE));
    let mut sum = 0.0;
    let mut given = 0;
    let quota = |(evenly, by_amount): (&f64, &f64)| {
        sum += points as f64 * (even * evenly / totals[0] + (1.0 - even) * by_amount / totals[1]);
        // Rounds the running sum, so that no seed is lost.
        let quota = sum.round() as usize - given;
        given += quota;
        quota
    };
    evenly.iter().zip(&by_amount).map(quota).collect()
}

/// Chooses at most `wanted` of a moment's places as seeds, with probabilities that grow with their motion. For a
/// fraction of the seeds, an object's probability grows only with the root of its number of places, so that small
/// objects get seeds next to people. Isolated places are excluded.
pub(super) fn choose(places: &[Place], wanted: usize, options: &MotionHullOptions, rng: &mut ChaCha8Rng) -> Vec<usize> {
    let positions: Vec<_> = places.iter().map(|place| place.position).collect();
    let things = sizes_of_things(&positions);
    let by_motion = |(place, &size): (&Place, &usize)| if size < LEAST_PLACES { 0.0 } else { place.motion + 1.0 };
    let mut weights: Vec<f64> = places.iter().zip(&things).map(by_motion).collect();
    let by_thing: Vec<f64> = weights.iter().zip(&things).map(|(weight, &size)| weight / (size as f64).sqrt()).collect();
    let mut chosen = draw(&by_thing, (options.even_over_things * wanted as f64).round() as usize, rng);
    for &index in &chosen {
        weights[index] = 0.0;
    }
    chosen.extend(draw(&weights, wanted.saturating_sub(chosen.len()), rng));
    chosen.sort_unstable();
    chosen
}

/// Draws at most `wanted` indices without replacement, in proportion to their weights. Weights of 0 are never drawn.
/// Each index has an exponential waiting time with its weight as the rate, and the earliest are drawn (Efraimidis and
/// Spirakis 2006).
fn draw(weights: &[f64], wanted: usize, rng: &mut ChaCha8Rng) -> Vec<usize> {
    let waiting = |(index, &weight): (usize, &f64)| {
        // In (0, 1], so its logarithm is finite.
        let uniform = 1.0 - rng.random::<f64>();
        (-uniform.ln() / weight, index)
    };
    let mut times: Vec<(f64, usize)> = weights.iter().enumerate().map(waiting).collect();
    times.retain(|(time, _)| time.is_finite());
    times.sort_by(|a, b| a.0.total_cmp(&b.0).then(a.1.cmp(&b.1)));
    times.into_iter().take(wanted).map(|(_, index)| index).collect()
}

#[cfg(test)]
mod tests {
    use rand::SeedableRng;

    use super::*;

    #[test]
    fn the_ends_and_what_comes_or_goes_have_more_seeds() {
        let quotas = quotas(1000, &[100, 100, 100, 150, 150, 100, 100], 0.5);
        assert!(quotas[0] > 3 * quotas[1] / 2 && quotas[6] > 3 * quotas[5] / 2, "{quotas:?}");
        assert!(quotas[3] > quotas[2] && quotas[3].abs_diff(quotas[4]) < 2, "{quotas:?}");
    }

    #[test]
    fn a_moment_is_lonely_for_what_its_neighbours_lack() {
        let near = |found: &[f64], expected: &[f64]| {
            assert!(found.iter().zip(expected).all(|(a, b)| (a - b).abs() < 1e-12), "{found:?}");
        };
        near(&loneliness(&[5; 6]), &[1.0, 1.0 / 3.0, 0.0, 0.0, 1.0 / 3.0, 1.0]);
        // Half of the motion at the fourth moment appears and disappears there.
        near(&loneliness(&[5, 5, 5, 10, 5, 5, 5])[2..5], &[0.0, 1.0, 0.0]);
        near(&loneliness(&[0, 7, 0, 0]), &[0.0, 2.0, 0.0, 0.0]);
        assert!(loneliness(&[]).is_empty());
    }

    #[test]
    fn quotas_add_up_and_moments_without_motion_have_none() {
        let quotas = quotas(1001, &[300, 0, 100, 7], 0.5);
        assert_eq!(quotas.iter().sum::<usize>(), 1001);
        assert_eq!(quotas[1], 0);
        assert!(quotas[0] > quotas[2] && quotas[2] > quotas[3] && quotas[3] > 1001 / 10);
        assert_eq!(super::quotas(10, &[0, 0], 0.5), [0, 0]);
    }

    #[test]
    fn heavy_indices_are_drawn_more_often_and_weightless_ones_never() {
        let mut rng = ChaCha8Rng::seed_from_u64(1);
        let drawn: Vec<usize> = (0..1000).flat_map(|_| draw(&[1.0, 0.0, 3.0], 1, &mut rng)).collect();
        let count = |index| drawn.iter().filter(|&&other| other == index).count();
        assert_eq!((drawn.len(), count(1)), (1000, 0));
        // Three quarters, within five standard deviations.
        assert!((680..820).contains(&count(2)), "{}", count(2));
        let mut all = draw(&[1.0, 0.0, 3.0], 9, &mut rng);
        all.sort_unstable();
        assert_eq!(all, [0, 2]);
    }
}
