//! What the presets make of a key, and why.

use std::sync::LazyLock;

use toml::Value;

use crate::failure::UsageError;

use super::partial::{Origin, PartialConfig, leaves};
use super::preset::{PRESETS, Preset};

/// A value that a preset itself gives to a key.
#[derive(Clone, Debug)]
pub struct PresetValue {
    /// The preset.
    pub preset: &'static Preset,
    /// The value.
    pub value: Value,
    /// The comment in the preset's file; empty if there is none.
    pub reason: String,
}

/// The presets that set a key, with their values.
///
/// # Errors
/// Never, unless a preset that ships with the program is not TOML.
pub fn values_of(key: &str) -> Result<Vec<PresetValue>, UsageError> {
    // A template asks for every key.
    static PARSED: LazyLock<Result<Vec<PartialConfig>, UsageError>> = LazyLock::new(|| {
        PRESETS.iter().map(|preset| PartialConfig::parse(preset.text, Origin::Preset(preset.name))).collect()
    });
    let mut values = Vec::new();
    for (preset, partial) in PRESETS.iter().zip(PARSED.as_ref().map_err(Clone::clone)?) {
        if let Some((_, value)) = leaves(&partial.table).into_iter().find(|(name, _)| name == key) {
            let reason = partial.line(key).map_or(String::new(), |line| comment_above(preset.text, line));
            values.push(PresetValue { preset, value: value.clone(), reason });
        }
    }
    Ok(values)
}

/// Of these values, the one that a preset has: its own, or that of the nearest preset it builds on.
pub fn effective<'a>(values: &'a [PresetValue], preset: &'static Preset) -> Option<&'a PresetValue> {
    let sets = |ancestor: &&'static Preset| values.iter().find(|value| value.preset == *ancestor);
    preset.lineage().iter().rev().find_map(sets)
}

/// The nearest comment above a line of TOML, within the same block of lines.
fn comment_above(text: &str, line: usize) -> String {
    let lines: Vec<&str> = text.lines().take(line - 1).collect();
    let is_border = |line: &&str| line.is_empty() || line.starts_with(['#', '[']);
    let end = lines.iter().rposition(is_border).map_or(0, |index| index + 1);
    let start = lines[..end].iter().rposition(|line| !line.starts_with('#')).map_or(0, |index| index + 1);
    let words: Vec<&str> = lines[start..end].iter().map(|line| line.trim_start_matches('#').trim()).collect();
    words.join(" ")
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_reason_is_the_comment_of_the_block() {
        let text = "# File.\n\n[a]\n# One,\n# two.\nx = 1\ny = 2\n\nz = 3\n";
        for (line, reason) in [(6, "One, two."), (7, "One, two."), (9, "")] {
            assert_eq!(comment_above(text, line), reason, "line {line}");
        }
    }

    #[test]
    fn a_preset_has_the_values_of_what_it_builds_on() {
        let values = values_of("train.batch_size").expect("presets");
        let of = |name| effective(&values, Preset::find(name).expect("a preset"));
        let quick = of("quickstart-4dgs-motion").expect("inherited");
        assert_eq!((quick.preset.name, &quick.value), ("quickstart", &Value::Integer(1)));
        assert!(quick.reason.starts_with("Ours: twice as many steps"), "{}", quick.reason);
        assert!(of("neu3d").is_none());
    }
}
