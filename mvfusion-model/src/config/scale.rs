//! Shortening a run without changing its shape.

use super::Config;

/// Densification never happens more often than this, however short the run: the statistics need some views.
const MIN_DENSIFY_INTERVAL: usize = 20;

impl Config {
    /// The configuration with every iteration count multiplied by `train.scale`, which becomes 1.
    ///
    /// Stage lengths, learning-rate horizons, spherical-harmonics steps, the refresh interval `E`, and the intervals and
    /// ends of densification, pruning and resets all shrink alike; an interval is at least 1, and Gaussians are added
    /// at most every 20 steps.
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

        scaled.optim.decay_steps = interval(scaled.optim.decay_steps);
        scaled.motion.interval = interval(scaled.motion.interval);

        let densify = &mut scaled.densify;
        densify.from = count(densify.from);
        densify.until = count(densify.until);
        densify.prune_from = count(densify.prune_from);
        // A run at full length keeps its own interval, even a shorter one: the floor is for shortened runs.
        densify.interval = interval(densify.interval).max(MIN_DENSIFY_INTERVAL.min(densify.interval));
        densify.prune_interval = interval(densify.prune_interval).max(MIN_DENSIFY_INTERVAL.min(densify.prune_interval));
        densify.reset_interval = interval(densify.reset_interval);
        scaled
    }
}

#[cfg(test)]
mod tests {
    use super::*;

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
        assert_eq!((scaled.optim.decay_steps, scaled.motion.interval), (2000, 200));
        assert_eq!((scaled.densify.from, scaled.densify.until, scaled.densify.prune_from), (50, 1600, 50));
        assert_eq!((scaled.densify.prune_interval, scaled.densify.reset_interval), (60, 200));
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
