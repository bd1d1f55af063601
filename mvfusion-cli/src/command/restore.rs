//! `mvfusion restore`.

use std::io::Write;
use std::path::Path;

use anyhow::bail;

use crate::args::RestoreArgs;
use crate::export::{CAMERAS, CONTENTS};
use crate::interrupt::resume_command;
use crate::run::{self, Contents, RunFolder};

/// Brings a replaced run or export back in place of what was to replace it.
///
/// # Errors
/// If none waits, another process writes to the folder, or the unfinished run can be continued and `--force` is absent.
pub fn restore(args: &RestoreArgs, out: &mut dyn Write) -> anyhow::Result<()> {
    let contents = contents(&args.run);
    let waited = run::waits(&args.run);
    let folder = RunFolder::continued_with(&args.run, contents)?;
    let (path, what) = (args.run.display(), contents.what);
    // A kill may have left nothing to decide: locking the folder has put back what was on its way.
    if !run::waits(&args.run) {
        match run::is_finished(&args.run) {
            true => return Ok(writeln!(out, "The run in {path} is finished, and no other one waits there.")?),
            false if waited => return Ok(writeln!(out, "The {what} that was on its way is back in {path}.")?),
            false => bail!("no replaced {what} waits in {path}."),
        }
    }
    if !args.force && !run::checkpoints(&args.run)?.is_empty() {
        bail!(
            "{path} contains an unfinished run with a checkpoint. Continue it with `{}`, or use --force to remove it and \
             bring the replaced run back.",
            resume_command(&args.run)
        );
    }
    folder.restore()?;
    Ok(writeln!(out, "The replaced {what} is back in {path}.")?)
}

/// What a folder is for, by the file that every such folder has. A training may have been killed before it wrote any.
fn contents(folder: &Path) -> Contents {
    match !run::has_anywhere(folder, run::RECORD) && run::has_anywhere(folder, CAMERAS) {
        true => CONTENTS,
        false => run::RUN,
    }
}

#[cfg(test)]
mod tests {
    use std::fs;

    use super::*;

    /// What the command says of a folder.
    fn restored(folder: &Path) -> anyhow::Result<String> {
        let mut said = Vec::new();
        restore(&RestoreArgs { run: folder.to_owned(), force: false }, &mut said)?;
        Ok(String::from_utf8(said).expect("UTF-8"))
    }

    fn write(folder: &Path, files: &[&str], text: &str) {
        for file in files {
            let path = folder.join(file);
            fs::create_dir_all(path.parent().expect("a folder")).expect("made");
            fs::write(path, text).expect("written");
        }
    }

    #[test]
    fn an_export_that_was_being_replaced_comes_back_whole() {
        let folder = tempfile::tempdir().expect("folder");
        let path = folder.path();
        let files = ["cameras.json", "dynamic.ply", "frames/frame0001.ply", "frames/frame0002.ply"];
        write(&path.join(".replaced"), &files, "old");
        write(path, &files[..3], "new");
        let said = restored(path).expect("restored");
        assert!(said.starts_with("The replaced export is back"), "{said}");
        for file in files {
            assert_eq!(fs::read_to_string(path.join(file)).expect("read"), "old", "{file}");
        }
        assert_eq!(fs::read_dir(path).expect("listed").count(), 3);
        assert!(restored(path).expect_err("refused").to_string().contains("no replaced export waits"));
    }

    #[test]
    fn an_export_that_was_on_its_way_aside_is_put_back() {
        let folder = tempfile::tempdir().expect("folder");
        write(&folder.path().join(".moving"), &["frames/frame0001.ply"], "old");
        write(folder.path(), &["cameras.json"], "old");
        assert!(restored(folder.path()).expect("restored").contains("export that was on its way is back"));
        assert!(folder.path().join("frames/frame0001.ply").is_file());
    }

    #[test]
    fn a_run_comes_back_even_if_nothing_tells_what_it_was() {
        let folder = tempfile::tempdir().expect("folder");
        write(&folder.path().join(".replaced"), &["results.json"], "old");
        write(folder.path(), &["metrics.jsonl"], "");
        assert!(restored(folder.path()).expect("restored").starts_with("The replaced run is back"));
    }
}
