//! Shortening a run without changing its shape.

use super::{Branches, Config};

/// Opacities are never reset more often than this, however short the run: at 3DGS' rate it takes a hundred steps before a
/// Gaussian that is needed is opaque again.
const MIN_RESET_INTERVAL: usize = 500;

/// Motion is never measured more often than this, however short the run: the descriptors of a motion that is still being
/// learned change by more than their encoding's period, so that each measurement throws the refined deformation back.
const MIN_MEASURING_INTERVAL: usize = 500;

/// Densification never happens more often than this, however short the run: the statistics need some views.
const MIN_DENSIFY_INTERVAL: usize = 20;

impl Config {
    /// The configuration with every iteration count multiplied by `train.scale`, which becomes 1.
    ///
    /// Stage lengths, learning-rate horizons, spherical-harmonics steps, the refresh interval `E`, and the intervals and
    /// ends of densification, pruning and resets all shrink alike; an interval is at least 1, Gaussians are added at most
    /// every 20 steps, and motion is measured and opacities are reset at most every 500. A run that is shortened also
    /// learns faster and starts closer, as the keys `train.scale_*` say. `train.scale_times` is not among them: it needs
    /// the scene, see [`Config::for_times_of`].
    pub fn scaled(&self) -> Self {
        let mut scaled = self.clone();
        let factor = self.train.scale;
        let count = |steps: usize| (steps as f64 * factor).round() as usize;
        let interval = |steps: usize| count(steps).max(1);

        let train = &mut scaled.train;
        train.scale = 1.0;
        train.stages.geometry = count(train.stages.geometry);
        train.stages.deformation = count(train.stages.deformation);
        train.stages.refinement = count(train.stages.refinement);
        train.dynamic_sh_interval = interval(train.dynamic_sh_interval);
        train.static_sh_interval = interval(train.static_sh_interval);
        train.checkpoint_interval = count(train.checkpoint_interval);

        if factor < 1.0 {
            scaled.adapt_to_few_steps(factor);
        }
        scaled.optim.decay_steps = interval(scaled.optim.decay_steps);
        let motion = &mut scaled.motion;
        motion.interval = interval(motion.interval).max(MIN_MEASURING_INTERVAL.min(motion.interval));

        let densify = &mut scaled.densify;
        densify.from = count(densify.from);
        densify.until = count(densify.until);
        densify.prune_from = count(densify.prune_from);
        // A run at full length keeps its own interval, even a shorter one: the floor is for shortened runs.
        densify.interval = interval(densify.interval).max(MIN_DENSIFY_INTERVAL.min(densify.interval));
        densify.prune_interval = interval(densify.prune_interval).max(MIN_DENSIFY_INTERVAL.min(densify.prune_interval));
        densify.births_interval = match densify.births_interval {
            0 => 0,
            births => interval(births).max(MIN_DENSIFY_INTERVAL.min(births)),
        };
        densify.reset_interval = interval(densify.reset_interval).max(MIN_RESET_INTERVAL.min(densify.reset_interval));
        scaled
    }

    /// What makes up for steps that a run shortened by `factor` has not.
    fn adapt_to_few_steps(&mut self, factor: f64) {
        let (train, init) = (&self.train, &mut self.init);
        self.optim.faster(factor.powf(-train.scale_rates), factor.powf(-train.scale_mask));
        self.optim.end_above(train.scale_tail);
        self.motion.octaves = self.motion.octaves.min(train.scale_octaves);
        if train.scale_cloud && self.model.branches == Branches::Both {
            let strewn = (init.dynamic_points as f64 * factor).round() as usize;
            init.dynamic_from_cloud += init.dynamic_points - strewn;
            init.dynamic_points = strewn;
            (init.dynamic_cloud_share, init.dynamic_cloud_colours) = (1.0, true);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::config::Decay;

    #[test]
    fn every_iteration_count_shrinks_alike() {
        let mut config = Config::default();
        config.train.scale = 0.1;
        config.train.checkpoint_interval = 5000;
        let scaled = config.scaled();
        assert_eq!(scaled.train.scale, 1.0);
        assert_eq!(
            (scaled.train.stages.geometry, scaled.train.stages.deformation, scaled.train.stages.refinement),
            (200, 300, 2000)
        );
        assert_eq!((scaled.train.dynamic_sh_interval, scaled.train.static_sh_interval), (20, 20));
        assert_eq!(scaled.train.checkpoint_interval, 500);
        assert_eq!((scaled.optim.decay_steps, scaled.motion.interval), (2000, 500));
        assert_eq!((scaled.densify.from, scaled.densify.until, scaled.densify.prune_from), (50, 1600, 50));
        assert_eq!((scaled.densify.prune_interval, scaled.densify.reset_interval), (60, 500));
    }

    #[test]
    fn opacities_are_reset_at_most_every_five_hundred_steps() {
        let mut config = Config::default();
        for (scale, interval) in [(0.02, 500), (0.5, 1000), (2.0, 4000)] {
            config.train.scale = scale;
            assert_eq!(config.scaled().densify.reset_interval, interval);
        }
        config.densify.reset_interval = 80;
        assert_eq!(config.scaled().densify.reset_interval, 160);
        config.train.scale = 0.5;
        assert_eq!(config.scaled().densify.reset_interval, 80);
    }

    #[test]
    fn a_shorter_run_learns_faster_and_a_longer_one_no_slower() {
        let mut config = Config::default();
        config.train.scale = 0.04;
        let scaled = config.scaled().optim;
        assert_eq!((scaled.scale, scaled.grid.start), (0.025, 0.004));
        assert_eq!(scaled.opacity, config.optim.opacity);
        // Mask logits go as far as in the full run.
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
        // One that rises ends where it did.
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
        assert_eq!(config.scaled().densify.interval, 20);
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
        config.train.scale = 0.05;
        let scaled = config.scaled();
        assert_eq!(scaled.loss, config.loss);
        assert_eq!(scaled.model, config.model);
        assert_eq!(scaled.motion.samples, config.motion.samples);
        assert_eq!(scaled.train.batch_size, config.train.batch_size);
    }
}
