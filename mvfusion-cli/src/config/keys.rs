//! The known keys and the values that they accept.

use anyhow::Context;
use mvfusion_model::Config;
use mvfusion_model::config::{KeyKind, KeyNotes, NumberKind};
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
    /// What is known of every key and table.
    notes: &'static [KeyNotes],
}

impl KnownKeys {
    /// The keys of this version.
    ///
    /// # Errors
    /// Never, unless the configuration's own defaults cannot be written as TOML.
    pub fn new() -> anyhow::Result<Self> {
        let defaults = Table::try_from(Config::default()).context("the defaults cannot be written as TOML")?;
        Ok(Self { defaults, notes: Config::key_notes() })
    }

    /// The defaults.
    pub fn defaults(&self) -> &Table {
        &self.defaults
    }

    /// What is known of a key or a table.
    pub fn find(&self, key: &str) -> Option<&'static KeyNotes> {
        self.notes.iter().find(|notes| notes.key == key)
    }

    /// The keys and tables directly within a table; those of the whole for an empty name.
    pub fn within<'a>(&self, table: &'a str) -> impl Iterator<Item = &'static KeyNotes> + use<'a> {
        let parent = |key: &'static str| key.rsplit_once('.').map_or("", |(parent, _)| parent);
        self.notes.iter().filter(move |notes| parent(&notes.key) == table)
    }

    /// The key that is most like a name, if any is similar enough.
    pub fn nearest(&self, name: &str) -> Option<&'static str> {
        nearest(name, self.notes.iter().map(|notes| notes.key.as_str()))
    }

    /// Whether every key of a partial exists and has a value of the right kind.
    ///
    /// # Errors
    /// [`UsageError`] that names the first wrong key or value, and where it was written.
    pub fn check(&self, partial: &PartialConfig) -> Result<(), UsageError> {
        self.check_table(partial, &partial.table, "")
    }

    fn check_table(&self, partial: &PartialConfig, given: &Table, prefix: &str) -> Result<(), UsageError> {
        for (name, value) in given {
            let key = format!("{prefix}{name}");
            // In quotes, `train.scale` is a name beside the table `train`, which no configuration has.
            if name.contains('.') {
                let place = partial.place(&key);
                return Err(UsageError::new(format!(
                    "\"{name}\" is one name with dots, not a key within a table ({place}). In TOML, write `{name}` without \
                     quotes."
                )));
            }
            match (self.find(&key), value) {
                (None, _) => return Err(self.unknown(partial, &key)),
                (Some(KeyNotes { kind: KeyKind::Table, .. }), Value::Table(given)) => {
                    self.check_table(partial, given, &format!("{key}."))?;
                }
                (Some(notes), _) => self.check_value(partial, notes, value)?,
            }
        }
        Ok(())
    }

    fn unknown(&self, partial: &PartialConfig, key: &str) -> UsageError {
        // A last part that several keys share, as `scale`: the most similar of them may be quite another one.
        let last = |notes: &&KeyNotes| notes.key.rsplit_once('.').is_some_and(|(_, last)| last == key);
        let same: Vec<String> = self.notes.iter().filter(last).map(|notes| format!("`{}`", notes.key)).collect();
        let nearest = match same.as_slice() {
            _ if key == "preset" => " A preset is chosen with --preset.".to_owned(),
            [_, _, ..] => format!(" Did you mean {}?", same.join(" or ")),
            _ => self.nearest(key).map_or(String::new(), |near| format!(" Did you mean `{near}`?")),
        };
        let place = partial.place(key);
        UsageError::new(format!("unknown key `{key}` ({place}).{nearest} `mvfusion config` prints all keys."))
    }

    /// Tries a value in the default configuration, whose types decide whether they accept it.
    fn check_value(&self, partial: &PartialConfig, notes: &KeyNotes, value: &Value) -> Result<(), UsageError> {
        let key = &notes.key;
        let mut trial = self.defaults.clone();
        put(&mut trial, key, value.clone());
        // A list would pass for a table: its items would become the first keys, and the others would be reset.
        let is_table = notes.kind == KeyKind::Table;
        if !is_table && Value::Table(trial).try_into::<Config>().is_ok() {
            return Ok(());
        }
        let expected = self.expectation(notes);
        Err(UsageError::new(format!("`{key}` must be {expected}, not {value} ({}).", partial.place(key))))
    }

    /// What a key accepts, in words. Ranges are checked later, beside the other keys.
    fn expectation(&self, notes: &KeyNotes) -> String {
        let default = || notes.default.as_ref().map_or(String::new(), |default| default.to_string().replace(',', ", "));
        match &notes.kind {
            KeyKind::Number { kind: NumberKind::Real, .. } => "a number".to_owned(),
            KeyKind::Number { kind: NumberKind::Whole, .. } => "a whole number, 0 or more".to_owned(),
            KeyKind::Number { kind: NumberKind::List, .. } => format!("a list such as {}", default()),
            KeyKind::Table => {
                let start = notes.key.len() + 1;
                let names: Vec<_> = self.within(&notes.key).map(|inner| &inner.key[start..]).collect();
                format!("a table with the keys {}", names.join(", "))
            }
            KeyKind::Texts => {
                let key = &notes.key;
                format!("a list of strings such as [\"a\", \"b\"] (in a shell: --set '{key}=[\"a\", \"b\"]')")
            }
            other => other.in_words(),
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
