//! Validation of a configuration.

use super::contradiction::Contradiction;
use super::keys::{Key, Range};
use super::{Branches, Config, GridBoundsRule, StillRule, Trajectory};
use crate::ModelError;

/// Largest number of scales of the grid.
const MOST_SCALES: usize = 16;

fn refuse(bad: bool, key: &str, value: String, reason: &str) -> Result<(), ModelError> {
    match bad {
        true => Err(ModelError::Config { key: key.to_owned(), value, reason: reason.to_owned() }),
        false => Ok(()),
    }
}

impl Config {
    /// Rejects values that would fail later or silently have no effect.
    ///
    /// # Errors
    /// [`ModelError::Config`] with the first invalid key.
    pub fn check(&self) -> Result<(), ModelError> {
        // The ranges are next to the fields. The following checks concern several keys, or lists.
        Key::check(self, "", Range::ANY)?;
        if self.train.scale != 1.0 {
            Key::check(&self.scaled(), "", Range::ANY).map_err(|error| self.of_scale(error))?;
        }
        let (model, motion) = (&self.model, &self.motion);
        let multipliers = &model.grid.multipliers;
        refuse(
            multipliers.is_empty() || multipliers.len() > MOST_SCALES,
            "model.grid.multipliers",
            format!("{multipliers:?}"),
            "give at least one factor and at most 16",
        )?;
        refuse(
            !motion.attention_width.is_multiple_of(motion.heads),
            "motion.heads",
            motion.heads.to_string(),
            "it must divide `motion.attention_width`",
        )?;
        let optim = &self.optim;
        refuse(
            optim.beta2 < optim.beta1 * optim.beta1,
            "optim.beta2",
            optim.beta2.to_string(),
            "Adam diverges below the square of `optim.beta1`",
        )?;
        if let Some(Contradiction { key, value, reason }) = motion.contradiction() {
            refuse(true, key, value, reason)?;
        }
        let alone = model.branches == Branches::Dynamic && motion.still != StillRule::Keep;
        refuse(
            alone,
            "motion.still",
            format!("{:?}", motion.still),
            "what does not move needs a static branch to be in; keep it",
        )?;
        let static_ply = self.init.static_ply.as_ref().filter(|_| model.branches == Branches::Dynamic);
        refuse(
            static_ply.is_some(),
            "init.static_ply",
            static_ply.map_or(String::new(), |path| path.display().to_string()),
            "a model of one branch has no static one; use `init.dynamic_ply`",
        )?;
        self.check_what_moves()?;
        self.check_lifetimes()?;
        self.check_stages()
    }

    /// The error for a value that `train.scale` derives.
    fn of_scale(&self, error: ModelError) -> ModelError {
        match error {
            ModelError::Config { key, value, reason } => ModelError::Config {
                key,
                value,
                reason: format!("{reason}; it follows from `train.scale` = {}", self.train.scale),
            },
            other => other,
        }
    }

    /// Checks the keys that depend on detected motion.
    fn check_what_moves(&self) -> Result<(), ModelError> {
        let (init, most) = (&self.init, self.densify.dynamic.max_gaussians);
        let still = ("densify.static.max_gaussians", self.densify.static_.max_gaussians);
        let still = if self.model.branches == Branches::Both { still } else { ("densify.dynamic.max_gaussians", most) };
        for (key, points, (limit, most)) in [
            ("init.dynamic_points", init.dynamic_points, ("densify.dynamic.max_gaussians", most)),
            ("init.dynamic_from_cloud", init.dynamic_from_cloud, ("densify.dynamic.max_gaussians", most)),
            ("init.static_points", init.static_points, still),
            ("init.sky_points", init.sky_points, still),
        ] {
            refuse(points > most, key, points.to_string(), &format!("that is more than `{limit}` = {most}"))?;
        }
        refuse(
            init.motion_points > most,
            "init.motion_points",
            init.motion_points.to_string(),
            "that is more than `densify.dynamic.max_gaussians`; give a quarter to a half of that, so that there is room to \
             split",
        )?;
        refuse(
            self.model.grid.bounds == GridBoundsRule::Motion && init.motion_points == 0,
            "model.grid.bounds",
            "motion".into(),
            "nobody looks for what moves; give `init.motion_points` a number above 0, or let the grid span the \"cloud\"",
        )
    }

    /// Checks the keys that need or exclude lifetimes.
    fn check_lifetimes(&self) -> Result<(), ModelError> {
        let (has_lifetimes, photo_points) = (self.model.lifetime, self.init.photo_points);
        refuse(
            has_lifetimes && self.motion.still != StillRule::Keep,
            "motion.still",
            format!("{:?}", self.motion.still),
            "motion is measured of the deformation alone, so what a lifetime moves would pass for still; keep it",
        )?;
        refuse(
            self.motion.trajectory == Trajectory::Lifetime && !has_lifetimes,
            "motion.trajectory",
            "lifetime".into(),
            "Gaussians are always there; set `model.lifetime = true`, or leave this key at its default",
        )?;
        refuse(
            photo_points > 0 && !has_lifetimes,
            "init.photo_points",
            photo_points.to_string(),
            "what only one photo shows must not be seen at other times; set `model.lifetime = true`, or 0 points",
        )?;
        let births = self.densify.births_interval.0;
        refuse(
            births > 0 && !has_lifetimes,
            "densify.births_interval",
            births.to_string(),
            "what is born shows one moment and must not be seen at others; set `model.lifetime = true`, or 0",
        )
    }

