//! The answers, as they are written: JSON for programs, a Markdown table for people.

use std::fmt::Write;
use std::fs;
use std::path::Path;

use anyhow::{Context, Result};
use serde::Serialize;
use serde_json::Value;

use super::outcome::{Outcome, Tests};

/// What an entry answered.
#[derive(Debug, Serialize)]
pub(super) struct Answer {
    pub name: &'static str,
    pub command: String,
    /// What the reader should look for.
    pub look_for: &'static str,
    pub outcome: Outcome,
    pub seconds: f64,
    /// Numbers of tests, if it was tests that were run.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub tests: Option<Tests>,
    /// The last lines that were said.
    pub said: Vec<String>,
    /// The figures that the program wrote as JSON.
    #[serde(skip_serializing_if = "Value::is_null")]
    pub figures: Value,
}

/// Writes `gpu.json` and `gpu.md`.
pub(super) fn write(out: &Path, device: &str, rehearsal: bool, answers: &[Answer]) -> Result<()> {
    let json = serde_json::to_string_pretty(answers)?;
    for (name, text) in [("gpu.json", json), ("gpu.md", table(device, rehearsal, answers))] {
        let path = out.join(name);
        fs::write(&path, text).with_context(|| format!("cannot write {}", path.display()))?;
    }
    Ok(())
}

fn table(device: &str, rehearsal: bool, answers: &[Answer]) -> String {
    let rehearsal = if rehearsal { " in a rehearsal" } else { "" };
    let mut text = format!(
        "# What {device} answered{rehearsal}\n\n\
         \"Ended\" says that the exit status was 0; of tests, that some ran and none failed. Whether an answer is good \
         is for the reader to see.\n\n\
         | entry | outcome | seconds | what to look for |\n|---|---|---|---|\n"
    );
    let mut add = |line: String| {
        // Proof: writing to a string does not fail.
        writeln!(text, "{line}").expect("a string");
    };
    for Answer { name, outcome, seconds, tests, look_for, .. } in answers {
        let tests = tests.map_or(String::new(), |tests| format!(": {tests}"));
        add(format!("| {name} | {}{tests} | {seconds:.1} | {look_for} |", outcome.word()));
    }
    for answer in answers {
        add(format!("\n## {}\n`{}`\n```\n{}\n```", answer.name, answer.command, answer.said.join("\n")));
    }
    text
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_table_tells_an_outcome_from_what_to_look_for() {
        let tests = Tests::of("test result: ok. 3 passed; 0 failed; 2 ignored; 0 measured; 0 filtered out");
        let answer = Answer {
            name: "parity",
            command: "oracles parity".to_owned(),
            look_for: "every op agrees",
            outcome: Outcome::Ended,
            seconds: 1.26,
            tests,
            said: vec!["words".to_owned()],
            figures: Value::Null,
        };
        let text = table("wgpu:0", true, &[answer]);
        for part in [
            "# What wgpu:0 answered in a rehearsal\n",
            "| parity | ended: 3 passed, 0 failed, 2 ignored | 1.3 | every op agrees |\n",
            "\n## parity\n`oracles parity`\n```\nwords\n```\n",
        ] {
            assert!(text.contains(part), "`{part}` is missing: {text}");
        }
    }
}
