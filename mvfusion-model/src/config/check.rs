//! Validation of a configuration.

use super::contradiction::Contradiction;
use super::keys::{Key, Range};
use super::{Branches, Config, GridBoundsRule, Spread, StillRule, Trajectory};
use crate::ModelError;

/// Largest number of scales of the grid.
const MOST_SCALES: usize = 16;

/// Why nothing is found or born with `model.branches = "dynamic"`.
const NO_STATIC_BRANCH: &str = "nobody looks for what moves or is missing in a model of one branch";

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
        self.check_with_scale(|config| {
            config.check_one_branch()?;
            config.check_stillness()?;
            if let Some(Contradiction { key, value, reason }) = config.motion.idle_switch() {
                refuse(true, key, value, reason)?;
            }
            config.check_values()?;
            config.check_stages()
        })
    }

    /// As [`Config::check`], for the configuration of a run that exists. Former versions accepted keys without an effect,
    /// and their runs can still be opened and resumed.
    ///
    /// # Errors
    /// As [`Config::check`].
    pub fn check_of_run(&self) -> Result<(), ModelError> {
        self.check_with_scale(Self::check_values)
    }

    /// Rejects a configuration whose `train.scale` was not applied yet: its steps, and whatever follows from them, are
    /// not those of the run.
    ///
    /// # Errors
    /// [`ModelError::Config`] if `train.scale` is not 1.
    pub(crate) fn check_scaled(&self) -> Result<(), ModelError> {
        let scale = self.train.scale;
        refuse(
            scale != 1.0,
            "train.scale",
            scale.to_string(),
            "the numbers of steps are taken as they are; give the result of `Config::scaled`",
        )
    }

    /// Checks the values as they are, and what `train.scale` makes of them.
    fn check_with_scale(&self, check: impl Fn(&Self) -> Result<(), ModelError>) -> Result<(), ModelError> {
        check(self)?;
        match self.train.scale {
            1.0 => Ok(()),
            _ => check(&self.scaled()).map_err(|error| self.of_scale(error)),
        }
    }

    /// Refuses the values that no version trains with.
    fn check_values(&self) -> Result<(), ModelError> {
        // The ranges are next to the fields. The following checks concern several keys, or lists.
        Key::check(self, "", Range::ANY)?;
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
        self.check_lifetimes()
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

    /// Checks the keys that have no effect in a model of one branch, whose Gaussians show everything from the start.
    fn check_one_branch(&self) -> Result<(), ModelError> {
        let alone = self.model.branches == Branches::Dynamic;
        let counts = [
            ("init.motion_points", self.init.motion_points),
            ("init.photo_points", self.init.photo_points),
            ("densify.births_interval", self.densify.births_interval.0),
        ];
        for (key, count) in counts {
            refuse(alone && count > 0, key, count.to_string(), &format!("{NO_STATIC_BRANCH}; set 0"))?;
        }
        let bounds = alone && self.model.grid.bounds == GridBoundsRule::Motion;
        refuse(bounds, "model.grid.bounds", "motion".into(), &format!("{NO_STATIC_BRANCH}; let it span the \"cloud\""))
    }

    /// Checks that every Gaussian has an intensity, and that it has the unit of what `MotionCache::stillness` adds to it, a
    /// variance in square extents.
    fn check_stillness(&self) -> Result<(), ModelError> {
        let adds_travel = self.model.lifetime && self.motion.trajectory == Trajectory::Deformation;
        let has_its_unit = self.motion.in_extents && self.motion.spread == Spread::Variance;
        refuse(
            self.loss.still_opacity > 0.0 && !self.motion.inherit,
            "loss.still_opacity",
            self.loss.still_opacity.to_string(),
            "without `motion.inherit`, a new Gaussian has no motion intensity and would count as still until the next \
             measurement; set `motion.inherit = true`",
        )?;
        refuse(
            self.loss.still_opacity > 0.0 && adds_travel && !has_its_unit,
            "loss.still_opacity",
            self.loss.still_opacity.to_string(),
            "with lifetimes, the variance of their travel is added to the intensity, which has another unit; set \
             `motion.in_extents = true` and `motion.spread = \"variance\"`, or `motion.trajectory = \"lifetime\"`",
        )
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
            match self.motion.trajectory {
                Trajectory::Deformation => {
                    "motion is measured of the deformation alone, so what lifetimes move would pass for still; keep it"
                }
                Trajectory::Lifetime => {
                    "motion is measured while a Gaussian is there, so a brief one would pass for still; keep it"
                }
            },
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
mod tests;
