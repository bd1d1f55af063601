//! The numbers of Gaussians that a run will have, from the growth at its beginning.

use crate::config::{DensifyConfig, StageConfig};

/// Rounds after which the share that a round adds has fallen to a half: between 2 and 20 in measured runs.
const HALVED_AFTER: f64 = 5.0;

/// Points of a stage at which the number is evaluated.
const SAMPLES: usize = 64;

/// A branch before it grows, in each of the three stages.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub(super) struct Beginning {
    /// Gaussians without any densification.
    pub counts: [f64; 3],
    /// Share of the Gaussians that the first rounds of densification add.
    pub gains: [f64; 3],
    /// Gaussians of a round of births.
    pub births: f64,
    /// The largest number.
    pub most: f64,
}

impl Beginning {
    /// Mean numbers in the three stages.
    ///
    /// The share that a round adds falls with the number `r` of rounds, as `gain / (1 + r / HALVED_AFTER)`, because
    /// gradients fall as the model improves. The number then grows as a power of `1 + r / HALVED_AFTER`. Pruning is not
    /// predicted.
    pub fn means(&self, densify: &DensifyConfig, stages: &StageConfig) -> [f64; 3] {
        let lengths = [stages.geometry.0, stages.deformation.0, stages.refinement.0];
        let continued = if stages.refinement_restarts { 0 } else { stages.deformation.0 };
        let until = densify.until.0.saturating_sub(1);
        let (mut count, mut done) = (self.counts[0], 0);
        std::array::from_fn(|stage| {
            if stage > 0 {
                count += self.counts[stage] - self.counts[stage - 1];
            }
            let (begin, start) = ([0, 0, continued][stage], count);
            let passed =
                |steps: usize| rounds(densify.interval.0, densify.from.0.max(begin), (begin + steps).min(until));
            let births = |steps: usize| match stage {
                0 => 0,
                _ => (begin + 1..=(begin + steps).min(until)).filter(|&step| densify.births_due(step)).count(),
            };
            let age = |rounds: usize| 1.0 + rounds as f64 / HALVED_AFTER;
            let power = HALVED_AFTER * self.gains[stage].ln_1p();
            let grown = |steps: usize| {
                let factor = (age(done + passed(steps)) / age(done)).powf(power);
                (start * factor + self.births * births(steps) as f64).min(self.most.max(start))
            };
            count = grown(lengths[stage]);
            let middle = |sample: usize| lengths[stage] * (2 * sample + 1) / (2 * SAMPLES);
            let mean = (0..SAMPLES).map(|sample| grown(middle(sample))).sum::<f64>() / SAMPLES as f64;
            done += passed(lengths[stage]);
            mean
        })
    }
}

/// Multiples of `interval` after the step `from`, up to `to`; none if it is 0.
fn rounds(interval: usize, from: usize, to: usize) -> usize {
    let passed = |step: usize| step.checked_div(interval).unwrap_or(0);
    passed(to).saturating_sub(passed(from))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::config::{Interval, Steps};

    fn densify() -> DensifyConfig {
        DensifyConfig { from: Steps(100), until: Steps(1001), interval: Interval(100), ..DensifyConfig::default() }
    }

    #[test]
    fn rounds_are_counted_as_training_counts_them() {
        let counted = |from: usize, to: usize| (from + 1..=to).filter(|step| step.is_multiple_of(30)).count();
        for (from, to) in [(0, 29), (0, 30), (30, 60), (45, 300), (300, 45)] {
            assert_eq!(rounds(30, from, to), counted(from, to), "{from} {to}");
        }
        assert_eq!(rounds(0, 0, 100), 0);
    }

    #[test]
    fn a_branch_grows_by_rounds_up_to_its_most() {
        let branch = Beginning { counts: [1000.0; 3], gains: [0.0, 0.1, 0.1], births: 0.0, most: 1300.0 };
        let means = branch.means(&densify(), &StageConfig::of([500, 500, 4000]));
        assert_eq!(means[0], 1000.0);
        // Rounds at 200, 300, 400 and 500 of 500 steps, after four without gain. Each adds some 5 %.
        assert!((1040.0..1080.0).contains(&means[1]), "{means:?}");
        // Two further rounds fill it up, and no more follow in the longer part of the stage.
        assert!((1285.0..=1300.0).contains(&means[2]), "{means:?}");
    }

    #[test]
    fn a_round_adds_half_its_share_after_some() {
        /// The law is continuous and a round is not.
        const TOLERANCE: f64 = 0.1;
        let branch = Beginning { counts: [1000.0; 3], gains: [0.01; 3], births: 0.0, most: 1e9 };
        let densify = DensifyConfig { from: Steps(0), until: Steps(100_000), interval: Interval(1), ..densify() };
        let at = |rounds: usize| branch.means(&densify, &StageConfig::of([rounds, 0, 0]))[1];
        let share = |rounds: usize| (at(rounds + 1) / at(rounds) - 1.0) / 0.01;
        assert!((share(0) - 1.0).abs() < TOLERANCE, "{}", share(0));
        assert!((share(HALVED_AFTER as usize) - 0.5).abs() < TOLERANCE, "{}", share(HALVED_AFTER as usize));
    }

    #[test]
    fn what_is_born_between_two_stages_counts_from_then_on() {
        let branch = Beginning { counts: [64.0, 5000.0, 5000.0], most: 9000.0, ..Beginning::default() };
        assert_eq!(branch.means(&densify(), &StageConfig::of([10, 10, 10])), [64.0, 5000.0, 5000.0]);
    }

    #[test]
    fn births_add_to_the_deforming_stages() {
        let branch = Beginning { counts: [100.0; 3], births: 50.0, most: 1e6, ..Beginning::default() };
        let densify = DensifyConfig { births_interval: Interval(100), ..densify() };
        let means = branch.means(&densify, &StageConfig::of([1000, 0, 4000]));
        assert_eq!(means[0], 100.0);
        // Ten rounds in the first quarter of the stage.
        assert!((530.0..570.0).contains(&means[2]), "{means:?}");
        let densify = DensifyConfig { reset_interval: Interval(200), ..densify };
        let means = branch.means(&densify, &StageConfig::of([1000, 0, 4000]));
        // Every second one is left out.
        assert!((310.0..340.0).contains(&means[2]), "{means:?}");
    }
}
