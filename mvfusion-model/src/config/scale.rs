//! Shortened runs with the same schedule.

use super::keys::Key;
use super::{Branches, Config, TimeRows};

impl Config {
    /// The configuration with every iteration count multiplied by `train.scale`, which becomes 1.
    ///
    /// Every key of type [`Steps`](super::Steps) or [`Interval`](super::Interval) shrinks by the same factor: stage
    /// lengths, learning-rate horizons, SH steps, the refresh interval `E`, and the intervals and ends of
    /// densification, pruning and resets. Gaussians are added at most every 20 steps. Motion is measured and opacities
    /// are reset at most every 500 steps. The keys `train.scale_*` also adapt learning rates and the initial cloud. As
    /// `train.scale_times` needs the scene, it only sets `model.grid.time_rows` and `motion.by_times`, which
    /// [`Config::for_times_of`] applies.
    pub fn scaled(&self) -> Self {
        let mut scaled = self.clone();
        let factor = self.train.scale;
        scaled.scale_steps(factor);
        scaled.train.scale = 1.0;
        if factor < 1.0 {
            scaled.adapt_to_few_steps(factor);
        }
        scaled
    }

    /// Compensates for the missing steps of a run that `factor` shortens.
    fn adapt_to_few_steps(&mut self, factor: f64) {
        let (train, init) = (&self.train, &mut self.init);
        self.optim.faster(factor.powf(-train.scale_rates), factor.powf(-train.scale_mask));
        self.optim.end_above(train.scale_tail);
        self.motion.octaves = self.motion.octaves.min(train.scale_octaves);
        if train.scale_times {
            (self.model.grid.time_rows, self.motion.by_times) = (TimeRows::ByTimes, true);
        }
        if train.scale_cloud && self.model.branches == Branches::Both {
            let uniform = (init.dynamic_points as f64 * factor).round() as usize;
            init.dynamic_from_cloud += init.dynamic_points - uniform;
            init.dynamic_points = uniform;
            (init.dynamic_cloud_share, init.dynamic_cloud_colours) = (1.0, true);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::config::{Decay, Interval};

    #[test]
    fn every_iteration_count_shrinks_alike() {
        let mut config = Config::default();
        config.train.scale = 0.1;
        config.train.checkpoint_interval = Interval(5000);
        let scaled = config.scaled();
        assert_eq!(scaled.train.scale, 1.0);
        assert_eq!(
            (scaled.train.stages.geometry.0, scaled.train.stages.deformation.0, scaled.train.stages.refinement.0),
            (200, 300, 2000)
        );
        assert_eq!((scaled.train.dynamic_sh_interval.0, scaled.train.static_sh_interval.0), (20, 20));
        assert_eq!(scaled.train.checkpoint_interval.0, 500);
        assert_eq!((scaled.optim.decay_steps.0, scaled.motion.interval.0), (2000, 500));
        assert_eq!((scaled.densify.from.0, scaled.densify.until.0, scaled.densify.prune_from.0), (50, 1600, 50));
        assert_eq!((scaled.densify.prune_interval.0, scaled.densify.reset_interval.0), (60, 500));
    }

    #[test]
    fn opacities_are_reset_at_most_every_five_hundred_steps() {
        let mut config = Config::default();
        for (scale, interval) in [(0.02, 500), (0.5, 1000), (2.0, 4000)] {
            config.train.scale = scale;
            assert_eq!(config.scaled().densify.reset_interval.0, interval);
        }
        config.densify.reset_interval = Interval(80);
        assert_eq!(config.scaled().densify.reset_interval.0, 160);
        config.train.scale = 0.5;
        assert_eq!(config.scaled().densify.reset_interval.0, 80);
    }

    #[test]
    fn a_shorter_run_learns_faster_and_a_longer_one_no_slower() {
        let mut config = Config::default();
        config.train.scale = 0.04;
        let scaled = config.scaled().optim;
        assert_eq!((scaled.scale, scaled.grid.start), (0.025, 0.004));
        assert_eq!(scaled.opacity, config.optim.opacity);
        // Mask logits change by as much as in the full run.
        assert_eq!(scaled.mask_logits.start, config.optim.mask_logits.start * 25.0);
        config.train.scale_rates = 0.0;
        assert_eq!(config.scaled().optim.grid.start, config.optim.grid.start);
        config = Config::default();
        config.train.scale = 2.0;
        assert_eq!(config.scaled().optim.grid, config.optim.grid);
    }

    #[test]
    fn no_rate_of_a_shorter_run_falls_far() {
        let mut config = Config::default();
        (config.train.scale, config.train.scale_rates, config.train.scale_mask) = (0.04, 0.0, 0.0);
        let scaled = config.scaled().optim;
        assert_eq!((scaled.grid.end, scaled.dynamic_sh_rest), (8e-5, config.optim.dynamic_sh_rest));
        // A rising rate keeps its end.
        config.optim.mask_logits = Decay { start: 1e-4, end: 1e-2 };
        assert_eq!(config.scaled().optim.mask_logits, config.optim.mask_logits);
        config.train.scale_tail = 0.0;
        assert_eq!(config.scaled().optim.grid, config.optim.grid);
    }

    #[test]
    fn a_shorter_run_starts_on_known_points() {
        let mut config = Config::default();
        config.train.scale = 0.02;
        let init = config.scaled().init;
        assert_eq!((init.dynamic_points, init.dynamic_from_cloud), (200, 9900));
        assert!(init.dynamic_cloud_colours && init.dynamic_cloud_share == 1.0);
        config.model.branches = Branches::Dynamic;
        assert_eq!(config.scaled().init, config.init);
        (config.model.branches, config.train.scale_cloud) = (Branches::Both, false);
        assert_eq!(config.scaled().init, config.init);
    }

    #[test]
    fn gaussians_are_added_at_most_every_twenty_steps() {
        let mut config = Config::default();
        config.train.scale = 0.02;
        assert_eq!(config.scaled().densify.interval.0, 20);
    }

    #[test]
    fn scaling_twice_is_scaling_once() {
        let mut config = Config::default();
        config.train.scale = 0.05;
        assert_eq!(config.scaled().scaled(), config.scaled());
    }

    #[test]
    fn what_is_not_a_count_of_steps_stays() {
        let mut config = Config::default();
        (config.train.scale, config.train.scale_times) = (0.05, false);
        let scaled = config.scaled();
        assert_eq!(scaled.loss, config.loss);
        assert_eq!(scaled.model, config.model);
        assert_eq!(scaled.motion.samples, config.motion.samples);
        assert_eq!(scaled.train.batch_size, config.train.batch_size);
    }
}
