//! The table of readers: a line for each format.

use std::borrow::Cow;

use schemars::{JsonSchema, Schema, SchemaGenerator, json_schema};
use serde::de::Error;
use serde::{Deserialize, Deserializer};

use super::format::Format;
use super::reader::Reader;

/// All readers, in the order in which they are tried (METHOD §5.0, then the formats that DeGauss does not support).
pub(crate) const READERS: &[Reader] = &[
    super::colmap::READER,
    super::dnerf::READER,
    super::neu3d::READER,
    super::hypernerf::READER,
    super::panoptic::READER,
    super::multipleview::READER,
    super::onthego::READER,
    super::nerfstudio::READER,
];

/// The reader of a format.
pub(crate) fn reader_of(format: Format) -> Option<&'static Reader> {
    READERS.iter().find(|reader| reader.format == format)
}

impl Format {
    /// All formats, in the order in which they are tried.
    pub const ALL: [Self; READERS.len()] = {
        let mut all = [READERS[0].format; READERS.len()];
        let mut index = 0;
        while index < all.len() {
            all[index] = READERS[index].format;
            index += 1;
        }
        all
    };

    /// The keys of all formats.
    const KEYS: [&'static str; READERS.len()] = {
        let mut keys = [""; READERS.len()];
        let mut index = 0;
        while index < keys.len() {
            keys[index] = READERS[index].format.key();
            index += 1;
        }
        keys
    };

    /// The format with this key.
    pub fn of_key(key: &str) -> Option<Self> {
        Self::ALL.into_iter().find(|format| format.key() == key)
    }
}

impl<'de> Deserialize<'de> for Format {
    /// From its key. An unknown key is rejected with a list of the known keys.
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        let key = String::deserialize(deserializer)?;
        Self::of_key(&key).ok_or_else(|| D::Error::unknown_variant(&key, &Self::KEYS))
    }
}

impl JsonSchema for Format {
    fn inline_schema() -> bool {
        true
    }

    fn schema_name() -> Cow<'static, str> {
        "Format".into()
    }

    /// One of the keys, each with its name in messages.
    fn json_schema(_: &mut SchemaGenerator) -> Schema {
        let choices = Self::ALL.map(|format| json_schema!({ "const": format.key(), "description": format.name() }));
        json_schema!({ "oneOf": choices })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_formats_key_is_what_configurations_write() {
        for format in Format::ALL {
            assert_eq!(serde_json::to_value(format).expect("json"), format.key());
        }
    }

    #[test]
    fn a_format_is_read_by_its_key_and_an_unknown_key_is_refused_with_all_keys() {
        for format in Format::ALL {
            assert_eq!(serde_json::from_value::<Format>(format.key().into()).expect("known"), format);
        }
        let refusal = serde_json::from_value::<Format>("".into()).expect_err("no format").to_string();
        let keys = Format::ALL.map(|format| format!("`{}`", format.key())).join(", ");
        assert_eq!(refusal, format!("unknown variant ``, expected one of {keys}"));
    }
}
