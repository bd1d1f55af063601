//! The paper's variant "position variance only" (main paper, component ablation; METHOD A27).

use std::ops::Range;

use super::statistics::{AttributeSpread, SIGNATURE_WIDTH, TrajectoryStatistics};

/// Columns of a signature for rotation and scale.
const ROTATION_AND_SCALE: Range<usize> = 6..12;

impl TrajectoryStatistics {
    /// The statistics of the position only. The columns of rotation and scale are zero, and the intensity is the
    /// position's spread, averaged over the axes. The local variances, which describe the position, do not change.
    pub fn position_only(mut self) -> Self {
        for signature in self.signatures.chunks_exact_mut(SIGNATURE_WIDTH) {
            let position = AttributeSpread::of(signature).position;
            signature[ROTATION_AND_SCALE].fill(0.0);
            signature[SIGNATURE_WIDTH - 1] = position;
        }
        self
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn position_stays_and_the_rest_goes() {
        let statistics = TrajectoryStatistics {
            signatures: (1..=26).map(f64::from).collect(),
            local: vec![0.5, 0.25],
            velocities: Vec::new(),
            knot_times: vec![0.0],
        };
        let left = statistics.clone().position_only();
        let zeros = [0.0; 6];
        let first = [&[1.0, 2.0, 3.0, 4.0, 5.0, 6.0][..], &zeros, &[5.0]].concat();
        let second = [&[14.0, 15.0, 16.0, 17.0, 18.0, 19.0][..], &zeros, &[18.0]].concat();
        assert_eq!(left.signatures, [first, second].concat());
        assert_eq!((left.local, left.knot_times), (statistics.local, statistics.knot_times));
    }
}
