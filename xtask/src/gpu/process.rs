//! A process with those that it starts itself: waited for, killed on purpose, or ended after its time.

use std::process::{Child, Command, ExitStatus, Stdio};
use std::thread;
use std::time::{Duration, Instant};

use anyhow::{Result, bail};
use mvfusion_cli::interrupt::Signals;

/// Time from one look at a process to the next.
const PAUSE: Duration = Duration::from_millis(50);

/// Kills a group of processes. The shell has a `kill` of its own; small systems have no other.
const KILL: &str = r#"kill -s KILL -- "-$0""#;

/// How a process ended.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum End {
    /// By itself.
    Itself(ExitStatus),
    /// It was killed on purpose.
    Killed,
    /// It ran past its time and was killed.
    TimedOut,
}

/// Makes a process the first of a group of its own, in which those that it starts are as well.
pub(super) fn lead_a_group(command: &mut Command) {
    #[cfg(unix)]
    std::os::unix::process::CommandExt::process_group(command, 0);
    #[cfg(not(unix))]
    let _ = command;
}

/// Waits for a process that leads a group. Kills the group after the limit, or once `is_enough`.
///
/// A signal to this program kills the group as well, because a terminal sends none to other groups. That is an error.
pub(super) fn ended(mut child: Child, limit: Duration, signals: &Signals, is_enough: impl Fn() -> bool) -> Result<End> {
    let until = Instant::now() + limit;
    loop {
        if let Some(status) = child.try_wait()? {
            return Ok(End::Itself(status));
        }
        if signals.exit_code().is_some() {
            kill(&mut child)?;
            bail!("interrupted by a signal");
        }
        let end = match (is_enough(), Instant::now() < until) {
            (true, _) => End::Killed,
            (false, false) => End::TimedOut,
            (false, true) => {
                thread::sleep(PAUSE);
                continue;
            }
        };
        let status = kill(&mut child)?;
        // It may have come to its end just before.
        return Ok(if status.success() { End::Itself(status) } else { end });
    }
}

/// Kills a process that leads a group, and all others of the group. As nobody has waited for it yet, its number is
/// still its own.
fn kill(child: &mut Child) -> Result<ExitStatus> {
    let _ = Command::new("sh").args(["-c", KILL, &child.id().to_string()]).stderr(Stdio::null()).status();
    // Where there is no shell, the process itself ends at least.
    let _ = child.kill();
    Ok(child.wait()?)
}

#[cfg(all(test, unix))]
mod tests {
    use super::*;

    fn started(folder: &tempfile::TempDir, script: &str) -> Child {
        let mut command = Command::new("sh");
        command.args(["-c", script]).current_dir(folder);
        lead_a_group(&mut command);
        command.spawn().expect("started")
    }

    #[test]
    fn what_a_process_started_ends_with_it() {
        let folder = tempfile::tempdir().expect("a folder");
        let child = started(&folder, "(touch early; sleep 1; touch late) & wait");
        let is_running = || folder.path().join("early").exists();
        let end = ended(child, Duration::from_secs(60), &Signals::default(), is_running);
        assert_eq!(end.expect("waited for"), End::Killed);
        thread::sleep(Duration::from_millis(1500));
        assert!(!folder.path().join("late").exists(), "it went on alone");
    }

    #[test]
    fn every_end_is_told_apart() {
        let folder = tempfile::tempdir().expect("a folder");
        let end = |script: &str, seconds: u64| {
            let child = started(&folder, script);
            ended(child, Duration::from_secs(seconds), &Signals::default(), || false).expect("waited for")
        };
        assert!(matches!(end("true", 60), End::Itself(status) if status.success()));
        assert!(matches!(end("false", 60), End::Itself(status) if !status.success()));
        assert_eq!(end("sleep 60", 0), End::TimedOut);
    }
}
