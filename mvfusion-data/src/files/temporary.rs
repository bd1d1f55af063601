//! A temporary folder. It is removed when the program ends. If the program was killed, the next one on the same machine
//! that needs such a folder at the same place removes it.

use std::fs::{self, File};
use std::io::{self, Read, Write};
use std::path::{Path, PathBuf};

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

    /// Whether the folder stays if the program is killed from now on, because it has something to lose.
    pub(crate) fn set_kept(&self, is_kept: bool) -> io::Result<()> {
        let [in_use, undecided] = [IN_USE, UNDECIDED].map(|name| self.path().join(name));
        let [from, to] = if is_kept { [in_use, undecided] } else { [undecided, in_use] };
        match fs::rename(from, to) {
            // The file system has no locks.
            Err(error) if is_kept && error.kind() == io::ErrorKind::NotFound => Ok(()),
            result => result,
        }
    }

    /// Leaves the folder where it is, and returns its path.
    pub(crate) fn keep(self) -> PathBuf {
        self.folder.keep()
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

/// Whether a program of this machine made the file and has ended. Former versions left the file empty.
fn is_abandoned(in_use: &Path) -> io::Result<bool> {
    let file = File::options().read(true).write(true).open(in_use)?;
    let host = host();
    let mut text = String::new();
    (&file).take(host.len() as u64 + 1).read_to_string(&mut text)?;
    Ok((text.is_empty() || text == host) && file.try_lock().is_ok())
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
        let former = parent.path().join(format!("{PREFIX}former"));
        fs::create_dir_all(&former).expect("made");
        fs::write(former.join(IN_USE), "").expect("written");
        let other = parent.path().join(format!("{PREFIX}other"));
        fs::create_dir_all(&other).expect("made");
        fs::write(other.join(IN_USE), format!("{}-2", host())).expect("written");

        let used = made(parent.path());
        assert!(!left.exists() && !former.exists() && other.exists());
        let second = made(parent.path());
        assert!(used.path().exists() && second.path().exists());
        let path = used.path().to_owned();
        drop(used);
        assert!(!path.exists() && second.path().exists());
    }

    #[test]
    fn a_folder_with_something_to_lose_stays_after_a_kill() {
        let parent = tempfile::tempdir().expect("folder");
        for is_kept in [true, false] {
            let used = made(parent.path());
            used.set_kept(true).expect("renamed");
            used.set_kept(is_kept).expect("renamed");
            // As if the program was killed: the lock goes, the folder stays.
            let path = used.keep();
            drop(made(parent.path()));
            assert_eq!(path.exists(), is_kept);
        }
    }
}
