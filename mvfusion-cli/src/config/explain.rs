//! What a key means, accepts and is by default, as text.

use std::fmt::Write as _;

use mvfusion_model::config::{KeyKind, KeyNotes};

use crate::failure::UsageError;

use super::keys::KnownKeys;
use super::preset::PRESETS;
use super::preset_values::{PresetValue, effective, values_of};
use super::{on_resume, template};

/// Columns of the text.
const WIDTH: usize = 96;

/// Columns of the words in front of a fact.
const LABEL: usize = 10;

/// Everything that is known of a key or a table, for a terminal.
///
/// # Errors
/// [`UsageError`] with the most similar key if there is none of this name.
pub fn explain(name: &str) -> anyhow::Result<String> {
    let known = KnownKeys::new()?;
    let name = name.trim();
    let Some(notes) = known.find(name) else {
        let nearest = known.nearest(name).map_or(String::new(), |near| format!(" Did you mean `{near}`?"));
        return Err(
            UsageError::new(format!("unknown key `{name}`.{nearest} `mvfusion config` prints all keys.")).into()
        );
    };
    match &notes.kind {
        KeyKind::Table => Ok(of_table(&known, notes)),
        _ => of_key(notes),
    }
}

fn of_table(known: &KnownKeys, table: &KeyNotes) -> String {
    let mut text = format!("{}: a table\n\n", table.key);
    paragraphs(&mut text, "", &table.comment);
    for notes in known.within(&table.key) {
        let default = notes.default.as_ref().map_or(String::new(), |default| format!(", default {default}"));
        _ = write!(text, "\n{}: {}{default}\n", notes.key, notes.kind.in_words());
        paragraphs(&mut text, "  ", notes.summary());
    }
    text
}

fn of_key(notes: &KeyNotes) -> anyhow::Result<String> {
    let mut text = format!("{}: {}\n\n", notes.key, notes.kind.in_words());
    paragraphs(&mut text, "", &notes.comment);
    if let KeyKind::Choice(choices) = &notes.kind {
        for choice in choices {
            _ = write!(text, "\n  {}\n", choice.name);
            paragraphs(&mut text, "    ", &choice.comment);
        }
    }
    text.push('\n');
    let default = notes.default.as_ref().map_or("absent".to_owned(), ToString::to_string);
    fact(&mut text, "default", &default);
    let of_table = notes.source_table.as_ref().map_or(String::new(), |table| format!(" (said of the table `{table}`)"));
    fact(&mut text, "source", &format!("{}{of_table}", notes.sources.join("; ")));
    if let Some(least) = notes.scaled_from {
        let floor =
            if least > 1 { format!(", but leaves at least {least}; a shorter one stays") } else { String::new() };
        fact(&mut text, "length", &format!("`train.scale` multiplies it{floor}"));
    }
    fact(&mut text, "resume", on_resume(&notes.key));
    let values = values_of(&notes.key)?;
    if values.is_empty() {
        fact(&mut text, "presets", "all have the default");
    }
    for (index, value) in values.iter().enumerate() {
        fact(&mut text, if index == 0 { "presets" } else { "" }, &in_presets(&values, value));
    }
    Ok(text)
}

/// A value of a preset, the presets that have it from there, and the reason.
fn in_presets(values: &[PresetValue], value: &PresetValue) -> String {
    let has_it = |preset: &&'static _| effective(values, preset).is_some_and(|other| other.preset == value.preset);
    let names: Vec<&str> = PRESETS.iter().filter(has_it).map(|preset| preset.name).collect();
    let reason = if value.reason.is_empty() { String::new() } else { format!(": {}", value.reason) };
    format!("{} in {}{reason}", value.value, names.join(", "))
}

/// A word, and what it is about beside it.
fn fact(text: &mut String, label: &str, of: &str) {
    let lines = template::wrapped(of, WIDTH - LABEL);
    for (index, line) in lines.iter().enumerate() {
        _ = writeln!(text, "{:LABEL$}{line}", if index == 0 { label } else { "" });
    }
}

fn paragraphs(text: &mut String, indent: &str, of: &str) {
    for (index, paragraph) in of.split("\n\n").enumerate() {
        if index > 0 {
            text.push('\n');
        }
        for line in template::wrapped(paragraph, WIDTH - indent.len()) {
            _ = writeln!(text, "{indent}{line}");
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_key_is_explained_with_range_default_source_presets_and_resume() {
        let text = explain("train.batch_size").expect("explained");
        for part in [
            "train.batch_size: a whole number from 1 to 4096\n\nViews per step (DeGauss: 2 for video, 4 for photos).\n",
            "\ndefault   2\n",
            "\nsource    DeGauss: 2 for video, 4 for photos\n",
            "\nresume    a resumed run keeps it\n",
            "\npresets   1 in quickstart, quickstart-degauss, quickstart-4dgs, quickstart-4dgs-motion: Ours:\n",
        ] {
            assert!(text.contains(part), "{part:?} is not in\n{text}");
        }
        assert!(text.lines().all(|line| line.chars().count() <= WIDTH), "{text}");
    }

    #[test]
    fn a_table_and_an_enumeration_are_explained() {
        let table = explain("densify").expect("explained");
        assert!(table.contains("\ndensify.interval: a whole number from 1 to 1e9, default 100\n"), "{table}");
        assert!(table.contains("\ndensify.static: a table\n"), "{table}");
        let choice = explain("motion.temporal").expect("explained");
        assert!(choice.contains("\n  cross\n    The current token attends to its neighbours.\n"), "{choice}");
        assert!(explain("densify.interval").expect("explained").contains("but leaves at least 20"));
        assert!(explain("eval.strips").expect("explained").contains("may change it"));
        assert!(explain("scene.data").expect("explained").contains("default   absent"));
    }

    #[test]
    fn a_misspelt_key_is_refused_with_the_nearest() {
        let error = explain("densify.intervall").expect_err("refused");
        assert_eq!(crate::failure::exit_code(&error), crate::failure::USAGE);
        assert!(error.to_string().contains("Did you mean `densify.interval`?"), "{error}");
        explain("").expect_err("refused");
    }
}
