//! The treatment of dynamic Gaussians that do not move. Ours; the paper names it as future work.

use burn::tensor::Tensor;

use super::{Position, Trainer};
use crate::config::StillRule;
use crate::model::DeformationLevel;
use crate::model::gaussians::Gaussians;
use crate::{ModelError, tensors};

/// Quantile of the motion intensity that serves as reference, because the largest values may be outliers.
const BRIGHTEST: f64 = 0.98;

impl Trainer {
    /// Applies `motion.still` to the newly measured intensities, in a step at `position`.
    pub(super) fn sort_out_still_ones(&mut self, position: &Position) -> Result<(), ModelError> {
        let config = &self.config.motion;
        let (rule, share) = (config.still, config.still_below);
        let Some(cache) = self.state.model.motion.as_ref().filter(|_| rule != StillRule::Keep) else { return Ok(()) };
        let intensities: Vec<f64> = tensors::read(cache.intensity.clone())?;
        let room = match (rule, &self.state.model.static_) {
            (StillRule::Reassign, Some(static_)) => {
                self.config.densify.static_.max_gaussians.saturating_sub(static_.count())
            }
            _ => usize::MAX,
        };
        let (moving, still) = limited(parted(&intensities, share), &intensities, room);
        // A branch never loses its last Gaussian.
        if still.is_empty() || moving.is_empty() {
            return Ok(());
        }
        if rule == StillRule::Reassign {
            // As the renders of this stage show them.
            self.reassign(&still, position.stage.level(self.config.model.deformation));
        }
        self.state.dynamic_branch().keep(moving);
        Ok(())
    }

    /// Copies dynamic Gaussians, in their state at the middle of the video, to the static branch, if there is one.
    fn reassign(&mut self, rows: &[usize], level: DeformationLevel) {
        let plain = self.state.model.plain();
        let times = self.context.timeline.times();
        let middle = times[times.len() / 2];
        let raw = plain.dynamic_at(middle, level, &self.context);
        let rows: Tensor<1, burn::tensor::Int> = tensors::rows_like(rows, &raw.means);
        if let Some(mut static_) = self.state.static_branch() {
            let moved = raw.select(&rows);
            let still =
                |attribute| static_.gaussians.plain(attribute).and(moved.attribute(attribute)).map(Tensor::autodiff);
            // Proof: the static branch has all attributes of `RawGaussians` except masks, which are optional.
            let still = Gaussians::from_tensors(still).expect("only masks and lifetimes may be absent");
            static_.append(&still);
        }
    }
}

/// Rows that move and rows that do not, which are below `share` of the 98 % quantile.
fn parted(intensities: &[f64], share: f64) -> (Vec<usize>, Vec<usize>) {
    let mut sorted = intensities.to_vec();
    sorted.sort_by(f64::total_cmp);
    let brightest = sorted.get((sorted.len().saturating_sub(1) as f64 * BRIGHTEST) as usize).copied().unwrap_or(0.0);
    (0..intensities.len()).partition(|&row| intensities[row] >= share * brightest)
}

/// The same with at most `room` still rows: those that move least; on a tie, the lower ones. The others stay where they
/// are.
fn limited(
    (mut moving, mut still): (Vec<usize>, Vec<usize>),
    intensities: &[f64],
    room: usize,
) -> (Vec<usize>, Vec<usize>) {
    if still.len() > room {
        still.sort_by(|&a, &b| intensities[a].total_cmp(&intensities[b]).then(a.cmp(&b)));
        moving.extend(still.split_off(room));
        moving.sort_unstable();
        still.sort_unstable();
    }
    (moving, still)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_full_branch_takes_only_the_stillest() {
        let intensities = [0.3, 9.0, 0.1, 0.2, 0.1];
        let all = || (vec![1], vec![0, 2, 3, 4]);
        assert_eq!(limited(all(), &intensities, 4), all());
        assert_eq!(limited(all(), &intensities, 3), (vec![0, 1], vec![2, 3, 4]));
        assert_eq!(limited(all(), &intensities, 1), (vec![0, 1, 3, 4], vec![2]));
        assert_eq!(limited(all(), &intensities, 0), ((0..5).collect(), vec![]));
    }

    #[test]
    fn a_gaussian_is_still_by_comparison_with_those_that_move() {
        let (moving, still) = parted(&[1.0, 1e-9, 0.5, 0.0, 1.0], 1e-4);
        assert_eq!((moving, still), (vec![0, 2, 4], vec![1, 3]));
    }

    #[test]
    fn where_nothing_moves_nothing_is_sorted_out() {
        assert_eq!(parted(&[0.0; 3], 1e-4), (vec![0, 1, 2], vec![]));
    }
}
