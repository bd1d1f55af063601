//! The time of a step of the whole run, from steps of smaller copies of it.

/// A measured step: the Gaussians of each branch (dynamic, static), and seconds.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Measured {
    /// Gaussians: dynamic, static.
    pub counts: [f64; 2],
    /// Seconds.
    pub seconds: f64,
}

/// Measured steps of one stage.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Probed {
    /// A copy with `share` of the run's pixels and of its initial Gaussians.
    pub copy: Measured,
    /// The share; 1 is the run itself.
    pub share: f64,
    /// A much smaller copy, and its share.
    pub small: (Measured, f64),
    /// The copy with fewer Gaussians of one branch: dynamic, static.
    pub fewer: [Measured; 2],
}

/// Seconds of a step: `a + b * pixels + c_dynamic * dynamic + c_static * static`.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct StepCost {
    /// With all pixels and `counts`.
    whole: f64,
    counts: [f64; 2],
    /// Per additional Gaussian.
    slopes: [f64; 2],
}

impl Probed {
    /// Seconds per additional Gaussian of a branch, at least 0; 0 where the copies have as many.
    pub fn slope(&self, branch: usize) -> f64 {
        let (copy, fewer) = (&self.copy, &self.fewer[branch]);
        let less = copy.counts[branch] - fewer.counts[branch];
        if less > 0.0 { ((copy.seconds - fewer.seconds) / less).max(0.0) } else { 0.0 }
    }
}

impl StepCost {
    /// Fits the coefficients, of which `slopes` are those of the Gaussians. Noise may not make any of them negative.
    pub fn fit(probed: &Probed, slopes: [f64; 2]) -> Self {
        let Probed { copy, share, small: (small, small_share), .. } = probed;
        // The two copies shrink pixels and Gaussians alike, so their line meets share 0 at the constant part.
        let constant = match share > small_share {
            true => (small.seconds * share - copy.seconds * small_share) / (share - small_share),
            false => 0.0,
        };
        let constant = constant.clamp(0.0, small.seconds.min(copy.seconds));
        let growing = (copy.seconds - constant) / share;
        let counts = copy.counts.map(|count| count / share);
        let of_gaussians = slopes[0] * counts[0] + slopes[1] * counts[1];
        let limit = if of_gaussians > growing { growing / of_gaussians } else { 1.0 };
        Self { whole: constant + growing, counts, slopes: slopes.map(|slope| slope * limit) }
    }

    /// Seconds of a step with all pixels and these Gaussians: dynamic, static.
    pub fn at(&self, counts: [f64; 2]) -> f64 {
        let added = |branch: usize| self.slopes[branch] * (counts[branch] - self.counts[branch]);
        self.whole + added(0) + added(1)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Rounding of sums of a few numbers around 1.
    const ROUNDING: f64 = 1e-12;

    /// The initial Gaussians of the run.
    const COUNTS: [f64; 2] = [4000.0, 10_000.0];

    /// A step that is exactly linear.
    fn exact(pixels: f64, counts: [f64; 2]) -> Measured {
        Measured { counts, seconds: 0.02 + 0.3 * pixels + 5e-5 * counts[0] + 1e-5 * counts[1] }
    }

    fn probed(share: f64) -> Probed {
        let at = |share: f64, dynamic: f64, still: f64| {
            exact(share, [share * dynamic * COUNTS[0], share * still * COUNTS[1]])
        };
        Probed {
            copy: at(share, 1.0, 1.0),
            share,
            small: (at(0.0625, 1.0, 1.0), 0.0625),
            fewer: [at(share, 0.25, 1.0), at(share, 1.0, 0.25)],
        }
    }

    fn fitted(probed: &Probed) -> StepCost {
        StepCost::fit(probed, [probed.slope(0), probed.slope(1)])
    }

    #[test]
    fn exact_times_are_extrapolated_exactly_from_any_share() {
        for share in [0.1, 0.5, 1.0] {
            let cost = fitted(&probed(share));
            for counts in [COUNTS, [9000.0, 10_000.0], [4000.0, 40_000.0], [1000.0, 100_000.0]] {
                let error = cost.at(counts) - exact(1.0, counts).seconds;
                assert!(error.abs() < ROUNDING, "{share} {counts:?}: {error}");
            }
        }
    }

    #[test]
    fn what_was_measured_in_full_is_not_extrapolated() {
        let mut noisy = probed(1.0);
        noisy.small.0.seconds *= 2.0;
        assert!((fitted(&noisy).at(COUNTS) - noisy.copy.seconds).abs() < ROUNDING);
    }

    #[test]
    fn noise_makes_no_gaussian_cost_less_than_nothing_or_more_than_all() {
        let mut noisy = probed(0.5);
        noisy.fewer[0].seconds = 2.0 * noisy.copy.seconds;
        noisy.fewer[1].seconds = 0.0;
        let cost = fitted(&noisy);
        assert_eq!(cost.at([1e6, COUNTS[1]]), cost.at(COUNTS));
        assert!(cost.at([0.0, 0.0]) >= 0.0);
        assert!(cost.at([COUNTS[0], 1e6]) > cost.at(COUNTS));
    }

    #[test]
    fn the_smallest_copy_alone_gives_a_proportion() {
        let mut alone = probed(0.0625);
        alone.fewer = [alone.copy; 2];
        let cost = fitted(&alone);
        assert!((cost.at(COUNTS) - 16.0 * alone.copy.seconds).abs() < ROUNDING);
    }
}
