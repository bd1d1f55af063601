//! A temporary folder. It is removed when the program ends. If the program was killed, the next one that needs such a
//! folder at the same place removes it.

use std::fs::{self, File};
use std::io;
use std::path::Path;

use tempfile::{Builder, TempDir};

/// A file in the folder that is locked while the folder is used. The system releases the lock when the program ends,
/// however it ends.
const IN_USE: &str = "in-use";

/// The folder. It is removed with its content when dropped.
#[derive(Debug)]
pub(crate) struct TemporaryFolder {
    /// Dropped before the folder, because some systems cannot remove an open file.
    _in_use: File,
    folder: TempDir,
}

impl TemporaryFolder {
    /// A new folder in `parent` whose name begins with `prefix`. Removes the folders of killed programs there.
    /// `builder` decides who may enter it.
    pub(crate) fn new<'a>(parent: &Path, builder: &mut Builder<'a, '_>, prefix: &'a str) -> io::Result<Self> {
        Self::remove_abandoned(parent, prefix);
        let folder = builder.prefix(prefix).tempdir_in(parent)?;
        // The file gets its name once it is locked. Folders without such a file are not removed.
        let unlocked = folder.path().join("unlocked");
        let in_use = File::create(&unlocked)?;
        if in_use.try_lock().is_ok() {
            fs::rename(&unlocked, folder.path().join(IN_USE))?;
        }
        Ok(Self { _in_use: in_use, folder })
    }

    pub(crate) fn path(&self) -> &Path {
        self.folder.path()
    }

    /// Removes the folders of killed programs whose names begin with `prefix`. Failure is harmless: a folder may belong
    /// to another user.
    pub(crate) fn remove_abandoned(parent: &Path, prefix: &str) {
        let Ok(entries) = fs::read_dir(parent) else { return };
        for entry in entries.flatten().filter(|entry| entry.file_name().to_string_lossy().starts_with(prefix)) {
            let in_use = entry.path().join(IN_USE);
            // Checked first, because opening a pipe could block forever.
            let is_ours = entry.file_type().is_ok_and(|kind| kind.is_dir())
                && fs::symlink_metadata(&in_use).is_ok_and(|metadata| metadata.is_file());
            if is_ours && File::options().write(true).open(&in_use).is_ok_and(|file| file.try_lock().is_ok()) {
                let _ = fs::remove_dir_all(entry.path());
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const PREFIX: &str = "mvfusion-test-";

    fn made(parent: &Path) -> TemporaryFolder {
        TemporaryFolder::new(parent, &mut Builder::new(), PREFIX).expect("made")
    }

    #[test]
    fn a_folder_that_its_program_left_behind_goes_and_one_in_use_stays() {
        let parent = tempfile::tempdir().expect("folder");
        let left = parent.path().join(format!("{PREFIX}left"));
        fs::create_dir_all(left.join("cam00")).expect("made");
        fs::write(left.join(IN_USE), b"").expect("written");
        let other = parent.path().join(format!("{PREFIX}other"));
        fs::create_dir_all(&other).expect("made");

        let used = made(parent.path());
        assert!(!left.exists() && other.exists());
        let second = made(parent.path());
        assert!(used.path().exists() && second.path().exists());
        let path = used.path().to_owned();
        drop(used);
        assert!(!path.exists() && second.path().exists());
    }
}
