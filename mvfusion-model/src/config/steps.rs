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
        self.0 > 0 && step.is_multiple_of(self.0)
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
