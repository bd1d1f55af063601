//! A partial configuration, and where each of its keys was written.

use std::collections::BTreeMap;
use std::path::PathBuf;

use toml::de::{DeTable, DeValue};
use toml::{Table, Value};

use crate::failure::UsageError;

/// Some keys of a configuration.
#[derive(Clone, Debug)]
pub struct PartialConfig {
    /// Keys and values.
    pub table: Table,
    /// Where it comes from.
    pub origin: Origin,
    /// The line of every key that was read from a text, by dotted key.
    lines: BTreeMap<String, usize>,
}

/// Where a partial configuration comes from.
#[derive(Clone, Debug)]
pub enum Origin {
    /// A preset of this name.
    Preset(&'static str),
    /// A file.
    File(PathBuf),
    /// `--set` with this argument.
    Setting(String),
    /// A program that embeds this one.
    Program,
    /// An option of its own.
    Flag(&'static str),
    /// A part of a grid, in words: ``components.toml, the variant `full` ``.
    Grid(String),
}

impl PartialConfig {
    /// Reads the text of a TOML document.
    ///
    /// # Errors
    /// [`UsageError`] with the place if the text is not valid TOML.
    pub fn parse(text: &str, origin: Origin) -> Result<Self, UsageError> {
        let wrong = |error: toml::de::Error| {
            let line = error.span().map_or(String::new(), |span| format!(", line {}", line_of(text, span.start)));
            UsageError::new(format!("{}{line} is not valid TOML: {}.", origin.name(), error.message()))
        };
        let table: Table = toml::from_str(text).map_err(wrong)?;
        let mut lines = BTreeMap::new();
        collect_lines(text, DeTable::parse(text).map_err(wrong)?.get_ref(), "", &mut lines);
        Ok(Self { table, origin, lines })
    }

    /// A partial configuration of keys that have been parsed before.
    pub fn of_table(table: Table, origin: Origin) -> Self {
        Self { table, origin, lines: BTreeMap::new() }
    }

    /// Reads `dotted.key=value`. A value that is not valid TOML becomes a string.
    ///
    /// # Errors
    /// [`UsageError`] if there is no key or no `=`.
    pub fn from_setting(setting: &str) -> Result<Self, UsageError> {
        let origin = Origin::Setting(setting.to_owned());
        match setting.split_once('=') {
            Some((key, value)) if key.split('.').all(|part| !part.trim().is_empty()) => {
                Ok(Self::of_one(key.trim(), toml_or_text(value.trim()), origin))
            }
            _ => Err(UsageError::new(format!("cannot parse `--set {setting}`; write `--set dotted.key=value`."))),
        }
    }

    /// A partial configuration of one dotted key.
    pub fn of_one(key: &str, value: Value, origin: Origin) -> Self {
        let mut parts = key.split('.').rev();
        // `split` yields at least one part.
        let last = parts.next().unwrap_or_default();
        let leaf = Table::from_iter([(last.to_owned(), value)]);
        let table = parts.fold(leaf, |inner, part| Table::from_iter([(part.to_owned(), Value::Table(inner))]));
        Self::of_table(table, origin)
    }

    /// The line of a key in the text, from 1.
    pub fn line(&self, key: &str) -> Option<usize> {
        self.lines.get(key).copied()
    }

    /// Whether it has a value for a key.
    pub fn has(&self, key: &str) -> bool {
        leaves(&self.table).iter().any(|(own, _)| own == key)
    }

    /// Where a key was written, for messages.
    pub fn place(&self, key: &str) -> String {
        match self.lines.get(key) {
            Some(line) => format!("{}, line {line}", self.origin.name()),
            None => self.origin.name(),
        }
    }
}

impl Origin {
    fn name(&self) -> String {
        match self {
            Self::Preset(name) => format!("preset `{name}`"),
            Self::File(path) => path.display().to_string(),
            Self::Setting(setting) => format!("`--set {setting}`"),
            Self::Program => "the configuration of the calling program".to_owned(),
            Self::Flag(flag) => format!("`{flag}`"),
            Self::Grid(part) => part.clone(),
        }
    }
}

fn toml_or_text(value: &str) -> Value {
    let document: Option<Table> = toml::from_str(&format!("value = {value}")).ok();
    document
        .filter(|table| table.len() == 1)
        .and_then(|mut table| table.remove("value"))
        .unwrap_or_else(|| Value::String(value.to_owned()))
}

fn collect_lines(text: &str, table: &DeTable<'_>, prefix: &str, lines: &mut BTreeMap<String, usize>) {
    for (key, value) in table {
        let path = format!("{prefix}{}", key.get_ref());
        if let DeValue::Table(inner) = value.get_ref() {
            collect_lines(text, inner, &format!("{path}."), lines);
        }
        lines.insert(path, line_of(text, key.span().start));
    }
}

/// The line, from 1, of a byte of a text.
pub fn line_of(text: &str, byte: usize) -> usize {
    1 + text.bytes().take(byte).filter(|&byte| byte == b'\n').count()
}

/// Every dotted key of a table whose value is not a table. Nested tables and dotted keys are the same.
pub(crate) fn leaves(table: &Table) -> Vec<(String, &Value)> {
    let mut found = Vec::new();
    for (name, value) in table {
        match value {
            Value::Table(inner) => {
                found.extend(leaves(inner).into_iter().map(|(key, value)| (format!("{name}.{key}"), value)));
            }
            _ => found.push((name.clone(), value)),
        }
    }
    found
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_value_is_toml_or_else_text() {
        assert_eq!(toml_or_text("0.5"), Value::Float(0.5));
        assert_eq!(toml_or_text("[1, 2]"), Value::Array(vec![Value::Integer(1), Value::Integer(2)]));
        assert_eq!(toml_or_text("\"3\""), Value::String("3".into()));
        assert_eq!(toml_or_text("casual"), Value::String("casual".into()));
        assert_eq!(toml_or_text("1\nother = 2"), Value::String("1\nother = 2".into()));
    }

    #[test]
    fn a_text_that_is_no_toml_is_refused_with_its_line() {
        let error = PartialConfig::parse("seed = 1\n[train\n", Origin::File("a.toml".into())).expect_err("refused");
        assert!(error.to_string().starts_with("a.toml, line 2 is not valid TOML: "), "{error}");
    }
}
