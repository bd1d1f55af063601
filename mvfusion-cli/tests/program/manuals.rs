//! Completions, manual pages, and what `config` tells of the keys.

use std::fs;
use std::process::{Command, Stdio};

use super::{FAILED, USAGE, mvfusion, program};

fn printed(arguments: &[&str]) -> String {
    let folder = tempfile::tempdir().expect("folder");
    let output = mvfusion(folder.path(), arguments);
    assert!(output.status.success(), "{arguments:?}: {}", String::from_utf8_lossy(&output.stderr));
    String::from_utf8(output.stdout).expect("text")
}

#[test]
fn every_shell_completes_commands_presets_and_keys() {
    for shell in ["bash", "elvish", "fish", "powershell", "zsh"] {
        let script = printed(&["completions", shell]);
        assert!(script.contains("template"), "{shell}");
        // The generators for these two offer no values.
        let offers = !matches!(shell, "elvish" | "powershell");
        assert_eq!(script.contains("robustnerf-degauss"), offers, "{shell}");
        assert_eq!(script.contains("densify.static.threshold"), offers, "{shell}");
    }
}

#[cfg(unix)]
#[test]
fn bash_completes_with_its_script() {
    let Ok(version) = Command::new("bash").arg("--version").stdout(Stdio::null()).status() else { return };
    assert!(version.success());
    let folder = tempfile::tempdir().expect("folder");
    let script = folder.path().join("completions");
    fs::write(&script, printed(&["completions", "bash"])).expect("written");
    let complete = |words: &str| {
        let asked = format!(
            "source '{}'; COMP_WORDS=({words}); COMP_CWORD=$((${{#COMP_WORDS[@]}} - 1)); \
             _mvfusion mvfusion \"${{COMP_WORDS[COMP_CWORD]}}\" \"${{COMP_WORDS[COMP_CWORD-1]}}\"; \
             echo \"${{COMPREPLY[@]}}\"",
            script.display()
        );
        let output = Command::new("bash").args(["--norc", "-c", &asked]).output().expect("bash");
        assert!(output.stderr.is_empty(), "{}", String::from_utf8_lossy(&output.stderr));
        String::from_utf8(output.stdout).expect("text").trim().to_owned()
    };
    assert_eq!(complete("mvfusion pres"), "presets");
    assert_eq!(complete("mvfusion train --preset hypernerf-4dgs-"), "hypernerf-4dgs-motion");
    assert_eq!(complete("mvfusion config --explain model.grid.b"), "model.grid.bounds");
}

#[test]
fn every_command_has_a_manual_page_with_its_examples() {
    let folder = tempfile::tempdir().expect("folder");
    let output = mvfusion(folder.path(), &["man", "--out", "a/b"]);
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    let page = |name: &str| fs::read_to_string(folder.path().join("a/b").join(name)).expect(name);
    assert!(page("mvfusion.1").contains("mvfusion\\-train"), "the commands are listed");
    let train = page("mvfusion-train.1");
    // The examples keep their lines.
    let examples = train.split(".nf\n").nth(1).expect("lines").split(".fi\n").next().expect("an end");
    assert!(examples.contains("\n  mvfusion train \\-\\-set scene.kind=casual\n"), "{examples}");
    assert!(train.contains("checkpoint"), "{train}");
    assert!(page("mvfusion-sweep-status.1").starts_with(".ie"), "an inner command");
    let files = fs::read_dir(folder.path().join("a/b")).expect("the folder").count();
    assert_eq!(files, String::from_utf8(output.stdout).expect("text").lines().count());
}

#[test]
fn a_reader_that_leaves_costs_neither_the_work_nor_the_failure() {
    let folder = tempfile::tempdir().expect("folder");
    let code = |arguments: &[&str]| {
        let (reader, writer) = std::io::pipe().expect("a pipe");
        drop(reader);
        let mut command = program();
        command.args(arguments).current_dir(folder.path()).stdout(writer).stderr(Stdio::null());
        command.status().expect("the program starts").code()
    };
    assert_eq!(code(&["man", "--out", "pages"]), Some(0));
    let pages = fs::read_dir(folder.path().join("pages")).expect("the folder").count();
    assert!(pages > 10, "{pages}");
    fs::create_dir(folder.path().join("empty")).expect("made");
    assert_eq!(code(&["check", "empty", "--device", "cpu"]), Some(FAILED));
}

#[test]
fn what_has_no_effect_is_refused() {
    let folder = tempfile::tempdir().expect("folder");
    for arguments in [
        &["config", "--explain", "seed", "--set", "seed=1"][..],
        &["config", "--schema", "--preset", "neu3d"],
        &["config", "--schema", "--template"],
        &["config", "--explain", "no.such.key.at.all"],
        &["completions", "tcsh"],
        &["man"],
    ] {
        let output = mvfusion(folder.path(), arguments);
        assert_eq!(output.status.code(), Some(USAGE), "{arguments:?}");
        assert!(output.stdout.is_empty(), "{arguments:?}");
    }
    let said = printed(&["config", "--explain", "densify"]);
    assert!(said.starts_with("densify: a table\n"), "{said}");
    let schema = printed(&["config", "--schema"]);
    assert!(schema.contains("https://json-schema.org/draft/2020-12/schema"), "{schema}");
}
