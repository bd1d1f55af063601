//! A temporary folder. It is removed when the program ends. If the program was killed, the next one on the same machine
//! that needs such a folder at the same place removes it.

use std::fs::{self, File};
use std::io::{self, Read, Write};
use std::path::Path;

use tempfile::{Builder, TempDir};

/// A file in the folder that is locked while the folder is used, with the name of the machine: on shared storage, other
/// machines may not see the lock. The system releases the lock when the program ends, however it ends.
const IN_USE: &str = "in-use";

/// The name of that file while nobody may conclude anything from it. Folders without [`IN_USE`] are not removed.
const UNDECIDED: &str = "undecided";

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
        let undecided = folder.path().join(UNDECIDED);
        let mut in_use = File::create(&undecided)?;
        in_use.write_all(host().as_bytes())?;
        if in_use.try_lock().is_ok() {
            fs::rename(&undecided, folder.path().join(IN_USE))?;
        }
        Ok(Self { _in_use: in_use, folder })
    }

    /// From now on, the folder stays if the program is killed, because it has something to lose.
    pub(crate) fn keep_if_killed(&self) -> io::Result<()> {
        let [in_use, undecided] = [IN_USE, UNDECIDED].map(|name| self.path().join(name));
        match fs::rename(in_use, undecided) {
            // The file system has no locks.
            Err(error) if error.kind() == io::ErrorKind::NotFound => Ok(()),
            result => result,
        }
    }

    pub(crate) fn path(&self) -> &Path {
        self.folder.path()
    }

    /// Removes the folders of killed programs of this machine whose names begin with `prefix`. Failure is harmless: a
    /// folder may belong to another user.
    pub(crate) fn remove_abandoned(parent: &Path, prefix: &str) {
        let Ok(entries) = fs::read_dir(parent) else { return };
        for entry in entries.flatten().filter(|entry| entry.file_name().to_string_lossy().starts_with(prefix)) {
            let in_use = entry.path().join(IN_USE);
            // Checked first, because opening a pipe could block forever.
            let is_ours = entry.file_type().is_ok_and(|kind| kind.is_dir())
                && fs::symlink_metadata(&in_use).is_ok_and(|metadata| metadata.is_file());
            if is_ours && is_abandoned(&in_use).unwrap_or(false) {
                let _ = fs::remove_dir_all(entry.path());
            }
        }
    }
}

/// Whether a program of this machine made the file and has ended.
fn is_abandoned(in_use: &Path) -> io::Result<bool> {
    let file = File::options().read(true).write(true).open(in_use)?;
    let host = host();
    let mut text = String::new();
    (&file).take(host.len() as u64 + 1).read_to_string(&mut text)?;
    Ok(text == host && file.try_lock().is_ok())
}

/// The name of this machine.
fn host() -> String {
    gethostname::gethostname().to_string_lossy().into_owned()
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
        fs::write(left.join(IN_USE), host()).expect("written");
        let other = parent.path().join(format!("{PREFIX}other"));
        fs::create_dir_all(&other).expect("made");
        fs::write(other.join(IN_USE), format!("{}-2", host())).expect("written");

        let used = made(parent.path());
        assert!(!left.exists() && other.exists());
        let second = made(parent.path());
        assert!(used.path().exists() && second.path().exists());
        let path = used.path().to_owned();
        drop(used);
        assert!(!path.exists() && second.path().exists());
    }

    #[test]
    fn a_folder_with_something_to_lose_stays_after_a_kill() {
        let parent = tempfile::tempdir().expect("folder");
        let used = made(parent.path());
        used.keep_if_killed().expect("renamed");
        let TemporaryFolder { _in_use, folder } = used;
        // As if the program was killed: the lock goes, the folder stays.
        drop(_in_use);
        let path = folder.keep();
        drop(made(parent.path()));
        assert!(path.exists());
    }
}
