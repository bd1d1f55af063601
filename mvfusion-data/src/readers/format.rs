//! The names of a format.

use serde::{Serialize, Serializer};

/// The format of a scene's folder. Each reader declares its own as a constant here, and [`Format::ALL`] lists them.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Format {
    key: &'static str,
    name: &'static str,
}

impl Format {
    /// The format of a reader, by its key and its name.
    pub(super) const fn new(key: &'static str, name: &'static str) -> Self {
        Self { key, name }
    }

    /// Name in configurations and on the command line.
    pub const fn key(self) -> &'static str {
        self.key
    }

    /// Name in messages.
    pub const fn name(self) -> &'static str {
        self.name
    }
}

impl Serialize for Format {
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        serializer.serialize_str(self.key)
    }
}
