//! Signals that interrupt a command: the first asks it to end in order, a training with a checkpoint after the current
//! step. A second one ends the process at once. Files that may not grow any further.

use std::borrow::Cow;
use std::fmt;
use std::io;
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, AtomicUsize, Ordering};

#[cfg(unix)]
use signal_hook::consts::{SIGHUP, SIGXFSZ};
use signal_hook::consts::{SIGINT, SIGTERM};
use signal_hook::flag;

/// The signals that interrupt.
#[cfg(unix)]
const SIGNALS: [i32; 3] = [SIGINT, SIGTERM, SIGHUP];
#[cfg(not(unix))]
const SIGNALS: [i32; 2] = [SIGINT, SIGTERM];

/// Exit code of a process that a signal ended: this plus the number of the signal.
const BY_SIGNAL: i32 = 128;

/// The first signal that arrived, if any.
#[derive(Clone, Debug, Default)]
pub struct Signals {
    /// Its number; 0 for none.
    first: Arc<AtomicUsize>,
    /// Whether the next signal ends the process.
    is_second: Arc<AtomicBool>,
}

impl Signals {
    /// Starts to watch for signals. A signal that the process was told to ignore, as by `nohup`, stays ignored.
    ///
    /// # Errors
    /// If the system refuses.
    pub fn watch() -> io::Result<Self> {
        let signals = Self::default();
        for signal in SIGNALS.into_iter().filter(|&signal| !is_ignored(signal)) {
            // The order matters: the first signal must find the flag down.
            flag::register_conditional_shutdown(signal, BY_SIGNAL + signal, Arc::clone(&signals.is_second))?;
            flag::register(signal, Arc::clone(&signals.is_second))?;
            flag::register_usize(signal, Arc::clone(&signals.first), signal as usize)?;
        }
        Ok(signals)
    }

    /// The exit code for the signal that arrived; `None` if none did.
    pub fn exit_code(&self) -> Option<u8> {
        let signal = self.first.load(Ordering::Relaxed);
        (signal != 0).then(|| u8::try_from(BY_SIGNAL as usize + signal).unwrap_or(u8::MAX))
    }

    /// Does what a first signal from the keyboard would do, for programs that train in a thread.
    pub fn raise(&self) {
        self.first.store(SIGINT as usize, Ordering::Relaxed);
    }

    /// From now on, the first signal ends the process.
    pub fn end_at_once(&self) {
        self.is_second.store(true, Ordering::Relaxed);
    }
}

/// Whether a process with this exit code was interrupted by a signal, and not ended by a failure.
pub fn is_by_signal(code: i32) -> bool {
    SIGNALS.iter().any(|signal| code == BY_SIGNAL + signal)
}

/// Makes writing to a file beyond the limit of its size (`ulimit -f`) an error with a message: without a handler, the
/// system's signal ends the process.
///
/// # Errors
/// If the system refuses.
pub fn survive_file_limits() -> io::Result<()> {
    #[cfg(unix)]
    flag::register(SIGXFSZ, Arc::default())?;
    Ok(())
}

/// Whether the process was started with a signal ignored. Only Linux can be asked.
fn is_ignored(signal: i32) -> bool {
    let status = std::fs::read_to_string("/proc/self/status").unwrap_or_default();
    let mask = status.lines().find_map(|line| u64::from_str_radix(line.strip_prefix("SigIgn:")?.trim(), 16).ok());
    mask.is_some_and(|mask| mask >> (signal - 1) & 1 == 1)
}

/// A training was interrupted by a signal and saved.
#[derive(Clone, Debug)]
pub struct Interrupted {
    /// The exit code.
    pub code: u8,
    /// Steps done.
    pub done: usize,
    /// Steps of the whole run.
    pub total: usize,
    /// The run folder.
    pub run: PathBuf,
}

impl fmt::Display for Interrupted {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self { done, total, run, .. } = self;
        write!(f, "interrupted after step {done} of {total}, and saved. Continue with: {}", resume_command(run))
    }
}

impl std::error::Error for Interrupted {}

/// A command was interrupted by a signal before what it makes was complete, and nothing is left of that.
#[derive(Clone, Copy, Debug)]
pub struct Abandoned {
    /// The exit code.
    pub code: u8,
    /// What it makes.
    pub what: &'static str,
}

impl fmt::Display for Abandoned {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "interrupted: nothing is left of the unfinished {}. The same command begins anew", self.what)
    }
}

impl std::error::Error for Abandoned {}

/// The command that continues a run.
pub fn resume_command(run: &Path) -> String {
    format!("mvfusion train --resume {}", path_for_shell(run))
}

/// A path as a shell reads it back.
pub(crate) fn path_for_shell(path: &Path) -> String {
    for_shell(&path.to_string_lossy()).into_owned()
}

/// A word as a shell reads it back.
pub(crate) fn for_shell(word: &str) -> Cow<'_, str> {
    // Paths and arguments of programs contain no zero, the only letter that cannot be quoted.
    shlex::try_quote(word).unwrap_or(Cow::Borrowed(word))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_command_quotes_what_a_shell_would_read_otherwise() {
        assert_eq!(resume_command(Path::new("runs/a-0")), "mvfusion train --resume runs/a-0");
        assert_eq!(resume_command(Path::new("my runs/it's")), "mvfusion train --resume \"my runs/it's\"");
    }

    #[test]
    fn no_signal_is_no_interruption() {
        assert_eq!(Signals::default().exit_code(), None);
        let signals = Signals { first: Arc::new(AtomicUsize::new(SIGTERM as usize)), ..Signals::default() };
        assert_eq!(signals.exit_code(), Some(143));
        signals.raise();
        assert_eq!(signals.exit_code(), Some(130));
        assert!([130, 143].into_iter().all(is_by_signal) && ![0, 1, 2, 101, 137].into_iter().any(is_by_signal));
    }
}
