//! Locks in files, so that one process at a time writes to a folder.
//!
//! The operating system releases a lock when its process ends, however it ends, so no lock can become stale. The file
//! names its holder, for the message of those that come too late.

use std::fmt;
use std::fs::{File, TryLockError};
use std::io::{self, Read, Seek, SeekFrom, Write};
use std::path::{Path, PathBuf};
use std::time::{Duration, Instant};

use mvfusion_data::files::open_file;
use same_file::Handle;
use serde::{Deserialize, Serialize};
use tracing::{debug, warn};

use crate::clock;

/// How long to wait for a lock that another process holds. Whoever only looks holds it for a moment.
const PATIENCE: Duration = Duration::from_secs(2);

/// A lock that is held until it is dropped. The file stays.
#[derive(Debug)]
pub struct FileLock {
    /// Holds the lock as long as it is open.
    file: Handle,
    path: PathBuf,
}

/// The process that holds a lock.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct Holder {
    /// Process ID.
    process: u32,
    /// Name of the machine.
    host: String,
    /// When it was taken.
    since: String,
}

/// Why a lock was not taken.
#[derive(Debug)]
pub enum Refusal {
    /// Another process holds it. Its name is `None` if it cannot be read.
    Held(Option<Holder>),
    /// The file cannot be created, or the file system fails.
    Io(io::Error),
}

/// The state of a lock.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum LockState {
    /// Nobody ever took it.
    Absent,
    /// Nobody holds it.
    Free,
    /// A process holds it.
    Held,
}

impl FileLock {
    /// Takes the lock in the file `path`, which is created if it is missing. On a file system without locks, a warning
    /// says so, and every process gets it.
    ///
    /// # Errors
    /// [`Refusal`].
    pub fn take(path: &Path) -> Result<Self, Refusal> {
        // What is no file is refused: the holder's name could be read from a device for ever.
        if let Err(error) = open_file(path)
            && error.kind() == io::ErrorKind::InvalidInput
        {
            return Err(error.into());
        }
        let since = Instant::now();
        loop {
            let mut file = File::options().create(true).truncate(false).read(true).write(true).open(path)?;
            match file.try_lock() {
                Ok(()) => {}
                Err(TryLockError::WouldBlock) if since.elapsed() > PATIENCE => {
                    return Err(Refusal::Held(Holder::read(&mut file).ok()));
                }
                Err(TryLockError::WouldBlock) => {
                    std::thread::sleep(PATIENCE / 20);
                    continue;
                }
                Err(TryLockError::Error(error)) if lacks_locks(&error) => {
                    warn!("{}: the file system has no locks, so two processes may write here at once", path.display());
                }
                Err(TryLockError::Error(error)) => return Err(error.into()),
            }
            // Its name is for messages alone: a full disk does not keep anybody from looking for room.
            if let Err(error) = Holder::this().write(&mut file) {
                debug!("cannot write to {}: {error}", path.display());
            }
            let lock = Self { file: Handle::from_file(file)?, path: path.to_owned() };
            // Between opening and locking, the former holder may have removed the file.
            if lock.is_in_place() {
                return Ok(lock);
            }
        }
    }

    /// The state of the lock in the file `path`. Needs no write permission.
    ///
    /// # Errors
    /// If the file cannot be read.
    pub fn state(path: &Path) -> io::Result<LockState> {
        let file = match open_file(path) {
            Err(error) if error.kind() == io::ErrorKind::NotFound => return Ok(LockState::Absent),
            file => file?,
        };
        match file.try_lock_shared() {
            Ok(()) => Ok(LockState::Free),
            Err(TryLockError::WouldBlock) => Ok(LockState::Held),
            Err(TryLockError::Error(error)) if lacks_locks(&error) => Ok(LockState::Free),
            Err(TryLockError::Error(error)) => Err(error),
        }
    }

    /// Removes the file, then releases the lock.
    pub fn remove(&self) {
        // Another process's file is not this one's to remove.
        if self.is_in_place()
            && let Err(error) = std::fs::remove_file(&self.path)
        {
            warn!("cannot remove {}: {error}", self.path.display());
        }
    }

    /// Whether the path still leads to the file that is locked.
    fn is_in_place(&self) -> bool {
        Handle::from_path(&self.path).is_ok_and(|other| other == self.file)
    }
}

impl Holder {
    /// This process.
    fn this() -> Self {
        Self {
            process: std::process::id(),
            host: gethostname::gethostname().to_string_lossy().into_owned(),
            since: clock::now(),
        }
    }

    fn write(&self, file: &mut File) -> io::Result<()> {
        file.set_len(0)?;
        file.seek(SeekFrom::Start(0))?;
        file.write_all(&serde_json::to_vec(self)?)
    }

    fn read(file: &mut (impl Read + Seek)) -> io::Result<Self> {
        /// More than any holder takes.
        const LONGEST: u64 = 4096;
        file.seek(SeekFrom::Start(0))?;
        let mut text = Vec::new();
        file.take(LONGEST).read_to_end(&mut text)?;
        Ok(serde_json::from_slice(&text)?)
    }
}

impl fmt::Display for Holder {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "process {} on {} since {}", self.process, self.host, self.since)
    }
}

impl From<io::Error> for Refusal {
    fn from(error: io::Error) -> Self {
        Self::Io(error)
    }
}

/// Whether this error says that the file system has no locks, as some network file systems do.
fn lacks_locks(error: &io::Error) -> bool {
    error.kind() == io::ErrorKind::Unsupported
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_lock_is_held_once_and_names_its_holder() {
        let folder = tempfile::tempdir().expect("folder");
        let path = folder.path().join("lock");
        assert_eq!(FileLock::state(&path).expect("read"), LockState::Absent);
        let first = FileLock::take(&path).expect("taken");
        assert_eq!(FileLock::state(&path).expect("read"), LockState::Held);
        match FileLock::take(&path).expect_err("held") {
            Refusal::Held(holder) => assert_eq!(holder.expect("named").process, std::process::id()),
            Refusal::Io(error) => panic!("{error}"),
        }
        drop(first);
        assert_eq!(FileLock::state(&path).expect("read"), LockState::Free);
        FileLock::take(&path).expect("taken again");
    }

    #[test]
    fn a_lock_in_a_file_that_was_removed_is_no_lock() {
        let folder = tempfile::tempdir().expect("folder");
        let path = folder.path().join("lock");
        let first = FileLock::take(&path).expect("taken");
        std::fs::remove_file(&path).expect("removed");
        assert!(!first.is_in_place());
        let second = FileLock::take(&path).expect("taken");
        // The first does not remove the file of the second.
        first.remove();
        assert!(second.is_in_place());
        second.remove();
        assert!(!path.exists());
    }
}
