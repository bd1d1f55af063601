//! The output folder: nothing of it is there before all of it is.

use std::ffi::{OsStr, OsString};
use std::fs;
use std::path::{Path, PathBuf};

use super::error::PrepareError;
use crate::files::TemporaryFolder;

/// The record of what was done, in the output folder. A folder without it is never replaced.
pub(super) const RECORD: &str = "prepare.json";

/// COLMAP's log in the output folder.
pub(super) const LOG: &str = "colmap.log";

/// What lies in an output folder beside the videos or frames of cameras. `mvfusion check` draws `check.png`.
const OUTPUTS: [&str; 6] = [RECORD, LOG, "images", "sparse", "sparse_", "check.png"];

/// Beginning of the name of the unfinished folder.
const UNFINISHED: &str = ".unfinished-";

/// The folder in which everything is made, beside the output.
#[derive(Debug)]
pub(super) struct Draft {
    folder: TemporaryFolder,
    out: PathBuf,
}

impl Draft {
    /// Checks the output folder. With `replace`, it may hold an earlier output, and nothing beside that.
    ///
    /// # Errors
    /// [`PrepareError::Occupied`] if it holds something else.
    pub(super) fn check(out: &Path, replace: bool) -> Result<(), PrepareError> {
        let refused = |reason: &str| Err(PrepareError::Occupied { folder: out.to_owned(), reason: reason.to_owned() });
        let entries = match fs::read_dir(out) {
            Err(_) if out.exists() => return refused(" and is no folder that can be listed: give another name"),
            Err(_) => return Ok(()),
            Ok(entries) => {
                entries.map(|entry| entry.map(|entry| entry.file_name())).collect::<Result<Vec<OsString>, _>>()
            }
        };
        let mut entries = entries.map_err(|error| PrepareError::unwritable(out, error))?;
        // The same one is named every time.
        entries.sort();
        match entries.iter().find(|name| !is_own(name)) {
            _ if entries.is_empty() => Ok(()),
            _ if !out.join(RECORD).is_file() => {
                refused(", holds files, and was not made by this command: give a folder that is new or empty")
            }
            _ if !replace => refused(": give another one, or --force to replace it"),
            Some(other) => refused(&format!(
                " and holds `{}`, which this command did not make and --force would remove: move it away, or give \
                 another folder",
                other.display()
            )),
            None => Ok(()),
        }
    }

    /// An empty folder beside the output, or beside the nearest folder above it that exists. Those that killed programs
    /// have left there are removed.
    ///
    /// # Errors
    /// [`PrepareError::Unwritable`].
    pub(super) fn create(out: &Path) -> Result<Self, PrepareError> {
        let out = std::path::absolute(out).map_err(|error| PrepareError::unwritable(out, error))?;
        let parent = out.ancestors().skip(1).find(|folder| folder.is_dir()).unwrap_or(Path::new("."));
        let mut builder = tempfile::Builder::new();
        #[cfg(unix)]
        {
            use std::os::unix::fs::PermissionsExt;
            // By default, only the owner can read temporary folders. The umask still applies.
            builder.permissions(fs::Permissions::from_mode(0o777));
        }
        let folder = TemporaryFolder::new(parent, &mut builder, UNFINISHED);
        let folder = folder.map_err(|error| PrepareError::unwritable(parent, error))?;
        Ok(Self { folder, out })
    }

    /// The folder that becomes the output.
    pub(super) fn scene(&self) -> PathBuf {
        self.folder.path().join("scene")
    }

    /// The folder for what only COLMAP needs.
    pub(super) fn work(&self) -> PathBuf {
        self.folder.path().join("work")
    }

    /// Where the log lies after a failure: beside the output.
    pub(super) fn failed_log(&self) -> PathBuf {
        let name = self.out.file_name().unwrap_or_default().to_string_lossy();
        let folder = self.folder.path().parent().unwrap_or(Path::new("."));
        folder.join(format!("{name}-{LOG}"))
    }

    /// Makes both folders.
    ///
    /// # Errors
    /// [`PrepareError::Unwritable`].
    pub(super) fn make(&self) -> Result<(), PrepareError> {
        for folder in [self.scene(), self.work()] {
            fs::create_dir(&folder).map_err(|error| PrepareError::unwritable(&folder, error))?;
        }
        Ok(())
    }

    /// Keeps COLMAP's log after a failure. An earlier one is replaced.
    pub(super) fn keep_log(&self) {
        let log = self.scene().join(LOG);
        if log.is_file() {
            // Failing here must not hide the error that is to be told.
            let _ = fs::copy(log, self.failed_log());
        }
    }

