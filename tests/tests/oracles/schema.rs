//! The JSON schema of configuration files, in a judge that others wrote: it accepts every preset, and refuses a wrong value
//! of every key.

use anyhow::{Context, Result, ensure};
use libtest_mimic::{Completion, Trial};
use mvfusion_cli::args::ConfigSourceArgs;
use mvfusion_cli::config::{self, PRESETS};
use mvfusion_model::config::{Config, KeyKind, NumberKind};
use serde_json::{Map, Value, json};

use crate::failed;
use crate::foreign::Module;

/// Python's own reader of TOML and the judge: prints the names of the files on which it is of another mind.
const JSONSCHEMA: Module = Module {
    name: "jsonschema",
    probe: "import jsonschema, tomllib; jsonschema.Draft202012Validator",
    script: "\
import json, jsonschema, sys, tomllib
given = json.load(open(sys.argv[1], encoding='utf-8'))
jsonschema.Draft202012Validator.check_schema(given['schema'])
judge = jsonschema.Draft202012Validator(given['schema'])
for kind, wanted in (('good', True), ('bad', False)):
    for name, text in given[kind].items():
        if judge.is_valid(tomllib.loads(text)) != wanted:
            print(kind, name)
",
};

/// The least number of wrong files, far below that of today: keys that are not found would make none.
const LEAST_BAD: usize = 400;

/// All trials.
pub fn trials() -> Vec<Trial> {
    vec![Trial::ignorable_test("foreign::schema::python_jsonschema", || {
        if let Some(reason) = JSONSCHEMA.absent() {
            return Ok(Completion::ignored_with(reason));
        }
        presets_are_accepted_and_wrong_values_refused().map_err(failed)?;
        Ok(Completion::Completed)
    })]
}

fn presets_are_accepted_and_wrong_values_refused() -> Result<()> {
    let (good, bad) = (good_files()?, bad_files());
    ensure!(bad.len() > LEAST_BAD, "there are only {} wrong files", bad.len());
    let given = json!({ "schema": Config::schema(), "good": good, "bad": bad });
    let folder = tempfile::tempdir()?;
    let path = folder.path().join("given.json");
    std::fs::write(&path, given.to_string())?;
    let said = JSONSCHEMA.read(&path)?;
    ensure!(said.is_empty(), "jsonschema is of another mind on:\n{said}");
    Ok(())
}

/// What a preset itself says, the whole configuration, and the template, for each preset.
fn good_files() -> Result<Map<String, Value>> {
    let mut files = Map::from_iter([("empty".to_owned(), "".into())]);
    for preset in PRESETS {
        let args = ConfigSourceArgs { preset: Some(preset.name.to_owned()), ..Default::default() };
        let resolved = config::resolve(&args, None).with_context(|| format!("the preset {}", preset.name))?;
        files.insert(preset.name.to_owned(), preset.text.into());
        files.insert(format!("all of {}", preset.name), config::to_toml(&resolved.config)?.into());
        files.insert(format!("template of {}", preset.name), config::template(&resolved)?.into());
    }
    Ok(files)
}

/// Files with one wrong line.
fn bad_files() -> Map<String, Value> {
    let mut files = Map::new();
    let mut add = |key: &str, value: &str| files.insert(format!("{key} = {value}"), format!("{key} = {value}").into());
    add("sede", "1");
    for notes in Config::key_notes() {
        let key = notes.key.as_str();
        match &notes.kind {
            KeyKind::Table => {
                add(key, "1");
                add(&format!("{key}.unknown"), "1");
            }
            KeyKind::Flag => _ = add(key, "\"true\""),
            KeyKind::Text | KeyKind::Texts => _ = add(key, "3"),
            KeyKind::Choice(choices) => {
                add(key, &format!("{:?}", format!("{}x", choices[0].name)));
                add(key, "true");
            }
            &KeyKind::Number { kind, least, most, items } => {
                add(key, "\"1\"");
                for number in [least - 1.0, 2.0 * most + 1.0].into_iter().filter(|number| number.abs() < 1e18) {
                    let number = if kind == NumberKind::Real { format!("{number:?}") } else { format!("{number}") };
                    let count = items.unwrap_or(1) as usize;
                    let list = || format!("[{}]", vec![number.as_str(); count].join(", "));
                    add(key, &if kind == NumberKind::List { list() } else { number.clone() });
                }
                match kind {
                    NumberKind::Whole => _ = add(key, "1.5"),
                    NumberKind::List => _ = add(key, "[4.5, 4, 4, 4]"),
                    NumberKind::Real => {}
                }
            }
        }
    }
    files
}
