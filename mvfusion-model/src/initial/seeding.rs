//! The result of the search for points on moving objects, as one line.

use std::fmt::{self, Display};

use mvfusion_data::motion::MotionSummary;

const MIB: f64 = (1 << 20) as f64;

/// The result of the search for points on moving objects (`init.motion_points`).
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Seeding {
    /// No three fixed cameras film the same moments, so there is no hull and the dynamic Gaussians are uniform.
    NoStillCameras,
    /// A hull was computed.
    Searched {
        /// Its summary. Without seeds, the dynamic Gaussians are uniform.
        summary: MotionSummary,
        /// Duration in seconds.
        seconds: f64,
        /// Peak bytes of stored images.
        bytes: u64,
    },
}

impl Seeding {
    /// Number of points found; without any, the dynamic Gaussians are uniform in the scene's box.
    pub fn seeds(&self) -> usize {
        match self {
            Self::NoStillCameras => 0,
            Self::Searched { summary, .. } => summary.seeds,
        }
    }
}

impl Display for Seeding {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        const UNIFORM: &str = "the dynamic Gaussians are uniform in the room";
        let Self::Searched { summary, seconds, bytes } = self else {
            return write!(f, "no three still cameras film the same moments; {UNIFORM}");
        };
        let MotionSummary { cameras, moments, reduction, moving_share, candidates, seeds, .. } = *summary;
        write!(f, "{:.1} % of the pixels of {cameras} cameras x {moments} frames move", 100.0 * moving_share)?;
        if reduction > 1 {
            write!(f, " (images reduced {reduction} times)")?;
        }
        let cost = format!("{seconds:.1} s, {:.0} MiB", (*bytes as f64 / MIB).ceil());
        match seeds {
            0 => write!(f, "; no place that nearly all of them see moving in one colour in {cost}: {UNIFORM}"),
            _ => write!(f, "; {seeds} seeds from {candidates} candidates in {cost}"),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_search_is_told_in_a_line() {
        let summary = MotionSummary {
            cameras: 7,
            moments: 24,
            reduction: 1,
            moving_share: 0.049,
            candidates: 25_000,
            ..Default::default()
        };
        let line = |summary| Seeding::Searched { summary, seconds: 1.84, bytes: 240 << 20 }.to_string();
        let found = line(MotionSummary { seeds: 2000, ..summary });
        let move_ = "4.9 % of the pixels of 7 cameras x 24 frames move";
        assert_eq!(found, format!("{move_}; 2000 seeds from 25000 candidates in 1.8 s, 240 MiB"));
        let reduced = line(MotionSummary { seeds: 2000, reduction: 3, ..summary });
        assert!(reduced.starts_with(&format!("{move_} (images reduced 3 times); 2000 seeds")), "{reduced}");
        for nothing in [line(summary), Seeding::NoStillCameras.to_string()] {
            assert!(nothing.ends_with("the dynamic Gaussians are uniform in the room"), "{nothing}");
        }
    }
}
