//! A moving normaliser for descriptors of unknown scale (METHOD A10).

use serde::{Deserialize, Serialize};

use crate::config::{MotionConfig, Normalisation};

/// The interquartile range of the standard normal distribution.
const NORMAL_RANGE: f64 = 1.348_979_500_392_163_5;

/// Moving mean and variance of each column over all Gaussians, updated with the statistics; with
/// `motion.normalisation = "quantiles"`, the median and the variance of a normal distribution with the same interquartile
/// range.
///
/// The first batch initialises the state, unless it starts from zero. Later batches have weight `1 - decay`. A value
/// `v` becomes `c tanh((v - mean) / (sqrt(variance) + epsilon) / c)` with the soft clip `c`.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct MovingNormaliser {
    /// Moving mean or median of each column; empty before the first update.
    pub means: Vec<f64>,
    /// Moving population variance of each column, or what stands for it.
    pub variances: Vec<f64>,
}

impl MovingNormaliser {
    /// Updates the state with row-major `values` of `columns` columns.
    pub fn update(&mut self, values: &[f64], columns: usize, config: &MotionConfig) {
        if values.is_empty() {
            return;
        }
        let (means, variances) = match config.normalisation {
            Normalisation::Moments => column_moments(values, columns),
            Normalisation::Quantiles => column_quantiles(values, columns),
        };
        if self.means.is_empty() && config.zero_start {
            (self.means, self.variances) = (vec![0.0; columns], vec![0.0; columns]);
        }
        if self.means.is_empty() {
            (self.means, self.variances) = (means, variances);
        } else {
            blend(&mut self.means, &means, config.decay);
            blend(&mut self.variances, &variances, config.decay);
        }
    }

    /// Normalises row-major `values`, with as many columns as those of the updates. Before the first, all are 0.
    pub fn normalise(&self, values: &[f64], config: &MotionConfig) -> Vec<f64> {
        let columns = self.means.len();
        if columns == 0 {
            return vec![0.0; values.len()];
        }
        let clip = config.soft_clip;
        let scales: Vec<f64> = self.variances.iter().map(|v| v.sqrt() + config.epsilon).collect();
        let normalise = |(i, v): (usize, &f64)| {
            let column = i % columns;
            clip * ((v - self.means[column]) / scales[column] / clip).tanh()
        };
        values.iter().enumerate().map(normalise).collect()
    }
}

fn blend(state: &mut [f64], batch: &[f64], decay: f64) {
    state.iter_mut().zip(batch).for_each(|(s, b)| *s = decay * *s + (1.0 - decay) * b);
}

/// Mean and population variance of each column.
fn column_moments(values: &[f64], columns: usize) -> (Vec<f64>, Vec<f64>) {
    let rows = (values.len() / columns) as f64;
    // Summed first, then divided once: the mean of a constant column is exact, and its variance is 0.
    let mean_over_rows = |value: &dyn Fn(usize, f64) -> f64| -> Vec<f64> {
        let mut sums = vec![0.0; columns];
        for row in values.chunks_exact(columns) {
            sums.iter_mut().zip(row).enumerate().for_each(|(column, (sum, &v))| *sum += value(column, v));
        }
        sums.into_iter().map(|sum| sum / rows).collect()
    };
    let means = mean_over_rows(&|_, v| v);
    let variances = mean_over_rows(&|column, v| (v - means[column]).powi(2));
    (means, variances)
}

/// The median of each column, and the variance of a normal distribution with its interquartile range.
fn column_quantiles(values: &[f64], columns: usize) -> (Vec<f64>, Vec<f64>) {
    let of_column = |column: usize| {
        let mut sorted: Vec<f64> = values.iter().skip(column).step_by(columns).copied().collect();
        sorted.sort_unstable_by(f64::total_cmp);
        let [lower, median, upper] = [0.25, 0.5, 0.75].map(|share| quantile(&sorted, share));
        (median, ((upper - lower) / NORMAL_RANGE).powi(2))
    };
    (0..columns).map(of_column).unzip()
}

/// The quantile of sorted values, linear between two of them.
fn quantile(sorted: &[f64], share: f64) -> f64 {
    let place = share * (sorted.len() - 1) as f64;
    let (below, above) = (sorted[place.floor() as usize], sorted[place.ceil() as usize]);
    below + (above - below) * place.fract()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_first_batch_sets_the_state_and_later_ones_blend_in() {
        let mut normaliser = MovingNormaliser::default();
        let config = MotionConfig::default();
        normaliser.update(&[0.0, 2.0], 1, &config);
        assert_eq!((normaliser.means[0], normaliser.variances[0]), (1.0, 1.0));
        normaliser.update(&[11.0, 11.0], 1, &config);
        assert!((normaliser.means[0] - (0.99 + 0.11)).abs() < 1e-12);
        assert!((normaliser.variances[0] - 0.99).abs() < 1e-12);
    }

    #[test]
    fn a_state_that_starts_from_zero_is_slow_to_learn() {
        let mut normaliser = MovingNormaliser::default();
        let config = MotionConfig { zero_start: true, ..MotionConfig::default() };
        normaliser.update(&[0.0, 2.0], 1, &config);
        assert!((normaliser.means[0] - 0.01).abs() < 1e-15 && (normaliser.variances[0] - 0.01).abs() < 1e-15);
    }

    #[test]
    fn values_are_clipped_softly_and_a_constant_column_is_zero() {
        let mut normaliser = MovingNormaliser::default();
        let mut values: Vec<f64> = (0..1000).flat_map(|i| [f64::from(i % 2), 4.0]).collect();
        values[0] = 1e6;
        let config = MotionConfig::default();
        normaliser.update(&values, 2, &config);
        let normalised = normaliser.normalise(&values, &config);
        assert!(normalised.iter().all(|v| v.abs() <= 3.0));
        assert!(normalised.iter().skip(1).step_by(2).all(|&v| v == 0.0));
    }

    #[test]
    fn quantiles_do_not_follow_outliers() {
        let config =
            MotionConfig { normalisation: Normalisation::Quantiles, soft_clip: 1e6, ..MotionConfig::default() };
        let mut values: Vec<f64> = (0..=100).flat_map(|i| [f64::from(i), 7.0]).collect();
        values[200] = 1e9;
        let mut normaliser = MovingNormaliser::default();
        normaliser.update(&values, 2, &config);
        let normalised = normaliser.normalise(&values, &config);
        assert_eq!(normaliser.means, [50.0, 7.0]);
        // The quartiles 25 and 75 lie 0.6745 standard deviations from the median.
        assert!((normalised[150] - 0.674_489_75).abs() < 1e-6, "{}", normalised[150]);
        assert!(normalised.iter().skip(1).step_by(2).all(|&v| v == 0.0));
    }
}
