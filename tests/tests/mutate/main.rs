//! Damaged files for every reader: those of scenes, and those of the files of a run or a sweep.
//!
//! Whatever the bytes are, a reader returns something sound or an error with a message. It does not panic, hang, or take
//! more memory than the file warrants. Each file of each reader is damaged in turn, in a way that follows from the
//! reader's name and a number alone.
//!
//! No other program is found, so videos go to the decoder that is built in. Without the feature `h264` there is none, and
//! videos are visibly ignored.
//!
//! Here, each reader gets [`Settings::FILES`] files. `cargo xtask mutate` gives them more, and prints a table.

mod mutation;
mod readers;
mod runner;

use std::process::ExitCode;
use std::sync::{Arc, Mutex, PoisonError};

use libtest_mimic::{Arguments, Trial};
use mvfusion_cli::lpips::VARIABLE;
use peak_alloc::PeakAlloc;

use runner::{Outcome, Settings};

#[global_allocator]
static ALLOCATOR: PeakAlloc = PeakAlloc;

fn main() -> ExitCode {
    let mut arguments = Arguments::from_args();
    // One reader at a time: memory is counted for the whole process.
    arguments.test_threads = Some(1);
    // SAFETY: nothing has started a thread yet, so nobody reads the environment meanwhile.
    unsafe {
        std::env::set_var("PATH", "");
        // Nor are the LPIPS weights of whoever tests.
        std::env::set_var(VARIABLE, "none");
    }
    let settings = Settings::from_environment();
    let place = tempfile::tempdir().expect("a temporary folder");
    let outcomes: Arc<Mutex<Vec<Outcome>>> = Arc::default();
    let trial = |(name, targets): (&'static str, readers::Targets)| {
        let (place, outcomes) = (place.path().to_owned(), Arc::clone(&outcomes));
        let is_ignored = name == "video" && cfg!(not(feature = "h264"));
        let trial = Trial::test(name, move || {
            let outcome = runner::run(name, targets, &place, settings);
            let failures = outcome.failures.join("\n");
            outcomes.lock().unwrap_or_else(PoisonError::into_inner).push(outcome);
            if failures.is_empty() { Ok(()) } else { Err(failures.into()) }
        });
        trial.with_kind(if is_ignored { "no feature h264" } else { "" }).with_ignored_flag(is_ignored)
    };
    let conclusion = libtest_mimic::run(&arguments, readers::all().into_iter().map(trial).collect());
    if settings.is_by_hand {
        eprint!("{}", runner::table(&outcomes.lock().unwrap_or_else(PoisonError::into_inner)));
    }
    conclusion.exit_code()
}
