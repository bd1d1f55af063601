//! The readers, and the sound files that are damaged for each.

mod checkpoint;
mod gaussians;
mod pictures;
mod run;
mod scenes;
mod sweep;
mod torch;

use std::fmt::Display;
use std::fs;
use std::path::{Path, PathBuf};

use crate::mutation::Kind;

/// What came of reading: the inner error is a fault of what was accepted, the outer one a refusal.
pub type Answer = Result<Result<(), String>, String>;

/// Reads a file at its place.
type Read = Box<dyn Fn() -> Answer>;

/// Writes sound files into a folder.
pub type Targets = fn(&Path) -> Vec<Target>;

/// A file that is damaged.
pub struct Target {
    pub file: PathBuf,
    pub kind: Kind,
    /// Memory that reading may hold at once.
    pub room: Room,
    /// Bytes of the other files that are read.
    pub others: usize,
    pub read: Read,
}

/// Memory that reading may hold at once.
#[derive(Clone, Copy)]
pub struct Room {
    /// In bytes of the files.
    pub times: usize,
    /// In bytes, for any file: buffers, messages, tables of decoders.
    pub fixed: usize,
}

/// The memory of the readers of scenes.
const SCENES: Room = Room { times: 10, fixed: 1 << 20 };

/// The memory of the readers of texts that become values: a digit and a comma become a value of 32 bytes, in a list that
/// has doubled to hold it.
const RECORDS: Room = Room { times: 64, fixed: 4 << 20 };

/// All readers.
pub fn all() -> Vec<(&'static str, Targets)> {
    [
        scenes::READERS,
        gaussians::READERS,
        pictures::READERS,
        run::READERS,
        sweep::READERS,
        checkpoint::READERS,
        torch::READERS,
    ]
    .concat()
}

/// The answer of a reader that returns sound things or errors.
fn answer<T, E: Display>(read: Result<T, E>) -> Answer {
    answer_of(read, |_| Ok(()))
}

/// The answer of a reader whose things are checked.
fn answer_of<T, E: Display>(read: Result<T, E>, check: impl FnOnce(T) -> Result<(), String>) -> Answer {
    read.map(check).map_err(|error| format!("{error:#}"))
}

/// Bytes of all files below a folder.
fn bytes_below(folder: &Path) -> usize {
    let entries = fs::read_dir(folder).expect("listed").map(|entry| entry.expect("listed").path());
    let size = |path: PathBuf| match path.is_dir() {
        true => bytes_below(&path),
        false => fs::metadata(&path).expect("there").len() as usize,
    };
    entries.map(size).sum()
}
