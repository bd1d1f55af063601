//! Properties of a config key: whether it counts steps, and its range.
//!
//! Each struct of the configuration lists its keys in [`keys!`], with a [`Range`] for each. A missing key is a compile
//! error.

use std::path::PathBuf;

use super::{Interval, Steps};
use crate::ModelError;

pub(super) use super::range::Range;

/// The kind of a number of the configuration.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum NumberKind {
    /// A real number.
    Real,
    /// A whole number.
    Whole,
    /// A list of whole numbers, each within the range.
    List,
}

/// A number of the configuration, with its valid values.
#[derive(Clone, Debug, PartialEq)]
pub struct NumericKey {
    /// The dotted key.
    pub key: String,
    /// Its kind.
    pub kind: NumberKind,
    /// The smallest valid value.
    pub least: f64,
    /// The largest valid value; infinite if there is none.
    pub most: f64,
}

/// A key in the order of the declarations.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct ListedKey {
    /// The dotted key.
    pub key: String,
    /// The number that it holds, if any.
    pub number: Option<NumericKey>,
    /// If `train.scale` multiplies it: the value below which it does not make it fall.
    pub scaled_from: Option<usize>,
}

impl ListedKey {
    /// A key that is no number.
    pub fn other(key: &str) -> Self {
        Self { key: key.to_owned(), number: None, scaled_from: None }
    }

    fn number(key: &str, kind: NumberKind, Range { least, most, .. }: Range) -> Self {
        let key = key.to_owned();
        Self { key: key.clone(), number: Some(NumericKey { key, kind, least, most }), scaled_from: None }
    }

    fn steps(key: &str, range: Range, scaled_from: usize) -> Self {
        Self { scaled_from: Some(scaled_from), ..Self::number(key, NumberKind::Whole, range) }
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

    /// Appends the key, and those in it, in the order of the declarations.
    fn list(&self, key: &str, _range: Range, listed: &mut Vec<ListedKey>) {
        listed.push(ListedKey::other(key));
    }
}

/// Rejects a number out of range; `written` is the number as given.
fn check(key: &str, value: f64, written: impl ToString, range: Range) -> Result<(), ModelError> {
    match range.fits(value) {
        true => Ok(()),
        false => Err(ModelError::Config { key: key.to_owned(), value: written.to_string(), reason: range.reason() }),
    }
}

impl Key for f64 {
    fn check(&self, key: &str, range: Range) -> Result<(), ModelError> {
        check(key, *self, self, range)
    }

    fn list(&self, key: &str, range: Range, listed: &mut Vec<ListedKey>) {
        listed.push(ListedKey::number(key, NumberKind::Real, range));
    }
}

impl Key for usize {
    fn check(&self, key: &str, range: Range) -> Result<(), ModelError> {
        check(key, *self as f64, self, range)
    }

    fn list(&self, key: &str, range: Range, listed: &mut Vec<ListedKey>) {
        listed.push(ListedKey::number(key, NumberKind::Whole, range));
    }
}

impl Key for u64 {
    fn check(&self, key: &str, range: Range) -> Result<(), ModelError> {
        check(key, *self as f64, self, range)
    }

    fn list(&self, key: &str, range: Range, listed: &mut Vec<ListedKey>) {
        listed.push(ListedKey::number(key, NumberKind::Whole, range));
    }
}

impl Key for Vec<usize> {
    fn check(&self, key: &str, range: Range) -> Result<(), ModelError> {
        self.iter().try_for_each(|&item| check(key, item as f64, format!("{self:?}"), range))
    }

    fn list(&self, key: &str, range: Range, listed: &mut Vec<ListedKey>) {
        listed.push(ListedKey::number(key, NumberKind::List, range));
    }
}

impl Key for [usize; 4] {
    fn check(&self, key: &str, range: Range) -> Result<(), ModelError> {
        self.to_vec().check(key, range)
    }

    fn list(&self, key: &str, range: Range, listed: &mut Vec<ListedKey>) {
        listed.push(ListedKey::number(key, NumberKind::List, range));
    }
}

impl Key for Steps {
    fn scale_steps(&mut self, factor: f64) {
        self.0 = (self.0 as f64 * factor).round() as usize;
    }

    fn check(&self, key: &str, range: Range) -> Result<(), ModelError> {
        self.0.check(key, range)
    }

