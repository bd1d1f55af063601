//! Which configurations can be trained at all.

use super::variants::Contradiction;
use super::{Branches, Config, FusionWeights, GridBoundsRule, StillRule};
use crate::ModelError;

fn refuse(bad: bool, key: &'static str, value: String, reason: &'static str) -> Result<(), ModelError> {
    match bad {
        true => Err(ModelError::Config { key, value, reason }),
        false => Ok(()),
    }
}

impl Config {
    /// Refuses what could only fail later, or silently do nothing.
    ///
    /// # Errors
    /// [`ModelError::Config`] naming the first bad key.
    pub fn check(&self) -> Result<(), ModelError> {
        let (train, model, motion) = (&self.train, &self.model, &self.motion);
        refuse(
            train.scale.is_nan() || train.scale <= 0.0,
            "train.scale",
            train.scale.to_string(),
            "give a number above 0; 1 is the full length",
        )?;
        for (key, exponent) in [("train.scale_rates", train.scale_rates), ("train.scale_mask", train.scale_mask)] {
            let advice = "give a power from 0 (rates stay) to 1 (rates grow as the run shrinks)";
            refuse(!(0.0..=1.0).contains(&exponent), key, exponent.to_string(), advice)?;
        }
        refuse(train.batch_size == 0, "train.batch_size", "0".into(), "a step needs at least one view")?;
        refuse(
            train.accumulation == 0,
            "train.accumulation",
            "0".into(),
            "give the steps to learn from at once; 1 or more",
        )?;
        refuse(
            train.log_interval == 0,
            "train.log_interval",
            "0".into(),
            "give the steps between log lines, at least 1",
        )?;
        refuse(
            !(0.0..=1.0).contains(&model.near_share),
            "model.near_share",
            model.near_share.to_string(),
            "give a share from 0 to 1",
        )?;
        refuse(model.width == 0, "model.width", "0".into(), "a network needs at least one unit")?;
        refuse(
            model.sh_degree > 3,
            "model.sh_degree",
            model.sh_degree.to_string(),
            "spherical harmonics go up to degree 3",
        )?;
        refuse(model.grid.features == 0, "model.grid.features", "0".into(), "a plane needs at least one feature")?;
        let resolution = format!("{:?}", model.grid.resolution);
        let coarse = model.grid.resolution.iter().any(|&cells| cells < 2);
        refuse(coarse, "model.grid.resolution", resolution, "every axis needs at least two cells")?;
        let multipliers = format!("{:?}", model.grid.multipliers);
        let none = model.grid.multipliers.is_empty() || model.grid.multipliers.contains(&0);
        refuse(none, "model.grid.multipliers", multipliers, "give at least one factor, each at least 1")?;
        let heads = motion.heads.to_string();
        let uneven = motion.heads == 0 || !motion.attention_width.is_multiple_of(motion.heads);
        refuse(uneven, "motion.heads", heads, "it must divide motion.attention_width")?;
        let width = motion.attention_width == 0;
        refuse(width, "motion.attention_width", "0".into(), "queries, keys and values need at least one column")?;
        refuse(motion.window == 0, "motion.window", "0".into(), "a neighbour is at least one frame away")?;
        refuse(motion.samples == 0, "motion.samples", "0".into(), "statistics need at least one sample")?;
        refuse(
            motion.interval == 0,
            "motion.interval",
            "0".into(),
            "give the steps between two measurements of motion, at least 1",
        )?;
        // Zeros alone are a choice as well: an intensity that tells nothing.
        let FusionWeights { position, scale, rotation } = motion.weights;
        for (key, weight) in [
            ("motion.weights.position", position),
            ("motion.weights.scale", scale),
            ("motion.weights.rotation", rotation),
        ] {
            let bad = !weight.is_finite() || weight < 0.0;
            refuse(bad, key, weight.to_string(), "give a number that is not below 0")?;
        }
        if let Some(Contradiction { key, value, reason }) = motion.contradiction() {
            return Err(ModelError::Config { key, value, reason });
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
        let still_below = motion.still_below.to_string();
        refuse(
            !(0.0..=1.0).contains(&motion.still_below),
            "motion.still_below",
            still_below,
            "give a share from 0 to 1",
        )?;
        refuse(motion.sample_stride == 0, "motion.sample_stride", "0".into(), "give 1 to evaluate every sample")?;
        let loss = &self.loss;
        for (key, above) in [("loss.static_above", loss.static_above), ("loss.dynamic_above", loss.dynamic_above)] {
            refuse(!(0.0..=1.0).contains(&above), key, above.to_string(), "give a share from 0 to 1")?;
        }
        let share = self.init.dynamic_cloud_share;
        refuse(
            !(0.0..=1.0).contains(&share),
            "init.dynamic_cloud_share",
            share.to_string(),
            "give a share from 0 to 1",
        )?;
        let relocate = self.densify.relocate;
        refuse(
            !(0.0..=1.0).contains(&relocate),
            "densify.relocate",
            relocate.to_string(),
            "give a share from 0 to 1; 0 prunes instead",
        )?;
        let downscale = self.scene.downscale;
        refuse(
            downscale.is_nan() || downscale < 1.0,
            "scene.downscale",
            downscale.to_string(),
            "pictures can be reduced, not enlarged; give 1 or more",
        )?;
        refuse(
            !(self.init.opacity > 0.0 && self.init.opacity < 1.0),
            "init.opacity",
            self.init.opacity.to_string(),
            "give a number between 0 and 1",
        )?;
        self.check_what_moves()?;
        self.check_lifetimes()
    }

    /// Points on what moves, and what else asks where that is.
    fn check_what_moves(&self) -> Result<(), ModelError> {
        let (init, most) = (&self.init, self.densify.dynamic.max_gaussians);
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
        )?;
        refuse(
            !init.motion_logit.is_finite(),
            "init.motion_logit",
            init.motion_logit.to_string(),
            "give a number; above 0 is in favour of the foreground",
        )?;
        let loss = &self.loss;
        for (key, weight) in [
            ("loss.mask_motion", loss.mask_motion),
            ("loss.mask_still", loss.mask_still),
            ("loss.static_opacity", loss.static_opacity),
            ("loss.dynamic_opacity", loss.dynamic_opacity),
            ("loss.still_opacity", loss.still_opacity),
            ("train.lonely_visits", self.train.lonely_visits),
        ] {
            let bad = !weight.is_finite() || weight < 0.0;
            refuse(bad, key, weight.to_string(), "give a number that is not below 0; 0 switches it off")?;
        }
        Ok(())
    }

