//! Properties of a config key: whether it counts steps, and its range.
//!
//! Each struct of the configuration lists its keys in [`keys!`], with a [`Range`] for each. A missing key is a compile
//! error.

use std::path::PathBuf;

use serde::{Deserialize, Serialize};

use crate::ModelError;

/// A number of optimiser steps, or the step at which something starts or ends.
/// [`Config::scaled`](super::Config::scaled) multiplies it by `train.scale`.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, PartialOrd, Ord, Serialize, Deserialize)]
#[serde(transparent)]
pub struct Steps(pub usize);

/// Optimiser steps from one event to the next; 0 means no events. [`Config::scaled`](super::Config::scaled) multiplies
/// it by `train.scale`, but never makes it shorter than `LEAST`, unless it is shorter already.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, PartialOrd, Ord, Serialize, Deserialize)]
#[serde(transparent)]
pub struct Interval<const LEAST: usize = 1>(pub usize);

impl<const LEAST: usize> Interval<LEAST> {
    /// Whether the event happens at `step`, counted from 1.
    pub fn is_due(self, step: usize) -> bool {
        self.0 > 0 && step.is_multiple_of(self.0)
    }
}

/// The valid values of a number.
#[derive(Clone, Copy, Debug)]
pub(super) struct Range {
    /// Whether a value is valid.
    pub fits: fn(f64) -> bool,
    /// The remedy for an invalid value.
    pub advice: &'static str,
}

impl Range {
    /// Any value, for keys that are not numbers and for numbers with bounds from other keys.
    pub const ANY: Self = Self { fits: |_| true, advice: "" };
    pub const FINITE: Self = Self { fits: f64::is_finite, advice: "give a number" };
    pub const FROM_0: Self =
        Self { fits: |value| value.is_finite() && value >= 0.0, advice: "give a number that is not below 0" };
    pub const ABOVE_0: Self = Self { fits: |value| value.is_finite() && value > 0.0, advice: "give a number above 0" };
    pub const FROM_1: Self = Self { fits: |value| value.is_finite() && value >= 1.0, advice: "give at least 1" };
    pub const SHARE: Self = Self { fits: |value| (0.0..=1.0).contains(&value), advice: "give a share from 0 to 1" };
    pub const INSIDE_0_1: Self =
        Self { fits: |value| value > 0.0 && value < 1.0, advice: "give a number between 0 and 1" };
    pub const FROM_0_OR_WITHOUT_END: Self =
        Self { fits: |value| value >= 0.0, advice: "give a number that is not below 0; inf is without a bound" };
    pub const BELOW_1: Self =
        Self { fits: |value| (0.0..1.0).contains(&value), advice: "give a number from 0 to below 1" };
    /// Loss weights.
    pub const WEIGHT: Self = Self { advice: "give a number that is not below 0; 0 switches it off", ..Self::FROM_0 };
    /// Learning rates.
    pub const RATE: Self =
        Self { advice: "give a rate that is not below 0; 0 leaves the parameters as they start", ..Self::FROM_0 };

    /// The same values with different advice.
    pub const fn saying(self, advice: &'static str) -> Self {
        Self { advice, ..self }
    }
}

/// A value of the configuration, or a table of values.
pub(super) trait Key {
    /// Multiplies every step count in it by `factor`.
    fn scale_steps(&mut self, _factor: f64) {}

    /// Rejects the first number that is out of range. `key` is the dotted name.
    fn check(&self, _key: &str, _range: Range) -> Result<(), ModelError> {
        Ok(())
    }
}

/// Rejects a number out of range; `written` is the number as given.
fn check(key: &str, value: f64, written: impl ToString, range: Range) -> Result<(), ModelError> {
    match (range.fits)(value) {
        true => Ok(()),
        false => {
            Err(ModelError::Config { key: key.to_owned(), value: written.to_string(), reason: range.advice.to_owned() })
        }
    }
}

impl Key for f64 {
    fn check(&self, key: &str, range: Range) -> Result<(), ModelError> {
        check(key, *self, self, range)
    }
}

