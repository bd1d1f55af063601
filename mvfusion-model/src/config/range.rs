//! The valid values of a number.

/// The valid values of a number: a closed interval. Both ends are values with which a training computes finite numbers.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Range {
    /// The smallest valid value.
    pub least: f64,
    /// The largest valid value.
    pub most: f64,
    /// The remedy for an invalid value.
    advice: &'static str,
}

/// The largest number of steps, far beyond any run.
pub(super) const MOST_STEPS: f64 = 1e9;

/// The smallest number that counts as above 0. Single precision represents it and its reciprocal.
const LEAST_ABOVE_0: f64 = 1e-30;

impl Range {
    /// For tables and keys that are not numbers.
    pub const ANY: Self = Self { least: f64::NEG_INFINITY, most: f64::INFINITY, advice: "" };
    pub const SHARE: Self = Self { least: 0.0, most: 1.0, advice: "give a share" };
    /// The logarithm of odds; beyond its ends, a probability is 0 or 1 in single precision.
    pub const LOGIT: Self = Self { least: -30.0, most: 30.0, advice: "give a number" };
    pub const FROM_0: Self = Self { least: 0.0, most: 1e6, advice: "give a number that is not below 0" };
    pub const ABOVE_0: Self = Self { least: LEAST_ABOVE_0, most: 1e6, advice: "give a number above 0" };
    pub const FROM_1: Self = Self { least: 1.0, most: 1e6, advice: "give at least 1" };
    /// Numbers of Gaussians.
    pub const GAUSSIANS: Self = Self { least: 0.0, most: 1e8, advice: "give a number of Gaussians" };
    /// Numbers of steps, of which there may be none.
    pub const STEPS: Self = Self { least: 0.0, most: MOST_STEPS, advice: "give a number of steps" };
    /// Numbers of steps between two events.
    pub const INTERVAL: Self = Self { least: 1.0, most: MOST_STEPS, advice: "give a number of steps, at least 1" };
    /// Widths of layers.
    pub const WIDTH: Self = Self { least: 1.0, most: 4096.0, advice: "give at least 1" };
    /// Seeds, which TOML can represent.
    pub const SEED: Self =
        Self { least: 0.0, most: i64::MAX as f64, advice: "give a whole number that is not below 0" };
    /// Decays of Adam's moments. With an end nearer to 1, single precision could not tell it from 1.
    pub const DECAY: Self = Self { least: 0.0, most: 0.999_99, advice: "give a number from 0 to below 1" };
    /// Loss weights. With a larger one, the squares of gradients overflow single precision.
    pub const WEIGHT: Self =
        Self { least: 0.0, most: 1e6, advice: "give a number that is not below 0; 0 switches it off" };
    /// Learning rates. With a larger one, Gaussians outgrow single precision in less than a hundred steps.
    pub const RATE: Self = Self {
        least: 0.0,
        most: 1.0,
        advice: "give a rate in this range; 0 leaves the parameters as they start, and a small train.scale raises it",
    };

    /// The same values with different advice.
    pub const fn saying(self, advice: &'static str) -> Self {
        Self { advice, ..self }
    }

    /// The same with another smallest value.
    pub const fn from(self, least: f64) -> Self {
        Self { least, ..self }
    }

    /// The same with another largest value.
    pub const fn to(self, most: f64) -> Self {
        Self { most, ..self }
    }

    /// Whether a value is valid. Written so that NaN is not.
    pub fn fits(&self, value: f64) -> bool {
        self.least <= value && value <= self.most
    }

    /// The remedy for an invalid value, with the valid ones.
    pub fn reason(&self) -> String {
        format!("{} (from {} to {})", self.advice, written(self.least), written(self.most))
    }
}

/// A number as people write it.
pub(super) fn written(value: f64) -> String {
    // The largest integer of TOML, which no floating-point number is.
    if value == i64::MAX as f64 {
        return i64::MAX.to_string();
    }
    let is_short = value == 0.0 || (1e-4..1e7).contains(&value.abs());
    if is_short || !value.is_finite() { value.to_string() } else { format!("{value:e}") }
}