    /// Durations at the start, births, and the rates at which lifetimes are learned.
    fn check_lifetimes(&self) -> Result<(), ModelError> {
        let (init, optim) = (&self.init, &self.optim);
        let is_positive = |value: f64| value.is_finite() && value > 0.0;
        for (key, duration) in
            [("init.motion_duration", init.motion_duration), ("init.photo_duration", init.photo_duration)]
        {
            refuse(!is_positive(duration), key, duration.to_string(), "a duration is a number above 0")?;
        }
        for (key, rate) in [("optim.time_centre", optim.time_centre), ("optim.duration", optim.duration)] {
            let bad = !rate.is_finite() || rate < 0.0;
            refuse(bad, key, rate.to_string(), "give a number that is not below 0; 0 leaves it as it starts")?;
        }
        for (key, rate) in [
            ("optim.velocity.start", optim.velocity.start),
            ("optim.velocity.end", optim.velocity.end),
            ("optim.exposure.start", optim.exposure.start),
            ("optim.exposure.end", optim.exposure.end),
        ] {
            refuse(!is_positive(rate), key, rate.to_string(), "a rate that falls log-linearly is a number above 0")?;
        }
        refuse(
            self.model.lifetime && self.motion.still != StillRule::Keep,
            "motion.still",
            format!("{:?}", self.motion.still),
            "motion is measured of the deformation alone, so what a lifetime moves would pass for still; keep it",
        )?;
        refuse(
            init.photo_points > 0 && !self.model.lifetime,
            "init.photo_points",
            init.photo_points.to_string(),
            "what only one photo shows must not be seen at other times; set `model.lifetime = true`, or 0 points",
        )?;
        let births = self.densify.births_interval;
        refuse(
            births > 0 && !self.model.lifetime,
            "densify.births_interval",
            births.to_string(),
            "what is born shows one moment and must not be seen at others; set `model.lifetime = true`, or 0",
        )
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// What a configuration with this interval and these weights is refused with.
    fn refusal(interval: usize, [position, scale, rotation]: [f64; 3]) -> Option<String> {
        let mut config = Config::default();
        config.motion.interval = interval;
        config.motion.weights = FusionWeights { position, scale, rotation };
        config.check().err().map(|error| error.to_string())
    }

    #[test]
    fn motion_is_measured_at_some_interval() {
        let said = refusal(0, [0.7, 0.2, 0.1]).expect("it is refused");
        assert!(said.starts_with("`motion.interval` is 0: give the steps"), "{said}");
        assert_eq!(refusal(1, [0.7, 0.2, 0.1]), None);
    }

    /// What a default configuration is refused with after a change.
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
    fn gaussians_of_one_photo_need_lifetimes() {
        let births =
            |lifetime| move |config: &mut Config| (config.init.photo_points, config.model.lifetime) = (1000, lifetime);
        assert_eq!(refusal_of(births(true)), None);
        let said = refusal_of(births(false)).expect("it is refused");
        assert!(said.starts_with("`init.photo_points` is 1000:") && said.contains("model.lifetime"), "{said}");
        let said = refusal_of(|config| config.densify.births_interval = 920).expect("it is refused");
        assert!(said.starts_with("`densify.births_interval` is 920:") && said.contains("model.lifetime"), "{said}");
    }

    #[test]
    fn numbers_of_seeds_and_lifetimes_are_in_range() {
        type Slot = fn(&mut Config) -> &mut f64;
        let above_0: [(&str, Slot); 6] = [
            ("init.motion_duration", |config| &mut config.init.motion_duration),
            ("init.photo_duration", |config| &mut config.init.photo_duration),
            ("optim.velocity.start", |config| &mut config.optim.velocity.start),
            ("optim.velocity.end", |config| &mut config.optim.velocity.end),
            ("optim.exposure.start", |config| &mut config.optim.exposure.start),
            ("optim.exposure.end", |config| &mut config.optim.exposure.end),
        ];
        let from_0: [(&str, Slot); 5] = [
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
