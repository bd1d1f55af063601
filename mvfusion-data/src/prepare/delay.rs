//! The delay between two recordings of one sound.

use realfft::RealFftPlanner;
use realfft::num_complex::Complex;

/// Around the highest peak, correlations of the same event, in seconds.
const PEAK_SECONDS: f64 = 0.05;

/// Least confidence of a delay. Unrelated sounds have about 1.
pub(super) const LEAST_CONFIDENCE: f64 = 1.5;

/// Most confidence: two copies of one recording have no second peak.
const MOST_CONFIDENCE: f32 = 1000.0;

/// The delay between two recordings.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Delay {
    /// Seconds by which the other recording started after the first.
    pub(super) seconds: f64,
    /// The highest peak of the correlation divided by the highest one elsewhere. Unrelated sounds have about 1.
    pub(super) confidence: f64,
}

/// The delay by which `other` started after `first`, both with `rate` samples per second. Cross-correlation with phase
/// transform (Knapp and Carter 1976): every frequency has the same weight, so microphones and rooms may differ.
pub(super) fn delay(first: &[f32], other: &[f32], rate: u32) -> Delay {
    let length = (first.len() + other.len()).next_power_of_two();
    let mut planner = RealFftPlanner::new();
    let (forward, inverse) = (planner.plan_fft_forward(length), planner.plan_fft_inverse(length));
    let spectrum = |samples: &[f32]| {
        let mut padded = samples.to_vec();
        padded.resize(length, 0.0);
        let mut spectrum = forward.make_output_vec();
        // Proof: both have the length that was planned.
        forward.process(&mut padded, &mut spectrum).expect("lengths as planned");
        spectrum
    };
    let mut product: Vec<Complex<f32>> =
        spectrum(first).iter().zip(spectrum(other)).map(|(one, two)| whitened(one * two.conj())).collect();
    // The constant part says nothing, and that of the highest frequency is real.
    product[0] = Complex::default();
    if let Some(last) = product.last_mut() {
        last.im = 0.0;
    }
    let mut correlation = inverse.make_output_vec();
    // Proof: both have the length that was planned, and the first and last numbers are real.
    inverse.process(&mut product, &mut correlation).expect("lengths as planned");
    peak(&correlation, rate)
}

/// The number of length one in the same direction; zero stays zero.
fn whitened(value: Complex<f32>) -> Complex<f32> {
    let norm = value.norm();
    if norm > f32::MIN_POSITIVE { value / norm } else { Complex::default() }
}

/// The highest peak of a circular correlation. The second half holds negative delays.
fn peak(correlation: &[f32], rate: u32) -> Delay {
    let length = correlation.len();
    let highest = (0..length).max_by(|&a, &b| correlation[a].total_cmp(&correlation[b])).unwrap_or(0);
    let near = (PEAK_SECONDS * f64::from(rate)) as usize;
    let is_elsewhere = |index: usize| {
        let away = index.abs_diff(highest);
        away.min(length - away) > near
    };
    let elsewhere = (0..length).filter(|&index| is_elsewhere(index)).map(|index| correlation[index]);
    let second = elsewhere.fold(0.0, f32::max).max(correlation[highest] / MOST_CONFIDENCE).max(f32::MIN_POSITIVE);
    let samples = if highest > length / 2 { highest as f64 - length as f64 } else { highest as f64 };
    Delay { seconds: samples / f64::from(rate), confidence: f64::from(correlation[highest] / second) }
}

#[cfg(test)]
mod tests {
    use rand::{RngExt, SeedableRng};
    use rand_chacha::ChaCha8Rng;

    use super::*;

    const RATE: u32 = 8000;

    fn noise(seed: u64, samples: usize) -> Vec<f32> {
        let mut rng = ChaCha8Rng::seed_from_u64(seed);
        (0..samples).map(|_| rng.random::<f32>() - 0.5).collect()
    }

    #[test]
    fn the_delay_of_a_sound_is_found_through_another_microphone() {
        let event = noise(1, 40_000);
        // An echo, another loudness and noise of its own.
        let own = noise(2, 40_000);
        let heard: Vec<f32> =
            (0..40_000).map(|i| 0.2 * event[i] + 0.1 * event[i.saturating_sub(301)] + 0.1 * own[i]).collect();
        for (first, other, samples) in
            [(&event[..30_000], &heard[4000..], 4000.0), (&event[2400..], &heard[..36_000], -2400.0)]
        {
            let found = delay(first, other, RATE);
            assert!((found.seconds - samples / f64::from(RATE)).abs() < 1e-3, "{found:?}");
            assert!(found.confidence > 3.0, "{found:?}");
        }
    }

    #[test]
    fn unrelated_sounds_have_no_peak_to_trust() {
        let found = delay(&noise(3, 30_000), &noise(4, 30_000), RATE);
        assert!(found.confidence < LEAST_CONFIDENCE, "{found:?}");
    }
}
