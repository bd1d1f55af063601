//! Named random streams: one seed, and a separate ChaCha stream for each purpose.
//!
//! Separate streams keep runs comparable. For example, more draws in densification do not change the order of the
//! training views.

use rand::{Rng, SeedableRng};
use rand_chacha::ChaCha8Rng;
use serde::{Deserialize, Serialize};

/// The random streams of a run.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Streams {
    /// Initial clouds.
    pub clouds: Stream,
    /// Initial weights of the networks.
    pub weights: Stream,
    /// Order of the training views.
    pub sampling: Stream,
    /// Positions of split Gaussians, selection of Gaussians for opacity resets.
    pub densify: Stream,
}

impl Streams {
    /// The streams of a seed.
    pub fn new(seed: u64) -> Self {
        Self {
            clouds: Stream::new(seed, 0),
            weights: Stream::new(seed, 1),
            sampling: Stream::new(seed, 2),
            densify: Stream::new(seed, 3),
        }
    }
}

/// A reproducible stream of random numbers whose position can be saved.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Stream(ChaCha8Rng);

impl Stream {
    /// Stream `number` of a seed.
    pub fn new(seed: u64, number: u64) -> Self {
        let mut rng = ChaCha8Rng::seed_from_u64(seed);
        rng.set_stream(number);
        Self(rng)
    }

    /// A number in `[0, 1)`.
    pub fn unit(&mut self) -> f64 {
        /// 2^-53: the spacing of doubles below one.
        const SPACING: f64 = 1.0 / (1u64 << 53) as f64;
        (self.0.next_u64() >> 11) as f64 * SPACING
    }

    /// A number in `[low, high)`.
    pub fn uniform(&mut self, low: f64, high: f64) -> f64 {
        low + (high - low) * self.unit()
    }

    /// An index in `0..count`; `count` must not be 0.
    pub fn index(&mut self, count: usize) -> usize {
        ((self.unit() * count as f64) as usize).min(count - 1)
    }

    /// A normally distributed number (Box and Muller).
    pub fn normal(&mut self) -> f64 {
        let radius = (-2.0 * (1.0 - self.unit()).ln()).sqrt();
        radius * (std::f64::consts::TAU * self.unit()).cos()
    }

    /// The numbers `0..count` in random order.
    pub fn permutation(&mut self, count: usize) -> Vec<usize> {
        let mut order: Vec<usize> = (0..count).collect();
        for last in (1..count).rev() {
            order.swap(last, self.index(last + 1));
        }
        order
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn streams_of_one_seed_differ_and_repeat() {
        let mut a = Stream::new(7, 0);
        let mut b = Stream::new(7, 1);
        let mut again = Stream::new(7, 0);
        let first = a.unit();
        assert_ne!(first, b.unit());
        assert_eq!(first, again.unit());
    }

    #[test]
    fn a_saved_stream_goes_on_where_it_was() {
        let mut stream = Stream::new(3, 2);
        stream.normal();
        let saved = serde_json::to_string(&stream).expect("a stream serialises");
        let mut restored: Stream = serde_json::from_str(&saved).expect("and comes back");
        assert_eq!(stream.unit(), restored.unit());
    }

    #[test]
    fn a_permutation_holds_every_number_once() {
        let mut order = Stream::new(1, 0).permutation(100);
        assert_ne!(order, (0..100).collect::<Vec<_>>());
        order.sort_unstable();
        assert_eq!(order, (0..100).collect::<Vec<_>>());
    }

    #[test]
    fn normal_numbers_have_mean_zero_and_variance_one() {
        let mut stream = Stream::new(5, 0);
        let draws: Vec<f64> = (0..20_000).map(|_| stream.normal()).collect();
        let mean = draws.iter().sum::<f64>() / draws.len() as f64;
        let variance = draws.iter().map(|x| (x - mean).powi(2)).sum::<f64>() / draws.len() as f64;
        // Three standard errors of 20,000 draws.
        assert!(mean.abs() < 0.022 && (variance - 1.0).abs() < 0.03, "mean {mean}, variance {variance}");
    }
}
