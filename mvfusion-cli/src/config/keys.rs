//! The known keys and the values that they accept.

use std::path::PathBuf;

use anyhow::Context;
use mvfusion_data::Format;
use mvfusion_model::Config;
use toml::{Table, Value};

use crate::failure::UsageError;

use super::partial::PartialConfig;

/// Minimum similarity at which a name is suggested.
const SIMILAR_ENOUGH: f64 = 0.5;

/// All keys of a configuration.
#[derive(Clone, Debug)]
pub struct KnownKeys {
    /// The default of every key that has one.
    defaults: Table,
    /// The same, with an example at the keys that are absent by default.
    specimen: Table,
}

impl KnownKeys {
    /// The keys of this version.
    ///
    /// # Errors
    /// Never, unless the configuration's own defaults cannot be written as TOML.
    pub fn new() -> anyhow::Result<Self> {
        let mut specimen = Config::default();
        specimen.scene.data = Some(PathBuf::new());
        specimen.scene.format = Some(Format::NEU3D);
        specimen.scene.test_cameras = Some(vec!["cam00".to_owned()]);
        specimen.scene.frame_store = Some(PathBuf::new());
        specimen.init.static_ply = Some(PathBuf::new());
        specimen.init.dynamic_ply = Some(PathBuf::new());
        specimen.eval.dynamic_masks = Some(PathBuf::new());
        specimen.eval.lpips_weights = Some(PathBuf::new());
        let table = |config: &Config| Table::try_from(config).context("the defaults cannot be written as TOML");
        Ok(Self { defaults: table(&Config::default())?, specimen: table(&specimen)? })
    }

    /// The defaults.
    pub fn defaults(&self) -> &Table {
        &self.defaults
    }

    /// Whether every key of a partial exists and has a value of the right kind.
    ///
    /// # Errors
    /// [`UsageError`] that names the first wrong key or value, and where it was written.
    pub fn check(&self, partial: &PartialConfig) -> Result<(), UsageError> {
        self.check_table(partial, &partial.table, &self.specimen, "")
    }

    fn check_table(
        &self,
        partial: &PartialConfig,
        given: &Table,
        known: &Table,
        prefix: &str,
    ) -> Result<(), UsageError> {
        for (name, value) in given {
            let key = format!("{prefix}{name}");
            match (known.get(name), value) {
                (None, _) => return Err(self.unknown(partial, &key)),
                (Some(Value::Table(known)), Value::Table(given)) => {
                    self.check_table(partial, given, known, &format!("{key}."))?;
                }
                (Some(example), _) => self.check_value(partial, &key, value, example)?,
            }
        }
        Ok(())
    }

    fn unknown(&self, partial: &PartialConfig, key: &str) -> UsageError {
        let mut all = Vec::new();
        list(&self.specimen, "", &mut all);
        let nearest = nearest(key, all.iter().map(String::as_str))
            .map_or(String::new(), |near| format!(" Did you mean `{near}`?"));
        let place = partial.place(key);
        UsageError::new(format!("unknown key `{key}` ({place}).{nearest} `mvfusion config` prints all keys."))
    }

    /// Tries a value in the default configuration, whose types decide whether they accept it.
    fn check_value(
        &self,
        partial: &PartialConfig,
        key: &str,
        value: &Value,
        example: &Value,
    ) -> Result<(), UsageError> {
        let mut trial = self.defaults.clone();
        put(&mut trial, key, value.clone());
        if Value::Table(trial).try_into::<Config>().is_ok() {
            return Ok(());
        }
        let expected = self.expectation(key, example);
        Err(UsageError::new(format!("`{key}` must be {expected}, not {value} ({}).", partial.place(key))))
    }

    /// What a key accepts, in words, given an example value.
    fn expectation(&self, key: &str, example: &Value) -> String {
        match example {
            Value::Integer(_) => "a whole number, 0 or more".to_owned(),
            Value::Float(_) => "a number".to_owned(),
            Value::Boolean(_) => "true or false".to_owned(),
            Value::Array(_) => format!("a list such as {example}"),
            Value::Table(table) => {
                format!("a table with the keys {}", table.keys().cloned().collect::<Vec<_>>().join(", "))
            }
            Value::String(_) | Value::Datetime(_) => {
                // An enumeration lists its names when it refuses another one.
                let mut trial = self.defaults.clone();
                put(&mut trial, key, Value::String(String::new()));
                let refusal = Value::Table(trial).try_into::<Config>().err();
                refusal.and_then(|error| variants(error.message())).unwrap_or_else(|| "a string".to_owned())
            }
        }
    }
}

/// Sets a dotted key to a value. Missing tables on the way are created.
fn put(table: &mut Table, key: &str, value: Value) {
    match key.split_once('.') {
        None => {
            table.insert(key.to_owned(), value);
        }
        Some((first, rest)) => {
            let inner = table.entry(first).or_insert_with(|| Value::Table(Table::new()));
            if let Value::Table(inner) = inner {
                put(inner, rest, value);
            }
        }
    }
}

/// The names that an enumeration accepts, taken from its error message.
fn variants(refusal: &str) -> Option<String> {
    let (_, names) = refusal.split_once(", expected ")?;
    let names = names.lines().next().unwrap_or_default();
    let names = names.strip_prefix("one of ").unwrap_or(names).replace(" or ", ", ");
    names.starts_with('`').then(|| format!("one of {names}"))
}

fn list(table: &Table, prefix: &str, keys: &mut Vec<String>) {
    for (name, value) in table {
        let key = format!("{prefix}{name}");
        if let Value::Table(inner) = value {
            list(inner, &format!("{key}."), keys);
        }
        keys.push(key);
    }
}

/// The name most similar to `given`, as a whole or in its last part, if any is similar enough.
pub(crate) fn nearest<'a>(given: &str, names: impl Iterator<Item = &'a str>) -> Option<&'a str> {
    /// A match of the last parts only counts slightly less than one of the whole names.
    const LAST_PART: f64 = 0.9;
    let last = |name: &'a str| name.rsplit('.').next().unwrap_or(name);
    let given_last = given.rsplit('.').next().unwrap_or(given);
    let similarity = |name: &'a str| {
        let whole = strsim::normalized_damerau_levenshtein(given, name);
        whole.max(LAST_PART * strsim::normalized_damerau_levenshtein(given_last, last(name)))
    };
    names
        .map(|name| (similarity(name), name))
        .filter(|&(similarity, _)| similarity >= SIMILAR_ENOUGH)
        .max_by(|a, b| a.0.total_cmp(&b.0))
        .map(|(_, name)| name)
}
