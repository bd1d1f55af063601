//! When Gaussians are there, for statistics of what they do while they are.

use mvfusion_data::Lifetime;

use crate::config::{MotionConfig, Trajectory};
use crate::model::gaussians::{Attribute, Gaussians, LEAST_LOG_DURATION, MOST_LOG_DURATION};
use crate::{ModelError, tensors};

/// Lifetimes and own velocities of Gaussians, on the host.
#[derive(Clone, Debug)]
pub struct Lifetimes {
    centres: Vec<f64>,
    durations: Vec<f64>,
    /// World units per video, row by row.
    velocities: Vec<f64>,
}

impl Lifetimes {
    /// Those of Gaussians, if trajectories are measured over lifetimes and there are any.
    ///
    /// # Errors
    /// If the device fails to return values.
    pub fn of(gaussians: &Gaussians, config: &MotionConfig) -> Result<Option<Self>, ModelError> {
        let plain = |attribute| gaussians.plain(attribute);
        let columns =
            plain(Attribute::TimeCentres).zip(plain(Attribute::LogDurations)).zip(plain(Attribute::Velocities));
        let Some(((centres, durations), velocities)) = columns.filter(|_| config.trajectory == Trajectory::Lifetime)
        else {
            return Ok(None);
        };
        Ok(Some(Self {
            centres: tensors::read(centres)?,
            durations: tensors::read(durations.clamp(LEAST_LOG_DURATION, MOST_LOG_DURATION).exp())?,
            velocities: tensors::read(velocities)?,
        }))
    }

    /// Those of Gaussians that are not in a model yet, if trajectories are measured over lifetimes.
    pub fn of_further(lifetimes: &[Lifetime], config: &MotionConfig) -> Option<Self> {
        let duration = |log: f32| f64::from(log).clamp(LEAST_LOG_DURATION, MOST_LOG_DURATION).exp();
        (config.trajectory == Trajectory::Lifetime).then(|| Self {
            centres: lifetimes.iter().map(|lifetime| f64::from(lifetime.centre)).collect(),
            durations: lifetimes.iter().map(|lifetime| duration(lifetime.log_duration)).collect(),
            velocities: lifetimes.iter().flat_map(|lifetime| lifetime.velocity.map(f64::from)).collect(),
        })
    }

    /// Given lifetimes, for tests.
    #[cfg(test)]
    pub(super) fn new(centres: Vec<f64>, durations: Vec<f64>, velocities: Vec<f64>) -> Self {
        Self { centres, durations, velocities }
    }

    /// Weights of times for a Gaussian: the factor of the odds of its opacity by its lifetime, relative to that at the
    /// time at which it is there most.
    pub(super) fn weights(&self, row: usize, times: &[f64]) -> Vec<f64> {
        let exponent = |time: &f64| -((time - self.centres[row]) / self.durations[row]).powi(2);
        let largest = times.iter().map(exponent).fold(f64::NEG_INFINITY, f64::max);
        times.iter().map(|time| (exponent(time) - largest).exp()).collect()
    }

    /// The way of a Gaussian by its own velocity until a time, along an axis, in world units.
    pub(super) fn travel(&self, row: usize, axis: usize, time: f64) -> f64 {
        self.velocities[3 * row + axis] * (time - self.centres[row])
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn times_count_while_a_gaussian_is_there() {
        let lifetimes = Lifetimes::new(vec![0.5, 9.0], vec![0.1, 0.1], vec![0.0, 0.0, 0.0, 2.0, 0.0, 0.0]);
        let weights = lifetimes.weights(0, &[0.4, 0.5, 0.6]);
        assert!((weights[0] - (-1f64).exp()).abs() < 1e-9 && weights[1] == 1.0, "{weights:?}");
        let never = lifetimes.weights(1, &[0.0, 1.0]);
        assert_eq!(never, [0.0, 1.0], "the time at which it is there most");
        assert_eq!(lifetimes.travel(1, 0, 10.0), 2.0);
    }
}
