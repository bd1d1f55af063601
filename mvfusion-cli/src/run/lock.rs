//! The lock of an output folder: one process writes to it at a time.

use std::fs;
use std::io;
use std::path::{Path, PathBuf};

use anyhow::{Context, bail};

use crate::lock::{FileLock, Refusal};

/// The file of the lock.
pub(super) const LOCK: &str = ".lock";

/// The right to write to a folder. Dropping it removes the lock, and those folders that it created and that are empty.
#[derive(Debug)]
pub struct FolderLock {
    lock: FileLock,
    /// Folders that were created for it, outermost first.
    created: Vec<PathBuf>,
}

impl FolderLock {
    /// Takes the lock of a folder, which is created if it is missing.
    ///
    /// # Errors
    /// If another process writes to it, or it cannot be created.
    pub fn take(folder: &Path) -> anyhow::Result<Self> {
        let shown = folder.display();
        // A process that ends removes the folders that it created, so they may vanish in between.
        for _ in 0..10 {
            let missing = |path: &&Path| !path.as_os_str().is_empty() && !path.exists();
            let mut created: Vec<PathBuf> = folder.ancestors().take_while(missing).map(Path::to_owned).collect();
            created.reverse();
            fs::create_dir_all(folder).with_context(|| format!("cannot create the folder {shown}"))?;
            match FileLock::take(&folder.join(LOCK)) {
                Ok(lock) => return Ok(Self { lock, created }),
                Err(Refusal::Io(error)) if error.kind() == io::ErrorKind::NotFound => {}
                Err(Refusal::Io(error)) => {
                    return Err(error).with_context(|| format!("cannot lock the folder {shown}"));
                }
                Err(Refusal::Held(holder)) => {
                    let holder = holder.map_or("another process".to_owned(), |holder| holder.to_string());
                    bail!("{holder} is writing to {shown}. Wait until it has ended, or choose another folder.");
                }
            }
        }
        bail!("cannot lock the folder {shown}: another process keeps removing it.");
    }
}

impl Drop for FolderLock {
    fn drop(&mut self) {
        self.lock.remove();
        for folder in self.created.iter().rev() {
            // A folder with something in it stays.
            if fs::remove_dir(folder).is_err() {
                break;
            }
        }
    }
}
