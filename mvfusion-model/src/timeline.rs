//! The times of the training views: samples, knots and neighbours.

/// The sorted, distinct times of the training views, with the queries of the motion modules (METHOD A6, A19).
#[derive(Clone, Debug, PartialEq)]
pub struct Timeline {
    times: Vec<f64>,
}

/// The position of a time between two knots of a dictionary.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Between {
    /// Index of the knot at or before the time.
    pub lower: usize,
    /// Index of the knot after it; equal to `lower` outside the knots.
    pub upper: usize,
    /// Weight of the upper knot, in `[0, 1]`.
    pub weight: f64,
}

impl Timeline {
    /// The timeline of the given times, in any order and with repetitions. An empty list means a single moment 0.
    pub fn new(mut times: Vec<f64>) -> Self {
        times.sort_by(f64::total_cmp);
        times.dedup();
        if times.is_empty() {
            times.push(0.0);
        }
        Self { times }
    }

    /// The distinct times in ascending order.
    pub fn times(&self) -> &[f64] {
        &self.times
    }

    /// Mean distance between consecutive times; 1 for a single time.
    pub fn spacing(&self) -> f64 {
        match self.times.as_slice() {
            [first, .., last] => (last - first) / (self.times.len() - 1) as f64,
            _ => 1.0,
        }
    }

    /// Indices of at most `samples` times, evenly spaced from the first to the last (A6): `k (T-1) / (K-1)` rounded
    /// half up.
    pub fn sample_indices(&self, samples: usize) -> Vec<usize> {
        spread(self.times.len(), samples)
    }

    /// Index of the time nearest to `time`; the earlier one on a tie (A19).
    pub fn nearest(&self, time: f64) -> usize {
        let after = self.times.partition_point(|&t| t < time);
        let Some(before) = after.checked_sub(1) else { return 0 };
        match self.times.get(after) {
            Some(&next) if next - time < time - self.times[before] => after,
            _ => before,
        }
    }

    /// The time `offset` frames away from frame `index`, clamped at the ends.
    pub fn neighbour(&self, index: usize, offset: isize) -> f64 {
        let last = self.times.len() as isize - 1;
        self.times[(index as isize + offset).clamp(0, last) as usize]
    }
}

/// At most `samples` of the numbers `0..count`, evenly spaced from the first to the last.
pub fn spread(count: usize, samples: usize) -> Vec<usize> {
    let chosen = samples.min(count);
    match chosen {
        0 => Vec::new(),
        1 => vec![0],
        _ => (0..chosen).map(|k| (2 * k * (count - 1) + (chosen - 1)) / (2 * (chosen - 1))).collect(),
    }
}

/// Every `stride`-th of the numbers `0..count`, and the last (A6).
pub fn strided(count: usize, stride: usize) -> Vec<usize> {
    let mut chosen: Vec<usize> = (0..count).step_by(stride.max(1)).collect();
    if let (Some(&last), Some(end)) = (chosen.last(), count.checked_sub(1))
        && last != end
    {
        chosen.push(end);
    }
    chosen
}

/// The position of `time` among ascending `knots`, clamped at the ends.
pub fn between(knots: &[f64], time: f64) -> Between {
    let upper = knots.partition_point(|&t| t <= time);
    if upper == 0 {
        return Between { lower: 0, upper: 0, weight: 0.0 };
    }
    let lower = upper - 1;
    match knots.get(upper) {
        None => Between { lower, upper: lower, weight: 0.0 },
        Some(&next) => Between { lower, upper, weight: (time - knots[lower]) / (next - knots[lower]) },
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn times_are_sorted_and_distinct() {
        assert_eq!(Timeline::new(vec![0.5, 0.0, 0.5]).times(), [0.0, 0.5]);
        assert_eq!(Timeline::new(vec![]).times(), [0.0]);
    }

    #[test]
    fn samples_reach_from_the_first_to_the_last() {
        let line = Timeline::new((0..300).map(|i| i as f64 / 300.0).collect());
        let samples = line.sample_indices(64);
        assert_eq!((samples.len(), samples[0], samples[63]), (64, 0, 299));
        assert_eq!(Timeline::new(vec![0.1, 0.2]).sample_indices(64), [0, 1]);
    }

    #[test]
    fn knots_hold_every_sixteenth_sample_and_the_last() {
        assert_eq!(strided(64, 16), [0, 16, 32, 48, 63]);
        assert_eq!(strided(33, 16), [0, 16, 32]);
        assert_eq!(strided(1, 16), [0]);
    }

    #[test]
    fn the_nearest_time_is_the_earlier_one_on_a_tie() {
        let line = Timeline::new(vec![0.0, 0.5, 1.0]);
        assert_eq!([-1.0, 0.25, 0.26, 0.5, 9.0].map(|t| line.nearest(t)), [0, 0, 1, 1, 2]);
    }

    #[test]
    fn neighbours_are_held_at_the_ends() {
        let line = Timeline::new(vec![0.0, 0.5, 1.0]);
        assert_eq!((line.neighbour(1, -5), line.neighbour(1, 5), line.neighbour(1, 0)), (0.0, 1.0, 0.5));
    }

    #[test]
    fn a_time_between_knots_is_weighted_and_one_outside_is_held() {
        let knots = [0.0, 0.5, 1.0];
        assert_eq!(between(&knots, 0.125), Between { lower: 0, upper: 1, weight: 0.25 });
        assert_eq!(between(&knots, -1.0), Between { lower: 0, upper: 0, weight: 0.0 });
        assert_eq!(between(&knots, 2.0), Between { lower: 2, upper: 2, weight: 0.0 });
    }
}