    fn list(&self, key: &str, range: Range, listed: &mut Vec<ListedKey>) {
        listed.push(ListedKey::steps(key, range, 0));
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

    fn list(&self, key: &str, range: Range, listed: &mut Vec<ListedKey>) {
        listed.push(ListedKey::steps(key, range, LEAST));
    }
}

/// Values without a range.
macro_rules! leaves {
    ($($leaf:ty),* $(,)?) => { $(impl $crate::config::keys::Key for $leaf {})* };
}

/// The keys of a struct of the configuration, each with its range. An unlisted field is a compile error.
macro_rules! keys {
    ($config:ty { $($field:ident: $range:ident $(. $change:ident($($value:expr),*))*),* $(,)? }) => {
        impl $crate::config::keys::Key for $config {
            fn scale_steps(&mut self, factor: f64) {
                let Self { $($field),* } = self;
                $($crate::config::keys::Key::scale_steps($field, factor);)*
            }

            fn check(&self, table: &str, _: $crate::config::keys::Range) -> Result<(), $crate::ModelError> {
                use $crate::config::keys::{Key, Range, dotted};
                let Self { $($field),* } = self;
                $(Key::check($field, &dotted(table, stringify!($field)), Range::$range $(.$change($($value),*))*)?;)*
                Ok(())
            }

            fn list(
                &self,
                table: &str,
                _: $crate::config::keys::Range,
                listed: &mut Vec<$crate::config::keys::ListedKey>,
            ) {
                use $crate::config::keys::{Key, ListedKey, Range, dotted};
                listed.push(ListedKey::other(table));
                let Self { $($field),* } = self;
                $(Key::list(
                    $field,
                    &dotted(table, stringify!($field)),
                    Range::$range $(.$change($($value),*))*,
                    listed,
                );)*
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

leaves!(bool, String, PathBuf);

impl<T> Key for Option<T> {}

#[cfg(test)]
mod tests {
    use super::super::range::MOST_STEPS;
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

    keys!(Added { begin: STEPS, every: STEPS, share: SHARE, inner: ANY });
    keys!(Inner { end: INTERVAL.saying("it has to end").to(100.0), name: ANY });

    fn added() -> Added {
        let inner = Inner { end: Steps(100), name: "any".to_owned() };
        Added { begin: Steps(40), every: Interval(300), share: 0.5, inner }
    }

    #[test]
    fn a_key_that_counts_steps_is_scaled_wherever_it_stands() {
        let mut added = added();
        added.scale_steps(0.01);
        assert_eq!((added.begin, added.every, added.inner.end), (Steps(0), Interval(20), Steps(1)));
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
            Some("`table.share` is 1.5: give a share (from 0 to 1).")
        );
        let said = refusal(|added| added.inner.end = Steps(0));
        assert_eq!(said.as_deref(), Some("`table.inner.end` is 0: it has to end (from 1 to 100)."));
        assert!(refusal(|added| added.share = f64::NAN).is_some());
    }

    #[test]
    fn every_number_is_listed_with_its_range() {
        let mut listed = Vec::new();
        added().list("table", Range::ANY, &mut listed);
        let keys: Vec<&str> = listed.iter().map(|listed| listed.key.as_str()).collect();
        let inner = ["table.inner", "table.inner.end", "table.inner.name"];
        assert_eq!(keys, [&["table", "table.begin", "table.every", "table.share"], &inner[..]].concat());
        let scaled: Vec<_> = listed.iter().filter_map(|listed| listed.scaled_from).collect();
        assert_eq!(scaled, [0, 20, 0]);
        let numbers: Vec<_> = listed.into_iter().filter_map(|listed| listed.number).collect();
        let of = |(key, kind, most): (&str, NumberKind, f64)| {
            let least = if key == "table.inner.end" { 1.0 } else { 0.0 };
            NumericKey { key: key.to_owned(), kind, least, most }
        };
        let expected = [
            ("table.begin", NumberKind::Whole, MOST_STEPS),
            ("table.every", NumberKind::Whole, MOST_STEPS),
            ("table.share", NumberKind::Real, 1.0),
            ("table.inner.end", NumberKind::Whole, 100.0),
        ];
        assert_eq!(numbers, expected.map(of));
    }
}
