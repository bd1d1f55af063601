//! What is known of each key: its comment, what it accepts, its default, and where the default comes from.

use std::sync::LazyLock;

use serde_json::Value;

use super::keys::ListedKey;
use super::range::written;
use super::schema::pointer;
use super::sources::sources;
use super::{Config, NumberKind, NumericKey};

/// What is known of a key.
#[derive(Clone, Debug, PartialEq)]
pub struct KeyNotes {
    /// The dotted key.
    pub key: String,
    /// The doc comment of its field, and that of its type. Paragraphs are separated by an empty line.
    pub comment: String,
    /// What it accepts.
    pub kind: KeyKind,
    /// Its default; `None` if it is absent by default, and for tables.
    pub default: Option<Value>,
    /// The sources that the comment names, or else those of the comment of the table in [`Self::source_table`].
    pub sources: Vec<String>,
    /// The table whose comment names the sources, if the key's own does not.
    pub source_table: Option<String>,
    /// If `train.scale` multiplies it: the value below which it does not make it fall.
    pub scaled_from: Option<usize>,
}

/// What a key accepts.
#[derive(Clone, Debug, PartialEq)]
pub enum KeyKind {
    /// A table of keys.
    Table,
    /// `true` or `false`.
    Flag,
    /// A number, or a list of numbers.
    Number {
        /// Its kind.
        kind: NumberKind,
        /// The smallest valid value.
        least: f64,
        /// The largest valid value; infinite if there is none.
        most: f64,
        /// The number of items of a list, if it is fixed.
        items: Option<u64>,
    },
    /// Text, such as a path.
    Text,
    /// A list of texts.
    Texts,
    /// One of several names.
    Choice(Vec<Choice>),
}

/// A name that a key accepts.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Choice {
    /// The name.
    pub name: String,
    /// Its doc comment.
    pub comment: String,
}

impl Config {
    /// Notes on every key and table, in the order of the declarations.
    pub fn key_notes() -> &'static [KeyNotes] {
        static NOTES: LazyLock<Vec<KeyNotes>> = LazyLock::new(all_notes);
        &NOTES
    }
}

fn all_notes() -> Vec<KeyNotes> {
    let schema = Config::schema();
    let mut notes: Vec<KeyNotes> = Vec::new();
    for listed in Config::default().listed().into_iter().filter(|listed| !listed.key.is_empty()) {
        let Some(place) = schema.pointer(&pointer(&listed.key, "/properties/")) else { continue };
        let mut of_key = KeyNotes::read(place, listed);
        if of_key.sources.is_empty() {
            of_key.inherit_sources(&notes);
        }
        notes.push(of_key);
    }
    notes
}

impl KeyNotes {
    fn read(place: &Value, listed: ListedKey) -> Self {
        let comment = place["description"].as_str().unwrap_or_default().to_owned();
        let sources = sources(&comment).into_iter().map(str::to_owned).collect();
        let (default, kind) = (place.get("default").cloned(), KeyKind::read(place, &listed));
        let ListedKey { key, scaled_from, .. } = listed;
        Self { key, comment, kind, default, sources, source_table: None, scaled_from }
    }

    /// Takes the sources of the innermost table that has any.
    fn inherit_sources(&mut self, tables: &[Self]) {
        let mut parent = self.key.as_str();
        while let Some((table, _)) = parent.rsplit_once('.') {
            let notes = tables.iter().find(|notes| notes.key == table && notes.source_table.is_none());
            if let Some(notes) = notes.filter(|notes| !notes.sources.is_empty()) {
                (self.sources, self.source_table) = (notes.sources.clone(), Some(table.to_owned()));
                return;
            }
            parent = table;
        }
    }

    /// The first sentence of the comment.
    pub fn summary(&self) -> &str {
        let end =
            self.comment.find(". ").or_else(|| self.comment.find(".\n")).map_or(self.comment.len(), |end| end + 1);
        &self.comment[..end]
    }
}