impl Key for usize {
    fn check(&self, key: &str, range: Range) -> Result<(), ModelError> {
        check(key, *self as f64, self, range)
    }
}

impl Key for Steps {
    fn scale_steps(&mut self, factor: f64) {
        self.0 = (self.0 as f64 * factor).round() as usize;
    }

    fn check(&self, key: &str, range: Range) -> Result<(), ModelError> {
        self.0.check(key, range)
    }
}

impl<const LEAST: usize> Key for Interval<LEAST> {
    fn scale_steps(&mut self, factor: f64) {
        let scaled = (self.0 as f64 * factor).round() as usize;
        self.0 = scaled.max(LEAST.min(self.0));
    }

    fn check(&self, key: &str, range: Range) -> Result<(), ModelError> {
        self.0.check(key, range)
    }
}

/// Values without a range.
macro_rules! leaves {
    ($($leaf:ty),* $(,)?) => { $(impl $crate::config::keys::Key for $leaf {})* };
}

/// The keys of a struct of the configuration, each with its range. An unlisted field is a compile error.
macro_rules! keys {
    ($config:ty { $($field:ident: $range:ident $(. saying($advice:literal))?),* $(,)? }) => {
        impl $crate::config::keys::Key for $config {
            fn scale_steps(&mut self, factor: f64) {
                let Self { $($field),* } = self;
                $($crate::config::keys::Key::scale_steps($field, factor);)*
            }

            fn check(&self, table: &str, _: $crate::config::keys::Range) -> Result<(), $crate::ModelError> {
                use $crate::config::keys::{Key, Range, dotted};
                let Self { $($field),* } = self;
                $(Key::check($field, &dotted(table, stringify!($field)), Range::$range $(.saying($advice))?)?;)*
                Ok(())
            }
        }
    };
}

pub(super) use {keys, leaves};

/// The dotted name of a field of a table.
pub(super) fn dotted(table: &str, field: &str) -> String {
    // `static` is a keyword.
    let field = field.trim_end_matches('_');
    if table.is_empty() { field.to_owned() } else { format!("{table}.{field}") }
}

leaves!(bool, u64, String, PathBuf, Vec<usize>, [usize; 4]);

impl<T> Key for Option<T> {}

#[cfg(test)]
mod tests {
    use super::*;

    /// A new table with a key that counts steps.
    struct Added {
        begin: Steps,
        every: Interval<20>,
        share: f64,
        inner: Inner,
    }

    struct Inner {
        end: Steps,
        name: String,
    }

    keys!(Added { begin: ANY, every: ANY, share: SHARE, inner: ANY });
    keys!(Inner { end: FROM_1.saying("it has to end"), name: ANY });

    fn added() -> Added {
        let inner = Inner { end: Steps(5000), name: "any".to_owned() };
        Added { begin: Steps(40), every: Interval(300), share: 0.5, inner }
    }

    #[test]
    fn a_key_that_counts_steps_is_scaled_wherever_it_stands() {
        let mut added = added();
        added.scale_steps(0.01);
        assert_eq!((added.begin, added.every, added.inner.end), (Steps(0), Interval(20), Steps(50)));
        assert_eq!((added.share, added.inner.name.as_str()), (0.5, "any"));
        added.every = Interval(7);
        added.scale_steps(0.01);
        assert_eq!(added.every, Interval(7), "a shorter one than the floor stays");
        added.every = Interval(0);
        added.scale_steps(0.01);
        assert!(added.every == Interval(0) && !added.every.is_due(0), "what never happens goes on not to happen");
    }

    #[test]
    fn a_number_out_of_range_is_refused_by_its_name() {
        let refusal = |change: fn(&mut Added)| {
            let mut added = added();
            change(&mut added);
            added.check("table", Range::ANY).err().map(|error| error.to_string())
        };
        assert_eq!(refusal(|_| ()), None);
        assert_eq!(
            refusal(|added| added.share = 1.5).as_deref(),
            Some("`table.share` is 1.5: give a share from 0 to 1.")
        );
        let said = refusal(|added| added.inner.end = Steps(0));
        assert_eq!(said.as_deref(), Some("`table.inner.end` is 0: it has to end."));
    }
}