    /// Puts the scene in its place. What was there is removed once the new one is there.
    ///
    /// # Errors
    /// [`PrepareError::Unwritable`]; then what was there still is, or the error says where it went.
    pub(super) fn publish(self) -> Result<(), PrepareError> {
        let unwritable = |error: std::io::Error| PrepareError::unwritable(&self.out, error);
        if let Some(parent) = self.out.parent() {
            fs::create_dir_all(parent).map_err(unwritable)?;
        }
        let aside = self.folder.path().join("replaced");
        let is_replaced = self.out.exists();
        if is_replaced {
            // If the program is killed before the scene is in its place, the folder has the only copy of the former one.
            self.folder.set_kept(true).map_err(unwritable)?;
            fs::rename(&self.out, &aside).map_err(unwritable)?;
        }
        if let Err(error) = fs::rename(self.scene(), &self.out) {
            if is_replaced && fs::rename(&aside, &self.out).is_err() {
                let reason = format!("{error}; what was there is in {}", self.folder.keep().display());
                return Err(PrepareError::unwritable(&self.out, reason));
            }
            return Err(unwritable(error));
        }
        if is_replaced {
            // If this fails, the folder stays after a kill, and nothing is lost.
            let _ = self.folder.set_kept(false);
        }
        // A log of a failure before has no meaning any more.
        let _ = fs::remove_file(self.failed_log());
        Ok(())
    }
}

/// Whether a preparation makes an entry of this name, or the check of the scene after it.
fn is_own(name: &OsStr) -> bool {
    let Some(name) = name.to_str() else { return false };
    let camera = || name.strip_suffix(".mp4").unwrap_or(name).strip_prefix("cam");
    let is_number = |text: &str| !text.is_empty() && text.bytes().all(|byte| byte.is_ascii_digit());
    OUTPUTS.contains(&name) || camera().is_some_and(is_number)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_output_appears_as_a_whole_and_nothing_stays_beside_it() {
        let folder = tempfile::tempdir().expect("folder");
        let out = folder.path().join("a/b/scene");
        Draft::check(&out, false).expect("new");
        let draft = Draft::create(&out).expect("made");
        draft.make().expect("made");
        fs::write(draft.scene().join(RECORD), "1").expect("written");
        assert!(!folder.path().join("a").exists());
        draft.publish().expect("published");
        assert_eq!(fs::read_to_string(out.join(RECORD)).expect("read"), "1");
        assert_eq!(fs::read_dir(folder.path()).expect("listed").count(), 1);
    }

    #[test]
    fn only_an_earlier_output_is_replaced_and_only_if_asked() {
        let folder = tempfile::tempdir().expect("folder");
        let out = folder.path().join("scene");
        fs::create_dir(&out).expect("made");
        Draft::check(&out, false).expect("empty");
        fs::write(out.join("thesis.txt"), "mine").expect("written");
        assert!(Draft::check(&out, true).expect_err("not ours").to_string().contains("was not made by this command"));
        fs::write(out.join(RECORD), "old").expect("written");
        assert!(Draft::check(&out, false).expect_err("there").to_string().contains("--force"));
        let said = Draft::check(&out, true).expect_err("the user's").to_string();
        assert!(said.contains("holds `thesis.txt`"), "{said}");
        fs::remove_file(out.join("thesis.txt")).expect("moved away");
        for name in ["cam07.mp4", "check.png"] {
            fs::write(out.join(name), "old").expect("written");
        }
        Draft::check(&out, true).expect("ours");
        let draft = Draft::create(&out).expect("made");
        draft.make().expect("made");
        fs::write(draft.scene().join(RECORD), "new").expect("written");
        draft.publish().expect("published");
        assert_eq!(fs::read_to_string(out.join(RECORD)).expect("read"), "new");
        assert!(!out.join("cam07.mp4").exists());
        assert!(Draft::check(&out.join(RECORD), true).expect_err("a file").to_string().contains("is no folder"));
    }

    #[test]
    fn what_a_killed_preparation_left_goes_with_the_next_one() {
        let folder = tempfile::tempdir().expect("folder");
        let out = folder.path().join("scene");
        let running = Draft::create(&out).expect("made");
        running.make().expect("made");
        let left = folder.path().join(format!("{UNFINISHED}left"));
        fs::create_dir_all(left.join("scene")).expect("made");
        fs::write(left.join("in-use"), "").expect("written");
        Draft::create(&out).expect("made").make().expect("made");
        assert!(!left.exists() && running.scene().is_dir());
    }

    #[test]
    fn a_failure_leaves_nothing_but_the_log() {
        let folder = tempfile::tempdir().expect("folder");
        let draft = Draft::create(&folder.path().join("scene")).expect("made");
        draft.make().expect("made");
        fs::write(draft.scene().join(LOG), "why").expect("written");
        draft.keep_log();
        drop(draft);
        let left: Vec<PathBuf> = fs::read_dir(folder.path()).expect("listed").flatten().map(|e| e.path()).collect();
        assert_eq!(left, [folder.path().join("scene-colmap.log")]);
    }
}