impl KeyKind {
    fn read(place: &Value, listed: &ListedKey) -> Self {
        if let Some(NumericKey { kind, .. }) = listed.number {
            let range = if kind == NumberKind::List { &place["items"] } else { place };
            let end = |word: &str, open| range[word].as_f64().unwrap_or(open);
            let items = place["minItems"].as_u64().filter(|_| place["minItems"] == place["maxItems"]);
            return Self::Number {
                kind,
                least: end("minimum", -f64::INFINITY),
                most: end("maximum", f64::INFINITY),
                items,
            };
        }
        if let Some(choices) = place["oneOf"].as_array() {
            let text = |choice: &Value, word: &str| choice[word].as_str().unwrap_or_default().to_owned();
            let choice = |choice| Choice { name: text(choice, "const"), comment: text(choice, "description") };
            return Self::Choice(choices.iter().map(choice).collect());
        }
        match place["type"].as_str() {
            Some("object") => Self::Table,
            Some("boolean") => Self::Flag,
            Some("array") => Self::Texts,
            _ => Self::Text,
        }
    }

    /// What is accepted, in words.
    pub fn in_words(&self) -> String {
        match self {
            Self::Table => "a table".to_owned(),
            Self::Flag => "true or false".to_owned(),
            Self::Text => "a string".to_owned(),
            Self::Texts => "a list of strings".to_owned(),
            Self::Choice(choices) => {
                let names: Vec<_> = choices.iter().map(|choice| format!("`{}`", choice.name)).collect();
                format!("one of {}", names.join(", "))
            }
            &Self::Number { kind, least, most, items } => {
                let range = match most.is_finite() {
                    true => format!("from {} to {}", written(least), written(most)),
                    false => format!("from {}, or inf", written(least)),
                };
                let count = items.map_or(String::new(), |items| format!("{items} "));
                match kind {
                    NumberKind::Real => format!("a number {range}"),
                    NumberKind::Whole => format!("a whole number {range}"),
                    NumberKind::List => format!("a list of {count}whole numbers, each {range}"),
                }
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_key_has_a_comment_and_every_default_a_source() {
        for notes in Config::key_notes() {
            assert!(!notes.comment.is_empty(), "`{}` has no comment", notes.key);
            assert!(!notes.sources.is_empty(), "neither `{}` nor its table names a source", notes.key);
            if let KeyKind::Choice(choices) = &notes.kind {
                let silent = choices.iter().find(|choice| choice.name.is_empty() || choice.comment.is_empty());
                assert_eq!(silent, None, "{}", notes.key);
            }
        }
    }

    #[test]
    fn what_is_written_of_a_key_is_found() {
        let all = Config::key_notes();
        let of = |key: &str| all.iter().find(|notes| notes.key == key).expect("a key");
        let batch = of("train.batch_size");
        assert_eq!(batch.comment, "Views per step (DeGauss: 2 for video, 4 for photos).");
        assert_eq!(
            (batch.default.clone(), batch.kind.in_words()),
            (Some(2.into()), "a whole number from 1 to 4096".into())
        );
        assert_eq!(
            (&batch.sources[..], &batch.source_table),
            (&["DeGauss: 2 for video, 4 for photos".to_owned()][..], &None)
        );
        let interval = of("densify.interval");
        assert_eq!(interval.source_table.as_deref(), Some("densify"));
        assert_eq!(interval.scaled_from, Some(20));
        assert!(matches!(&of("motion.temporal").kind, KeyKind::Choice(choices) if choices[0].name == "cross"));
        assert_eq!(of("init.box_reach").kind.in_words(), "a number from 0, or inf");
        assert_eq!(of("scene.test_cameras").kind, KeyKind::Texts);
        assert_eq!((&of("scene.data").kind, &of("scene.data").default), (&KeyKind::Text, &None));
        assert!(of("model.grid.resolution").kind.in_words().starts_with("a list of 4 whole numbers, each from 2 to"));
        assert_eq!(of("densify.static").kind, KeyKind::Table);
    }
}
