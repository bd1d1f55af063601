//! Values that depend on the number of times of a scene.

use mvfusion_data::{Capture, Scene};

use super::{Branches, Config, MotionConfig, TimeRows};
use crate::timeline::strided;

/// Number of times in the videos of the paper's window (Neu3D).
const PAPER_TIMES: usize = 300;

/// Rows of a time plane per row that is read: times in `[0, 1]` read only the upper half (METHOD §2.1).
const ROWS_A_READ_ROW: usize = 2;

/// Rows that are read per photo with its own moment. With fewer rows, unrelated photos would share cells.
const ROWS_A_PHOTO: usize = 4;

impl Config {
    /// The configuration with the values that `model.grid.time_rows`, `motion.by_times` or `train.scale_times` derive
    /// from the scene's times. These keys are switched off in the result, so that it stays valid for its run if the
    /// scene changes. It may be called before or after [`Config::scaled`].
    pub fn for_times_of(&self, scene: &Scene) -> Self {
        self.for_times(scene.training_times().len(), scene.capture)
    }

    /// Whether Gaussians are born for objects in single photos. This needs a collection of photos with distinct
    /// moments, and a first stage in which a static branch learns the static scene.
    pub fn has_births(&self, scene: &Scene) -> bool {
        let is_asked = self.init.photo_points > 0 && self.model.lifetime && self.init.dynamic_ply.is_none();
        let has_still = self.model.branches == Branches::Both && self.train.stages.geometry.0 > 0;
        let is_collection = scene.capture == Capture::Photos && scene.training_times().len() == scene.train.len();
        is_asked && has_still && is_collection
    }

    /// The same for this many distinct times.
    fn for_times(&self, times: usize, capture: Capture) -> Self {
        let mut fitted = self.clone();
        let is_short = self.train.scale < 1.0 && self.train.scale_times;
        if is_short || self.model.grid.time_rows == TimeRows::ByTimes {
            let rows = &mut fitted.model.grid.resolution[3];
            *rows = time_rows(*rows, times, capture);
        }
        if is_short || self.motion.by_times {
            fitted.motion.window = window(self.motion.window, times);
            fitted.motion.knots = knots(&self.motion, times);
        }
        fitted.model.grid.time_rows = TimeRows::Fixed;
        fitted.motion.by_times = false;
        fitted.train.scale_times = false;
        fitted
    }
}

/// Rows of the time planes if `given` are configured. Frames of a video may share cells with their neighbours, so one
/// row each is enough, and `given` is the maximum. Photos share nothing, so `given` is the minimum.
fn time_rows(given: usize, times: usize, capture: Capture) -> usize {
    match capture {
        Capture::Video => given.min(ROWS_A_READ_ROW * times),
        Capture::Photos => given.max(ROWS_A_READ_ROW * ROWS_A_PHOTO * times),
    }
}

/// The window that is the same fraction of these times as `given` is of the paper's: at least 1, at most `given`.
fn window(given: usize, times: usize) -> usize {
    let rounded = (2 * given * times + PAPER_TIMES) / (2 * PAPER_TIMES);
    rounded.clamp(1, given.max(1))
}

/// Number of knots. With fewer times than samples, it is as large as with all samples, if there are enough times;
/// otherwise it does not change.
fn knots(motion: &MotionConfig, times: usize) -> usize {
    let evaluated = |samples: usize| strided(samples, motion.sample_stride).len();
    if motion.knots > 0 || times >= motion.samples {
        return motion.knots;
    }
    strided(evaluated(motion.samples), motion.knot_stride).len().min(evaluated(times))
}

#[cfg(test)]
mod tests {
    use mvfusion_data::{BuiltinKind, BuiltinOptions, builtin};

    use super::*;

    /// A configuration in which everything follows the times.
    fn by_times() -> Config {
        let mut config = Config::default();
        (config.model.grid.time_rows, config.motion.by_times) = (TimeRows::ByTimes, true);
        config
    }

    #[test]
    fn photos_have_four_rows_each_and_frames_one_at_most() {
        for (given, times, capture, rows) in [
            (48, 60, Capture::Photos, 480),
            (1000, 60, Capture::Photos, 1000),
            (48, 24, Capture::Video, 48),
            (150, 24, Capture::Video, 48),
            (150, 300, Capture::Video, 150),
            (150, 1, Capture::Video, 2),
        ] {
            assert_eq!(time_rows(given, times, capture), rows, "{given} {times} {capture:?}");
        }
    }

    #[test]
    fn a_window_keeps_its_share_of_the_times() {
        let windows = |given| [1, 24, 89, 90, 150, 300, 3000].map(|times| window(given, times));
        assert_eq!(windows(5), [1, 1, 1, 2, 3, 5, 5]);
        assert_eq!(windows(9), [1, 1, 3, 3, 5, 9, 9]);
        assert_eq!(windows(1), [1; 7]);
    }

    #[test]
    fn few_times_have_as_many_knots_as_many() {
        let with = |knots: usize, sample_stride: usize| MotionConfig { knots, sample_stride, ..Default::default() };
        // The paper's 64 samples have knots 0, 16, 32, 48 and 63.
        assert_eq!([1, 3, 24, 63, 64, 300].map(|times| knots(&with(0, 1), times)), [1, 3, 5, 5, 0, 0]);
        // Of 33 evaluated samples 0, 16 and 32.
        assert_eq!([3, 24].map(|times| knots(&with(0, 2), times)), [2, 3]);
        assert_eq!(knots(&with(7, 1), 24), 7, "a number that was asked for stays");
    }

    #[test]
    fn the_numbers_are_found_once_and_stay() {
        let photos =
            BuiltinOptions { width: 16, height: 16, photos: 10, ..BuiltinOptions::of_kind(BuiltinKind::Casual) };
        let mut config = by_times();
        config.model.grid.resolution[3] = 48;
        let fitted = config.for_times_of(&builtin::builtin(&photos));
        assert_eq!((fitted.model.grid.resolution, fitted.motion.window), ([64, 64, 64, 80], 1));
        assert_eq!((fitted.model.grid.time_rows, fitted.motion.by_times), (TimeRows::Fixed, false));
        assert_eq!(fitted.for_times(999, Capture::Photos), fitted, "another scene changes nothing");
    }

    #[test]
    fn each_switch_has_its_own_numbers_and_a_short_run_has_both() {
        let paper = Config::default();
        let same = |config: &Config| {
            let mut config = config.clone();
            config.train.scale_times = paper.train.scale_times;
            config
        };
        assert_eq!(same(&paper.for_times(24, Capture::Video)), paper);
        let rows = Config { motion: paper.motion.clone(), ..by_times() }.for_times(24, Capture::Video);
        assert_eq!((rows.model.grid.resolution[3], &rows.motion), (48, &paper.motion));
        let motion = Config { model: paper.model.clone(), ..by_times() }.for_times(24, Capture::Video);
        assert_eq!((&motion.model, motion.motion.window, motion.motion.knots), (&paper.model, 1, 5));

        let mut short = paper.clone();
        short.train.scale = 0.1;
        let fitted = short.for_times(24, Capture::Video);
        assert_eq!((&fitted.model, &fitted.motion), (&rows.model, &motion.motion));
        assert_eq!(fitted.for_times(999, Capture::Photos), fitted);
        assert_eq!(short.scaled().for_times(24, Capture::Video), fitted.scaled(), "in either order");
        short.train.scale_times = false;
        assert_eq!(short.for_times(24, Capture::Video), short);
    }
}
