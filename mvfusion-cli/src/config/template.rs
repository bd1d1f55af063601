//! A configuration file with all that is known of its keys as comments.

use std::fmt::Write as _;

use mvfusion_model::config::{KeyKind, KeyNotes};
use toml::{Table, Value};

use super::Resolved;
use super::keys::KnownKeys;
use super::preset_values::{effective, values_of};

/// Columns of a comment.
const WIDTH: usize = 96;

/// A file for `--config` with every key, set as in `resolved`. Keys that are absent there are comments.
///
/// # Errors
/// If a path in the configuration is not valid UTF-8.
pub fn template(resolved: &Resolved) -> anyhow::Result<String> {
    let template = Template { known: KnownKeys::new()?, values: super::to_toml(&resolved.config)?.parse()?, resolved };
    let mut text = String::new();
    let head = format!(
        "Configuration of mvfusion {}, with the values of the preset `{}` and the options that were given. Keys that are \
         removed have the value of the preset that `train` starts from.",
        env!("CARGO_PKG_VERSION"),
        resolved.preset.name
    );
    comment(&mut text, &head);
    template.write_table("", &mut text)?;
    Ok(text)
}

struct Template<'a> {
    known: KnownKeys,
    values: Table,
    resolved: &'a Resolved,
}

impl Template<'_> {
    /// Writes the keys of a table, then the tables within it, as TOML asks for.
    fn write_table(&self, table: &str, text: &mut String) -> anyhow::Result<()> {
        let (tables, keys): (Vec<_>, Vec<_>) =
            self.known.within(table).partition(|notes| matches!(notes.kind, KeyKind::Table));
        for notes in keys {
            text.push('\n');
            self.write_key(notes, text)?;
        }
        for notes in tables {
            text.push('\n');
            comment(text, &notes.comment);
            _ = writeln!(text, "[{}]", notes.key);
            self.write_table(&notes.key, text)?;
        }
        Ok(())
    }

    fn write_key(&self, notes: &KeyNotes, text: &mut String) -> anyhow::Result<()> {
        comment(text, &notes.comment);
        if let KeyKind::Choice(choices) = &notes.kind {
            for choice in choices {
                let lines = wrapped(&format!("- `{}`: {}", choice.name, choice.comment), WIDTH - 2);
                _ = writeln!(text, "# {}", lines.join("\n#   "));
            }
        }
        let default = notes.default.as_ref().map_or("absent".to_owned(), ToString::to_string);
        let mut facts = match &notes.kind {
            KeyKind::Choice(_) => format!("Default: {default}."),
            kind => format!("Accepts {}. Default: {default}.", kind.in_words()),
        };
        if let Some(table) = &notes.source_table {
            _ = write!(facts, " Source: {} (of `{table}`).", notes.sources.join("; "));
        }
        comment(text, &facts);
        let values = values_of(&notes.key)?;
        if let Some(preset) = effective(&values, self.resolved.preset) {
            let reason = if preset.reason.is_empty() { "no reason is given" } else { &preset.reason };
            comment(text, &format!("Preset `{}`: {}. {reason}", preset.preset.name, preset.value));
        }
        let name = notes.key.rsplit('.').next().unwrap_or_default();
        _ = match value_of(&self.values, &notes.key) {
            Some(value) => writeln!(text, "{name} = {value}"),
            None => writeln!(text, "# {name} = {}", example(&notes.kind)),
        };
        Ok(())
    }
}

fn value_of<'a>(table: &'a Table, key: &str) -> Option<&'a Value> {
    match key.split_once('.') {
        None => table.get(key),
        Some((first, rest)) => value_of(table.get(first)?.as_table()?, rest),
    }
}

/// A value for a key that is absent.
fn example(kind: &KeyKind) -> String {
    match kind {
        KeyKind::Choice(choices) => format!("{:?}", choices.first().map_or("", |choice| &choice.name)),
        KeyKind::Texts => "[\"name\"]".to_owned(),
        _ => "\"path\"".to_owned(),
    }
}

fn comment(text: &mut String, of: &str) {
    for (index, paragraph) in of.split("\n\n").enumerate() {
        if index > 0 {
            text.push_str("#\n");
        }
        for line in wrapped(paragraph, WIDTH) {
            _ = writeln!(text, "# {line}");
        }
    }
}

/// The words of a text in lines of at most `width` columns, unless a word is longer.
pub(super) fn wrapped(text: &str, width: usize) -> Vec<String> {
    let mut lines: Vec<String> = Vec::new();
    for word in text.split_whitespace() {
        match lines.last_mut() {
            Some(line) if line.chars().count() + 1 + word.chars().count() <= width => {
                line.push(' ');
                line.push_str(word);
            }
            _ => lines.push(word.to_owned()),
        }
    }
    lines
}

#[cfg(test)]
mod tests {
    use mvfusion_model::Config;

    use super::super::{PRESETS, resolve};
    use super::*;
    use crate::args::ConfigSourceArgs;

    fn with(preset: &str, set: &[&str]) -> ConfigSourceArgs {
        let set = set.iter().map(|&setting| setting.to_owned()).collect();
        ConfigSourceArgs { preset: Some(preset.to_owned()), set, ..Default::default() }
    }

    #[test]
    fn a_template_is_read_as_the_configuration_that_it_was_made_of() {
        let folder = tempfile::tempdir().expect("folder");
        let file = folder.path().join("template.toml");
        let optional = [
            "scene.data=d",
            "scene.format=neu3d",
            "scene.test_cameras=[\"cam00\"]",
            "eval.dynamic_masks=m",
            "init.box_reach=inf",
            "optim.epsilon=1e-17",
            "seed=9223372036854775807",
        ];
        for preset in PRESETS {
            for set in [&[][..], &optional] {
                let resolved = resolve(&with(preset.name, set), None).expect("resolved");
                std::fs::write(&file, template(&resolved).expect("written")).expect("written");
                // Over the defaults of another preset, because every key is there.
                let args = ConfigSourceArgs { config: Some(file.clone()), ..with("quickstart", &[]) };
                assert_eq!(resolve(&args, None).expect("read").config, resolved.config, "{}", preset.name);
            }
        }
    }

    #[test]
    fn a_template_tells_of_every_key() {
        let text = template(&resolve(&with("quickstart", &[]), None).expect("resolved")).expect("written");
        for notes in Config::key_notes() {
            let name = notes.key.rsplit('.').next().unwrap_or_default();
            let is_there = |line: &str| match notes.kind {
                KeyKind::Table => line == format!("[{}]", notes.key),
                _ => line.trim_start_matches("# ").starts_with(&format!("{name} = ")),
            };
            assert!(text.lines().any(is_there), "{} is missing", notes.key);
        }
        for part in [
            "\n# Views per step (DeGauss: 2 for video, 4 for photos).\n# Accepts a whole number from 1 to 4096. Default: 2.\n",
            "# Preset `quickstart`: 1. Ours: twice as many steps for the same number of views as DeGauss' 2.\nbatch_size = 1\n",
            "\n# data = \"path\"\n",
            "\n# - `cross`: The current token attends to its neighbours.\n",
        ] {
            assert!(text.contains(part), "{part:?} is not in\n{text}");
        }
        assert!(text.lines().all(|line| line.chars().count() <= WIDTH + 2), "a line is too long");
    }
}
