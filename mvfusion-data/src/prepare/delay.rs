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

/// The recording that others are compared with.
pub(super) struct Reference {
    samples: Vec<f32>,
    /// Samples per second.
    rate: u32,
    planner: RealFftPlanner<f32>,
    /// Its spectrum in the length of the latest comparison. Recordings mostly have one length.
    spectrum: Option<(usize, Vec<Complex<f32>>)>,
}

impl Reference {
    /// A recording with `rate` samples per second.
    pub(super) fn new(samples: Vec<f32>, rate: u32) -> Self {
        Self { samples, rate, planner: RealFftPlanner::new(), spectrum: None }
    }

    /// The delay by which `other` started after this recording, with as many samples per second. Cross-correlation with
    /// phase transform (Knapp and Carter 1976): every frequency has the same weight, so microphones and rooms may
    /// differ.
    pub(super) fn delay(&mut self, other: &[f32]) -> Delay {
        let length = (self.samples.len() + other.len()).next_power_of_two();
        let own = match self.spectrum.take() {
            Some((known, own)) if known == length => own,
            _ => spectrum(&self.samples, length, &mut self.planner),
        };
        let mut product = spectrum(other, length, &mut self.planner);
        product.iter_mut().zip(&own).for_each(|(two, one)| *two = whitened(one * two.conj()));
        self.spectrum = Some((length, own));
        // The constant part says nothing, and that of the highest frequency is real.
        product[0] = Complex::default();
        if let Some(last) = product.last_mut() {
            last.im = 0.0;
        }
        let inverse = self.planner.plan_fft_inverse(length);
        let mut correlation = inverse.make_output_vec();
        // Proof: both have the length that was planned, and the first and last numbers are real.
        inverse.process(&mut product, &mut correlation).expect("lengths as planned");
        peak(&correlation, self.samples.len(), self.rate)
    }
}

/// The spectrum of samples that silence follows, up to `length`.
fn spectrum(samples: &[f32], length: usize, planner: &mut RealFftPlanner<f32>) -> Vec<Complex<f32>> {
    let forward = planner.plan_fft_forward(length);
    let mut padded = forward.make_input_vec();
    padded[..samples.len()].copy_from_slice(samples);
    let mut spectrum = forward.make_output_vec();
    // Proof: both have the length that was planned.
    forward.process(&mut padded, &mut spectrum).expect("lengths as planned");
    spectrum
}

/// The number of length one in the same direction; zero stays zero.
fn whitened(value: Complex<f32>) -> Complex<f32> {
    let norm = value.norm();
    if norm > f32::MIN_POSITIVE { value / norm } else { Complex::default() }
}

/// The highest peak of a circular correlation with a first recording of `samples` samples. A positive delay is shorter
/// than that recording. All that follows holds negative delays.
fn peak(correlation: &[f32], samples: usize, rate: u32) -> Delay {
    let length = correlation.len();
    let highest = (0..length).max_by(|&a, &b| correlation[a].total_cmp(&correlation[b])).unwrap_or(0);
    let near = (PEAK_SECONDS * f64::from(rate)) as usize;
    let is_elsewhere = |index: usize| {
        let away = index.abs_diff(highest);
        away.min(length - away) > near
    };
    let elsewhere = (0..length).filter(|&index| is_elsewhere(index)).map(|index| correlation[index]);
    let second = elsewhere.fold(0.0, f32::max).max(correlation[highest] / MOST_CONFIDENCE).max(f32::MIN_POSITIVE);
    let delay = if highest >= samples { highest as f64 - length as f64 } else { highest as f64 };
    Delay { seconds: delay / f64::from(rate), confidence: f64::from(correlation[highest] / second) }
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

    fn delay(first: &[f32], other: &[f32]) -> Delay {
        Reference::new(first.to_vec(), RATE).delay(other)
    }

    #[test]
    fn a_short_recording_may_start_late_in_a_long_one() {
        let event = noise(5, 30_000);
        // Beyond half the length of the transform, which is 2^15.
        let part = &event[20_000..22_000];
        for (first, other, seconds) in [(&event[..], part, 2.5), (part, &event[..], -2.5)] {
            let found = delay(first, other);
            assert!((found.seconds - seconds).abs() < 1e-3 && found.confidence > 3.0, "{found:?}");
        }
    }

    #[test]
    fn a_reference_answers_the_same_however_often_it_is_asked() {
        let event = noise(6, 40_000);
        let mut reference = Reference::new(event[..30_000].to_vec(), RATE);
        // The last one has another length.
        for other in [&event[4000..], &event[2000..], &event[4000..], &event[4000..5000]] {
            assert_eq!(reference.delay(other), delay(&event[..30_000], other));
        }
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
            let found = delay(first, other);
            assert!((found.seconds - samples / f64::from(RATE)).abs() < 1e-3, "{found:?}");
            assert!(found.confidence > 3.0, "{found:?}");
        }
    }

    #[test]
    fn unrelated_sounds_have_no_peak_to_trust() {
        let found = delay(&noise(3, 30_000), &noise(4, 30_000));
        assert!(found.confidence < LEAST_CONFIDENCE, "{found:?}");
    }
}