    /// Checks the keys that need a stage.
    fn check_stages(&self) -> Result<(), ModelError> {
        let (stages, motion_power) = (&self.train.stages, self.densify.motion_power);
        let never_measured = !self.model.deformation || stages.refinement.0 == 0;
        for (is_set, key, value) in [
            (self.motion.still != StillRule::Keep, "motion.still", format!("{:?}", self.motion.still)),
            (self.loss.still_opacity > 0.0, "loss.still_opacity", self.loss.still_opacity.to_string()),
            (motion_power > 0.0, "densify.motion_power", motion_power.to_string()),
        ] {
            refuse(
                never_measured && is_set,
                key,
                value,
                "motion is measured from the end of the deformation stage on, and only of what deforms and if a \
                 refinement stage follows; give `train.stages.refinement` some steps and set `model.deformation = \
                 true`, or leave this key at its default",
            )?;
        }
        // A run that `train.scale` leaves without any step has no births either.
        refuse(
            self.init.photo_points > 0 && stages.geometry.0 == 0 && stages.total() > 0,
            "init.photo_points",
            self.init.photo_points.to_string(),
            "they are born at the end of the first stage; give `train.stages.geometry` some steps, or set 0 points",
        )
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::config::{FusionWeights, Interval, StageConfig};

    /// The error for a configuration with this interval and these weights.
    fn refusal(interval: usize, [position, scale, rotation]: [f64; 3]) -> Option<String> {
        let mut config = Config::default();
        config.motion.interval = Interval(interval);
        config.motion.weights = FusionWeights { position, scale, rotation };
        config.check().err().map(|error| error.to_string())
    }

    #[test]
    fn motion_is_measured_at_some_interval() {
        let said = refusal(0, [0.7, 0.2, 0.1]).expect("it is refused");
        assert!(said.starts_with("`motion.interval` is 0: give the steps"), "{said}");
        assert_eq!(refusal(1, [0.7, 0.2, 0.1]), None);
    }

    /// The error for a default configuration after a change.
    fn refusal_of(change: impl Fn(&mut Config)) -> Option<String> {
        let mut config = Config::default();
        change(&mut config);
        config.check().err().map(|error| error.to_string())
    }

    #[test]
    fn seeds_fit_into_their_branch_and_a_box_of_what_moves_needs_them() {
        let seeds = |count| move |config: &mut Config| config.init.motion_points = count;
        let most = Config::default().densify.dynamic.max_gaussians;
        assert_eq!(refusal_of(seeds(most)), None);
        let said = refusal_of(seeds(most + 1)).expect("it is refused");
        assert!(said.starts_with("`init.motion_points` is 90001: that is more than"), "{said}");

        let spans = |count| {
            move |config: &mut Config| {
                (config.model.grid.bounds, config.init.motion_points) = (GridBoundsRule::Motion, count)
            }
        };
        assert_eq!(refusal_of(spans(2000)), None);
        let said = refusal_of(spans(0)).expect("it is refused");
        assert!(said.starts_with("`model.grid.bounds` is motion: nobody looks for what moves"), "{said}");
    }

    #[test]
    fn points_that_no_branch_has_room_for_are_refused() {
        for (key, slot) in [
            ("init.dynamic_points", (|config| &mut config.init.dynamic_points) as fn(&mut Config) -> &mut usize),
            ("init.dynamic_from_cloud", |config| &mut config.init.dynamic_from_cloud),
            ("init.static_points", |config| &mut config.init.static_points),
            ("init.sky_points", |config| &mut config.init.sky_points),
        ] {
            let said = refusal_of(|config| *slot(config) = 960_001).expect("it is refused");
            assert!(said.starts_with(&format!("`{key}` is 960001: that is more than `densify.")), "{said}");
        }
        assert_eq!(refusal_of(|config| config.init.sky_points = 960_000), None);
    }

    #[test]
    fn moments_of_adam_that_diverge_are_refused() {
        let betas = |beta1, beta2| move |config: &mut Config| (config.optim.beta1, config.optim.beta2) = (beta1, beta2);
        assert_eq!(refusal_of(betas(0.9, 0.81)), None);
        assert_eq!(refusal_of(betas(0.0, 0.0)), None);
        let said = refusal_of(betas(0.9, 0.5)).expect("it is refused");
        assert!(said.starts_with("`optim.beta2` is 0.5: Adam diverges below the square of `optim.beta1`"), "{said}");
    }

    #[test]
    fn a_value_that_the_length_of_a_run_moves_out_of_its_range_is_refused() {
        let shortened = |scale| {
            move |config: &mut Config| {
                (config.train.scale, config.train.scale_rates, config.optim.scale) = (scale, 1.0, 0.5);
            }
        };
        assert_eq!(refusal_of(shortened(0.5)), None);
        let said = refusal_of(shortened(0.4)).expect("it is refused");
        assert!(
            said.starts_with("`optim.scale` is 1.25: give a rate") && said.contains("`train.scale` = 0.4"),
            "{said}"
        );
    }

    #[test]
    fn gaussians_of_one_photo_need_lifetimes() {
        let births =
            |lifetime| move |config: &mut Config| (config.init.photo_points, config.model.lifetime) = (1000, lifetime);
        assert_eq!(refusal_of(births(true)), None);
        let said = refusal_of(births(false)).expect("it is refused");
        assert!(said.starts_with("`init.photo_points` is 1000:") && said.contains("model.lifetime"), "{said}");
        let said = refusal_of(|config| config.densify.births_interval = Interval(920)).expect("it is refused");
        assert!(said.starts_with("`densify.births_interval` is 920:") && said.contains("model.lifetime"), "{said}");
    }

    #[test]
    fn what_follows_from_motion_needs_a_stage_that_measures_it_and_births_need_the_first_stage() {
        type Change = fn(&mut Config);
        let keys: [(&str, Change); 3] = [
            ("motion.still", |config| config.motion.still = StillRule::Prune),
            ("loss.still_opacity", |config| config.loss.still_opacity = 0.1),
            ("densify.motion_power", |config| config.densify.motion_power = 0.5),
        ];
        for (key, set) in keys {
            assert_eq!(refusal_of(set), None);
            let unmeasured: [Change; 2] =
                [|config| config.model.deformation = false, |config| config.train.stages.refinement.0 = 0];
            for change in unmeasured {
                let said = refusal_of(|config| {
                    set(config);
                    change(config);
                });
                assert!(said.is_some_and(|said| said.starts_with(&format!("`{key}` is "))), "{key}");
            }
        }
        let births = |stages| {
            move |config: &mut Config| {
                (config.init.photo_points, config.model.lifetime) = (1000, true);
                config.train.stages = StageConfig::of(stages);
            }
        };
        assert_eq!(refusal_of(births([1, 1, 1])), None);
        let said = refusal_of(births([0, 1, 1])).expect("it is refused");
        assert!(said.starts_with("`init.photo_points` is 1000:") && said.contains("train.stages.geometry"), "{said}");
    }

    #[test]
    fn numbers_of_seeds_and_lifetimes_are_in_range() {
        type Slot = fn(&mut Config) -> &mut f64;
        let above_0: [(&str, Slot); 4] = [
            ("init.motion_duration", |config| &mut config.init.motion_duration),
            ("init.photo_duration", |config| &mut config.init.photo_duration),
            // A rate that starts above 0 cannot decay to 0 log-linearly.
            ("optim.velocity.end", |config| &mut config.optim.velocity.end),
            ("optim.exposure.end", |config| &mut config.optim.exposure.end),
        ];
        let from_0: [(&str, Slot); 7] = [
            ("optim.velocity.start", |config| &mut config.optim.velocity.start),
            ("optim.exposure.start", |config| &mut config.optim.exposure.start),
            ("loss.mask_motion", |config| &mut config.loss.mask_motion),
            ("loss.still_opacity", |config| &mut config.loss.still_opacity),
            ("train.lonely_visits", |config| &mut config.train.lonely_visits),
            ("optim.time_centre", |config| &mut config.optim.time_centre),
            ("optim.duration", |config| &mut config.optim.duration),
        ];
        let refused = |key: &str, slot: Slot, bad: f64| {
            let said = refusal_of(|config| *slot(config) = bad).unwrap_or_default();
            assert!(said.starts_with(&format!("`{key}` is {bad}: ")), "{key} = {bad}: {said}");
        };
        for (key, slot) in above_0.into_iter().chain(from_0) {
            [-0.1, f64::NAN, f64::INFINITY].into_iter().for_each(|bad| refused(key, slot, bad));
            assert_eq!(refusal_of(|config| *slot(config) = 0.5), None, "{key}");
        }
        above_0.into_iter().for_each(|(key, slot)| refused(key, slot, 0.0));
        from_0.into_iter().for_each(|(key, slot)| assert_eq!(refusal_of(|config| *slot(config) = 0.0), None, "{key}"));
    }

    #[test]
    fn weights_of_the_intensity_are_numbers_not_below_zero() {
        for (key, place) in [("position", 0), ("scale", 1), ("rotation", 2)] {
            for bad in [-0.1, f64::NAN, f64::INFINITY] {
                let mut weights = [0.7, 0.2, 0.1];
                weights[place] = bad;
                let said = refusal(2000, weights).expect("it is refused");
                assert!(said.starts_with(&format!("`motion.weights.{key}` is {bad}: give a number")), "{said}");
            }
        }
        for good in [[1.0, 0.0, 0.0], [0.8, 0.0, 0.2], [0.8, 0.2, 0.0], [0.0; 3], [7.0, 2.0, 4.0]] {
            assert_eq!(refusal(2000, good), None, "{good:?}");
        }
    }
}
