//! Keys that count steps, which `train.scale` multiplies.

use std::borrow::Cow;

use schemars::{JsonSchema, Schema, SchemaGenerator};
use serde::{Deserialize, Serialize};

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
        self.latest_within(1, step).is_some()
    }

    /// The step of the latest event at `step` or at one of the `steps - 1` before it, if there is one.
    pub fn latest_within(self, steps: usize, step: usize) -> Option<usize> {
        let latest = (self.0 > 0).then(|| step - step % self.0)?;
        (latest > step.saturating_sub(steps)).then_some(latest)
    }
}

/// Both are whole numbers in a file.
macro_rules! whole_number_in_schema {
    ($name:literal, $kind:ty $(, $parameter:ident)?) => {
        impl$(<const $parameter: usize>)? JsonSchema for $kind {
            fn inline_schema() -> bool {
                true
            }

            fn schema_name() -> Cow<'static, str> {
                $name.into()
            }

            fn json_schema(generator: &mut SchemaGenerator) -> Schema {
                usize::json_schema(generator)
            }
        }
    };
}

whole_number_in_schema!("Steps", Steps);
whole_number_in_schema!("Interval", Interval<LEAST>, LEAST);

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn an_event_between_two_looks_is_seen_once() {
        let due = |interval: Interval, every: usize| {
            let looks = (every..=1000).step_by(every);
            looks.filter_map(|step| Some((step, interval.latest_within(every, step)?))).collect::<Vec<_>>()
        };
        assert_eq!(due(Interval(25), 4)[..4], [(28, 25), (52, 50), (76, 75), (100, 100)]);
        assert_eq!(due(Interval(25), 4).len(), 40);
        assert_eq!(due(Interval(100), 4), due(Interval(100), 1));
        assert!(due(Interval(0), 4).is_empty());
        assert!((1..300).all(|step| Interval::<1>(100).is_due(step) == step.is_multiple_of(100)));
    }
}
