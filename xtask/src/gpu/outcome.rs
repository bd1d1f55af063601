//! What came of an entry, as far as its end and its words tell.

use std::fmt;

use serde::Serialize;

use super::list::Goal;
use super::process::End;

/// What came of an entry. None of these says that its answer is good.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
#[serde(rename_all = "snake_case")]
pub(super) enum Outcome {
    /// Its exit status is 0, and so is what else can be checked as it should be.
    Ended,
    /// It was killed on purpose, after a checkpoint.
    Killed,
    /// It ended before it could be killed.
    NotKilled,
    /// Its exit status is not 0, or a test failed.
    Failed,
    /// All tests were ignored, or none has such a name.
    NoTestRan,
    /// The device is not there, or cannot be used.
    NoDevice,
    /// The device is a software driver.
    Software,
    /// It ran past its time and was ended.
    TimedOut,
    /// It is not on this machine.
    Missing,
    /// There was no time for it.
    NotRun,
}

impl Outcome {
    /// What came of an entry with this goal that ended so and said this.
    pub(super) fn of(goal: &Goal, end: End, said: &str) -> Self {
        match end {
            End::Killed => return Self::Killed,
            End::TimedOut => return Self::TimedOut,
            End::Itself(status) if !status.success() => return Self::Failed,
            End::Itself(_) => {}
        }
        match goal {
            Goal::End => Self::Ended,
            Goal::Checkpoint => Self::NotKilled,
            Goal::Tests => match Tests::of(said) {
                Some(tests) if tests.failed > 0 => Self::Failed,
                Some(tests) if tests.passed > 0 => Self::Ended,
                _ => Self::NoTestRan,
            },
            Goal::Device { name, rehearsal } => {
                let line = said.lines().find(|line| line.split_whitespace().next() == Some(name.as_str()));
                match line {
                    Some(line) if line.contains(UNUSABLE) => Self::NoDevice,
                    Some(line) if !rehearsal && is_software(line) => Self::Software,
                    Some(_) => Self::Ended,
                    None => Self::NoDevice,
                }
            }
        }
    }

    /// In words, for the table.
    pub(super) fn word(self) -> &'static str {
        match self {
            Self::Ended => "ended",
            Self::Killed => "killed, as planned",
            Self::NotKilled => "**ended before it was killed**",
            Self::Failed => "**failed**",
            Self::NoTestRan => "**no test ran**",
            Self::NoDevice => "**no such device**",
            Self::Software => "**a software driver**",
            Self::TimedOut => "**timed out**",
            Self::Missing => "not on this machine",
            Self::NotRun => "no time left",
        }
    }
}

/// What `mvfusion devices` says of a device that does not open.
const UNUSABLE: &str = "cannot be used";

/// What it says of a software driver, and the names of such drivers, in case that one passes for a GPU.
const SOFTWARE: [&str; 4] = ["software driver", "llvmpipe", "lavapipe", "swiftshader"];

/// Whether a line of `mvfusion devices` describes a software driver.
fn is_software(line: &str) -> bool {
    let line = line.to_lowercase();
    SOFTWARE.iter().any(|name| line.contains(name))
}

/// Numbers of tests.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
pub(super) struct Tests {
    passed: usize,
    failed: usize,
    ignored: usize,
}

impl Tests {
    /// The numbers of the last summary: a failed test may repeat that of another process before.
    pub(super) fn of(said: &str) -> Option<Self> {
        let summary = |line: &str| Some(line.strip_prefix("test result: ")?.split_once(". ")?.1.to_owned());
        let summary = said.lines().rev().find_map(summary)?;
        let number =
            |of: &str| summary.split("; ").find_map(|part| part.strip_suffix(of)?.trim().parse::<usize>().ok());
        Some(Self { passed: number("passed")?, failed: number("failed")?, ignored: number("ignored")? })
    }
}

impl fmt::Display for Tests {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{} passed, {} failed, {} ignored", self.passed, self.failed, self.ignored)
    }
}

#[cfg(test)]
mod tests {
    use std::process::ExitStatus;

    use super::*;

    fn of(goal: &Goal, said: &str) -> Outcome {
        // The default is success.
        Outcome::of(goal, End::Itself(ExitStatus::default()), said)
    }

    fn summary(passed: usize, failed: usize, ignored: usize) -> String {
        format!(
            "\nrunning 9 tests\ntest a ... ok\n\ntest result: ok. {passed} passed; {failed} failed; {ignored} ignored; \
             0 measured; 7 filtered out; finished in 0.02s\n\n"
        )
    }

    #[test]
    fn tests_must_run() {
        assert_eq!(of(&Goal::Tests, &summary(3, 0, 2)), Outcome::Ended);
        assert_eq!(of(&Goal::Tests, &summary(3, 1, 2)), Outcome::Failed);
        for nothing in [summary(0, 0, 2).as_str(), "", "test result: ok."] {
            assert_eq!(of(&Goal::Tests, nothing), Outcome::NoTestRan, "{nothing}");
        }
        assert_eq!(
            Tests::of(&(summary(0, 1, 0) + &summary(3, 0, 2))),
            Some(Tests { passed: 3, failed: 0, ignored: 2 })
        );
    }

    #[test]
    fn a_software_driver_serves_a_rehearsal_alone() {
        let goal = |rehearsal| Goal::Device { name: "wgpu:0".to_owned(), rehearsal };
        let said = |line: &str| format!("flex      CPU, 2 threads: pure Rust\nwgpu:1    a software driver\n{line}\n");
        for line in ["wgpu:0    llvmpipe (LLVM 15.0.6), a software driver: buffers", "wgpu:0    SwiftShader Device: x"]
        {
            assert_eq!(of(&goal(false), &said(line)), Outcome::Software);
            assert_eq!(of(&goal(true), &said(line)), Outcome::Ended);
        }
        assert_eq!(of(&goal(false), &said("wgpu:0    NVIDIA H100: buffers")), Outcome::Ended);
        for line in ["wgpu:0    cannot be used: closed", "no GPU was found"] {
            assert_eq!(of(&goal(true), &said(line)), Outcome::NoDevice);
        }
    }

    #[test]
    fn what_should_be_killed_must_not_end() {
        assert_eq!(of(&Goal::Checkpoint, ""), Outcome::NotKilled);
        assert_eq!(Outcome::of(&Goal::Checkpoint, End::Killed, ""), Outcome::Killed);
    }
}
