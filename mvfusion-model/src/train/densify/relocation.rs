//! Relocation of unneeded Gaussians to where more are needed, at a fixed count (3DGS-MCMC, Kheradmand et al. 2024).

use crate::random::Stream;

/// Upper bound of opacities, so that the shares have finite logits: a logit of 17 is an opacity of 1 in `f32`.
const MOST_OPACITY: f64 = 1.0 - 1e-6;

/// The Gaussians to relocate, and their targets.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct RelocationPlan {
    /// Rows that do not change, ascending.
    pub kept: Vec<usize>,
    /// Rows that are replaced by two equal ones, ascending. The same number of rows is dropped.
    pub shared: Vec<usize>,
}

/// An opacity and a factor of the scales.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Share {
    /// Opacity of each of two Gaussians that replace one.
    pub opacity: f64,
    /// Factor of the scales.
    pub scale: f64,
}

impl Share {
    /// The values with which two coinciding Gaussians look like one of the given opacity (3DGS-MCMC, eq. 9 for N = 2).
    pub fn of(opacity: f64) -> Self {
        let opacity = opacity.min(MOST_OPACITY);
        let each = 1.0 - (1.0 - opacity).sqrt();
        Self { opacity: each, scale: opacity / (2.0 * each - each * each / std::f64::consts::SQRT_2) }
    }
}

impl RelocationPlan {
    /// Relocates at most `most` of the `dead` rows: the faintest first; on a tie, the lower row. Each target is a
    /// living row drawn in proportion to `opacities` times `mean_gradients`, without repetition. If there are too few
    /// targets, some dead rows stay.
    pub fn draw(dead: &[bool], opacities: &[f64], mean_gradients: &[f64], most: usize, stream: &mut Stream) -> Self {
        // Exponential waiting times with the weights as rates; the shortest are drawn (Efraimidis and Spirakis 2006).
        let mut waiting: Vec<(f64, usize)> = Vec::new();
        for row in (0..dead.len()).filter(|&row| !dead[row]) {
            let weight = opacities[row] * mean_gradients[row];
            if weight > 0.0 {
                waiting.push((-(1.0 - stream.unit()).ln() / weight, row));
            }
        }
        waiting.sort_by(|a, b| a.0.total_cmp(&b.0).then(a.1.cmp(&b.1)));
        let mut faintest: Vec<usize> = (0..dead.len()).filter(|&row| dead[row]).collect();
        faintest.sort_by(|&a, &b| opacities[a].total_cmp(&opacities[b]).then(a.cmp(&b)));

        let moved = most.min(waiting.len()).min(faintest.len());
        let mut shared: Vec<usize> = waiting[..moved].iter().map(|&(_, row)| row).collect();
        shared.sort_unstable();
        let mut stays = vec![true; dead.len()];
        faintest[..moved].iter().chain(&shared).for_each(|&row| stays[row] = false);
        Self { kept: (0..dead.len()).filter(|&row| stays[row]).collect(), shared }
    }

    /// Whether nothing changes.
    pub fn is_empty(&self) -> bool {
        self.shared.is_empty()
    }

    /// The parent of every new row: rows that stay, then both copies of the shared rows.
    pub fn sources(&self) -> Vec<usize> {
        [&self.kept, &self.shared, &self.shared].into_iter().flatten().copied().collect()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn two_that_share_a_place_hide_as_much_as_one() {
        for opacity in [1e-3, 0.3, 0.9, 0.999] {
            let share = Share::of(opacity);
            assert!((1.0 - (1.0 - share.opacity).powi(2) - opacity).abs() < 1e-12);
            // Along a line through both, their combined alpha has the same integral as the original's: the integral of
            // 1 - (1 - o g)^2 with a bell g, in units of its width.
            let two = 2.0 * share.opacity - share.opacity.powi(2) / std::f64::consts::SQRT_2;
            assert!((two * share.scale - opacity).abs() < 1e-12);
        }
    }

    #[test]
    fn what_hides_all_is_shared_by_finite_logits() {
        let share = Share::of(1.0);
        assert!(share.opacity < 1.0 && share.scale.is_finite(), "{share:?}");
    }

    #[test]
    fn the_dead_go_where_opacity_and_gradient_are() {
        let dead = [true, false, false, true, false, true];
        let (opacities, gradients) = ([0.003, 0.9, 0.9, 0.001, 0.0, 0.002], [1.0, 0.0, 2.0, 1.0, 5.0, 1.0]);
        let plan = |most| RelocationPlan::draw(&dead, &opacities, &gradients, most, &mut Stream::new(1, 0));
        // Only row 2 has both, so the faintest moves there.
        assert_eq!(plan(9), RelocationPlan { kept: vec![0, 1, 4, 5], shared: vec![2] });
        assert_eq!(plan(9).sources(), [0, 1, 4, 5, 2, 2]);
        assert!(plan(0).is_empty() && plan(0).sources() == (0..6).collect::<Vec<_>>());
    }

    #[test]
    fn what_is_needed_more_is_drawn_more_often() {
        let mut stream = Stream::new(3, 0);
        let mut draw =
            || RelocationPlan::draw(&[true, false, false], &[0.0, 0.5, 0.5], &[0.0, 1.0, 3.0], 1, &mut stream);
        let count = (0..1000).filter(|_| draw().shared == [2]).count();
        // Three quarters, within five standard deviations.
        assert!((680..820).contains(&count), "{count}");
    }
}
