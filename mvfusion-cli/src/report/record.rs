//! The sections for the record, the raw metrics and the configuration.

use maud::{Markup, html};
use serde_json::Value;

use super::files::RunFiles;
use super::snippet::notice;
use crate::interrupt::for_shell;
use crate::run;

/// The parts of `results.json` that say where the metrics come from.
const CIRCUMSTANCES: [&str; 4] = ["program", "machine", "lpips_folder", "size"];

/// `run.json` as a table, and `results.json` unchanged.
pub(super) fn record(files: &RunFiles) -> Markup {
    html! {
        @match &files.record {
            Ok(record) => div.scroll { table.record { tbody {
                @for (name, value) in entries(record) { tr { th scope="row" { (name) } td { (value) } } }
            } } },
            Err(missing) => (notice(missing)),
        }
        @if let Ok(results) = &files.results_value { (circumstances(results)) }
        @match &files.results_value {
            Ok(results) => details {
                summary { (run::RESULTS) ", in full precision" }
                @if has_names_of_the_field(results) {
                    p.note {
                        "The entry " code { "ours_\u{2026}" } " uses the names that scripts of 3DGS and its \
                        descendants read. Its LPIPS inputs are in [0, 1], so its LPIPS-vgg is LPIPS-vgg on [0,1] in \
                        the tables."
                    }
                }
                pre { (serde_json::to_string_pretty(results).unwrap_or_else(|error| error.to_string())) }
            },
            Err(missing) => (notice(missing)),
        }
    }
}

/// The program and the machine that computed the metrics, and what the model takes on disk, as far as it is known.
fn circumstances(results: &Value) -> Markup {
    let known = CIRCUMSTANCES.iter().filter_map(|&name| Some((name, results.get(name)?)));
    let mut rows = Vec::new();
    known.for_each(|(name, value)| collect(value, name, &mut rows));
    html! {
        @if !rows.is_empty() {
            h3 { "The metrics" }
            div.scroll { table.record { tbody {
                @for (name, value) in rows { tr { th scope="row" { (name) } td { (value) } } }
            } } }
        }
    }
}

/// Whether the metrics are also stored under names that mean something else in the tables of the page.
fn has_names_of_the_field(results: &Value) -> bool {
    results.as_object().is_some_and(|parts| parts.keys().any(|name| name.starts_with("ours_")))
}

/// The complete configuration.
pub(super) fn config(files: &RunFiles) -> Markup {
    html! {
        @match &files.config_text {
            Ok(text) => {
                p.note { code { (repetition(files)) } " repeats the run." }
                details { summary { (run::CONFIG) ", " (text.lines().count()) " lines" } pre { (text) } }
            },
            Err(missing) => (notice(missing)),
        }
        @if let (Err(missing), Ok(_)) = (&files.config, &files.config_text) { (notice(missing)) }
    }
}

/// The command that repeats the run. The configuration does not say from which weights it began.
fn repetition(files: &RunFiles) -> String {
    let command = format!("mvfusion train --config {}", run::CONFIG);
    match files.recorded(&["init_from", "run"]) {
        Some(source) => format!("{command} --init-from {}", for_shell(&source)),
        None => command,
    }
}

/// The values of a record by dotted name. Lists of plain values become one line.
fn entries(record: &Value) -> Vec<(String, String)> {
    let mut found = Vec::new();
    collect(record, "", &mut found);
    found
}

fn collect(value: &Value, name: &str, found: &mut Vec<(String, String)>) {
    match value {
        Value::Object(parts) => {
            for (key, part) in parts {
                let name = if name.is_empty() { key.clone() } else { format!("{name}.{key}") };
                collect(part, &name, found);
            }
        }
        Value::Array(items) => {
            // Quoted, so that an argument with a space is recognised as one argument.
            let shown: Vec<String> = items.iter().map(|item| for_shell(&plain(item)).into_owned()).collect();
            found.push((name.to_owned(), shown.join(" ")));
        }
        other => found.push((name.to_owned(), plain(other))),
    }
}

fn plain(value: &Value) -> String {
    match value {
        Value::String(text) => text.clone(),
        other => other.to_string(),
    }
}

#[cfg(test)]
mod tests {
    use serde_json::json;

    use super::*;

    #[test]
    fn a_run_that_began_with_other_weights_is_repeated_with_them() {
        let folder = tempfile::tempdir().expect("folder");
        let command = |record: Value| {
            std::fs::write(folder.path().join(run::RECORD), record.to_string()).expect("written");
            repetition(&RunFiles::read(folder.path()).expect("read"))
        };
        assert_eq!(command(json!({"preset": "a"})), "mvfusion train --config config.toml");
        let weights = json!({"run": "/runs/my first", "steps": 7, "params_sha256": "c0ffee"});
        let expected = "mvfusion train --config config.toml --init-from '/runs/my first'";
        assert_eq!(command(json!({"init_from": weights})), expected);
    }

    #[test]
    fn records_of_any_version_become_lines() {
        let record = json!({"command": ["mvfusion", "a b"], "git": {"commit": "c0ffee", "dirty": true}, "seed": 7});
        let line = |name: &str, value: &str| (name.to_owned(), value.to_owned());
        let expected = [
            line("command", "mvfusion 'a b'"),
            line("git.commit", "c0ffee"),
            line("git.dirty", "true"),
            line("seed", "7"),
        ];
        assert_eq!(entries(&record), expected);
        assert_eq!(entries(&json!("text")), [line("", "text")]);
    }
}
