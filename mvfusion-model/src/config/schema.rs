//! The JSON schema of a configuration file, for editors.
//!
//! `schemars` reads types, variants and doc comments, and knows serde's attributes. The ranges come from
//! [`keys!`](super::keys), the defaults from the configuration itself.

use std::collections::BTreeMap;

use schemars::generate::SchemaSettings;
use serde_json::{Map, Value, json};

use super::keys::ListedKey;
use super::{Config, NumberKind, NumericKey};

impl Config {
    /// The JSON schema (draft 2020-12) of a configuration file: what each key accepts, its default and its comment.
    /// All keys are optional.
    pub fn schema() -> Value {
        let config = Self::default();
        let generated = SchemaSettings::draft2020_12().into_generator().into_root_schema_for::<Self>().to_value();
        let mut schema = expanded(&generated, &generated["$defs"]);
        schema["title"] = "Configuration of MVFusion-GS".into();
        let defaults = serde_json::to_value(&config).unwrap_or_default();
        let least = least_values();
        for ListedKey { key, number, .. } in config.listed() {
            let Some(place) = schema.pointer_mut(&pointer(&key, "/properties/")) else { continue };
            match defaults.pointer(&pointer(&key, "/")) {
                Some(default) if !default.is_object() => place["default"] = default.clone(),
                _ => {}
            }
            if let Some(number) = number {
                set_range(place, &number, least.get(&number.key).copied().unwrap_or(number.least));
            }
        }
        schema
    }
}

/// The smallest values of numbers that depend on another key: the end of a rate that starts at 0 may be 0.
fn least_values() -> BTreeMap<String, f64> {
    let mut off = Config::default();
    off.optim.decays().into_iter().for_each(|decay| decay.start = 0.0);
    let mut least: BTreeMap<_, _> = off.numeric_keys().into_iter().map(|number| (number.key, number.least)).collect();
    for number in Config::default().numeric_keys() {
        least.entry(number.key).and_modify(|least| *least = least.min(number.least)).or_insert(number.least);
    }
    least
}

/// The JSON pointer of a dotted key; each part follows `before`.
pub(super) fn pointer(key: &str, before: &str) -> String {
    key.split('.').filter(|part| !part.is_empty()).map(|part| format!("{before}{part}")).collect()
}

fn set_range(place: &mut Value, number: &NumericKey, least: f64) {
    let place = if number.kind == NumberKind::List { &mut place["items"] } else { place };
    for (word, end) in [("minimum", least), ("maximum", number.most)] {
        if end.is_finite() {
            place[word] = written(end);
        } else {
            // JSON has no infinity, and editors turn that of TOML into `null`.
            place["type"] = json!(["number", "null"]);
        }
    }
}

/// A number as JSON, without a fraction where it has none.
fn written(number: f64) -> Value {
    if number.fract() == 0.0 { json!(number as i64) } else { json!(number) }
}

/// A schema without references, so that the same type can have another range at another key, and without the `null` of
/// an absent value, which TOML lacks.
fn expanded(schema: &Value, definitions: &Value) -> Value {
    let Some(schema) = schema.as_object() else { return schema.clone() };
    let mut whole = Map::new();
    if let Some(name) = schema.get("$ref").and_then(Value::as_str).and_then(|path| path.rsplit('/').next()) {
        extend(&mut whole, expanded(&definitions[name], definitions));
    }
    if let Some(choices) = schema.get("anyOf").and_then(Value::as_array) {
        let present = choices.iter().filter(|choice| choice["type"] != "null");
        present.for_each(|choice| extend(&mut whole, expanded(choice, definitions)));
    }
    for (word, value) in schema {
        match word.as_str() {
            // A file may leave out any key; the names of number formats are not standard.
            "$ref" | "$defs" | "anyOf" | "default" | "format" | "required" => {}
            "type" => _ = whole.insert(word.clone(), without_null(value)),
            "description" => {
                let own = plain(value.as_str().unwrap_or_default());
                let of_type = whole.get(word).and_then(Value::as_str).unwrap_or_default();
                let both = joined(&own, of_type);
                whole.insert(word.clone(), both.into());
            }
            "properties" => {
                let properties = value.as_object().into_iter().flatten();
                let properties = properties.map(|(name, inner)| (name.clone(), expanded(inner, definitions)));
                whole.insert(word.clone(), Value::Object(properties.collect()));
            }
            "items" => _ = whole.insert(word.clone(), expanded(value, definitions)),
            "oneOf" => {
                let choices = value.as_array().into_iter().flatten();
                whole.insert(word.clone(), choices.map(|choice| expanded(choice, definitions)).collect());
            }
            _ => _ = whole.insert(word.clone(), value.clone()),
        }
    }
    Value::Object(whole)
}

fn extend(whole: &mut Map<String, Value>, part: Value) {
    if let Value::Object(part) = part {
        whole.extend(part);
    }
}

fn without_null(kinds: &Value) -> Value {
    match kinds.as_array() {
        Some(kinds) => kinds.iter().find(|&kind| kind != "null").cloned().unwrap_or_default(),
        None => kinds.clone(),
    }
}

/// The comment of a field and that of its type. Of two that begin alike, the longer one, which says what both say.
fn joined(own: &str, of_type: &str) -> String {
    /// Words that make a beginning.
    const BEGINNING: usize = 3;
    let begins = |text: &str| text.split_whitespace().take(BEGINNING).map(str::to_owned).collect::<Vec<_>>();
    match own.contains(of_type.trim_end_matches('.')) {
        true => own.to_owned(),
        false if of_type.contains(own.trim_end_matches('.')) => of_type.to_owned(),
        false if begins(own) == begins(of_type) => if own.len() > of_type.len() { own } else { of_type }.to_owned(),
        false => format!("{own}\n\n{of_type}"),
    }
}

/// A doc comment as text: a line for each paragraph, and names instead of links to the code.
fn plain(comment: &str) -> String {
    let paragraphs =
        comment.split("\n\n").map(|paragraph| paragraph.lines().map(str::trim).collect::<Vec<_>>().join(" "));
    let mut text = paragraphs.collect::<Vec<_>>().join("\n\n");
    while let Some(start) = text.find("[`") {
        let Some(end) = text[start..].find("`]").map(|length| start + length) else { break };
        let after = end + "`]".len();
        let link = text[after..].starts_with('(').then(|| text[after..].find(')')).flatten();
        let name = text[start + 1..=end].to_owned();
        text.replace_range(start..link.map_or(after, |length| after + length + 1), &name);
    }
    text
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn links_to_the_code_become_names() {
        let comment = "Multiplies it; see\n[`Config::scaled`](super::Config::scaled).\n\nSee [`Config`], `a[0]`.";
        assert_eq!(plain(comment), "Multiplies it; see `Config::scaled`.\n\nSee `Config`, `a[0]`.");
        assert!(!Config::schema().to_string().contains("::config"), "a link is left");
    }

    #[test]
    fn a_type_adds_its_comment_unless_the_field_has_it() {
        assert_eq!(joined("The kind (A1).", ""), "The kind (A1).");
        assert_eq!(joined("The kind of it (A1). More.", "The kind of it (A1)."), "The kind of it (A1). More.");
        assert_eq!(joined("The kind of it.", "The kind of it, here and there."), "The kind of it, here and there.");
        assert_eq!(joined("The rule for it (A1).", "The rule for that."), "The rule for it (A1).");
        assert_eq!(joined("The branch.", "Densification of a branch."), "The branch.\n\nDensification of a branch.");
    }

    #[test]
    fn one_type_has_the_range_of_each_key() {
        let schema = Config::schema();
        let range = |key: &str| {
            let place = schema.pointer(&pointer(key, "/properties/")).expect("a key");
            (place["minimum"].clone(), place["maximum"].clone())
        };
        assert_eq!(range("optim.grid.start"), (json!(0), json!(0.3)));
        assert_eq!(range("optim.mask_logits.start"), (json!(0), json!(1000)));
        assert_eq!(range("optim.grid.end"), (json!(0), json!(0.3)), "the end of a rate that is off");
        assert_eq!(range("init.box_reach"), (json!(0), Value::Null));
        assert_eq!(range("seed"), (json!(0), json!(i64::MAX)));
    }

    #[test]
    fn every_key_is_optional_and_no_other_is_accepted() {
        let schema = Config::schema();
        for ListedKey { key, .. } in Config::default().listed() {
            let place = schema.pointer(&pointer(&key, "/properties/")).expect("a key");
            assert_eq!(place["required"], Value::Null, "{key}");
            if place["type"] == "object" {
                assert_eq!(place["additionalProperties"], json!(false), "{key}");
            }
        }
    }
}
