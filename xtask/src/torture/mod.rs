//! `cargo xtask torture`: trainings that are killed, terminated, replaced and doubled, and what is left of them.
//!
//! A run is *lost* if it had completed a step that a checkpoint was due for, and no command opens it or goes on from
//! it, or if it ends with other parameters than an undisturbed run. One lost run fails the chore.

mod exact;
mod ground;
mod ordeals;

use std::path::PathBuf;

use anyhow::{Context, Result, ensure};
use clap::{Args, ValueEnum};
use rand::SeedableRng;
use rand_chacha::ChaCha8Rng;

use ground::Ground;

/// Options of `cargo xtask torture`.
#[derive(Debug, Args)]
pub struct TortureArguments {
    /// What is done to trainings [default: everything]
    #[arg(value_enum)]
    ordeals: Vec<Ordeal>,
    /// A few of each, for continuous integration
    #[arg(long)]
    short: bool,
    /// Seed of the moments
    #[arg(long, default_value_t = 0)]
    seed: u64,
    /// The program [default: `mvfusion` beside this one]
    #[arg(long, value_name = "FILE")]
    program: Option<PathBuf>,
}

/// What is done to trainings.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
enum Ordeal {
    /// SIGKILL at random moments, with a checkpoint every other step.
    Kill,
    /// SIGKILL at random moments, with the default checkpoints.
    KillDefaults,
    /// SIGTERM at random moments.
    Terminate,
    /// SIGKILL while `--force` replaces a finished run.
    Replace,
    /// Two trainings at once in one folder.
    Double,
    /// Two resumes at chosen steps, by one and by two threads.
    Exact,
}

impl Ordeal {
    /// How often, in full and in short.
    fn count(self, short: bool) -> usize {
        let (full, few) = match self {
            Self::Kill => (100, 3),
            Self::KillDefaults => (20, 1),
            Self::Terminate => (30, 2),
            Self::Replace => (20, 2),
            Self::Double => (20, 2),
            // Tests within one process do this at every step of a run.
            Self::Exact => (exact::INTERRUPTIONS.len(), 0),
        };
        if short { few } else { full }
    }
}

/// What came of an ordeal.
#[derive(Debug, Default)]
struct Tally {
    /// Interruptions.
    done: usize,
    /// Those before anything was worth keeping: no step, or none that a checkpoint was due for.
    early: usize,
    /// Lost runs, in words.
    lost: Vec<String>,
}

/// A few of each ordeal.
///
/// # Errors
/// As [`run`].
pub fn run_short() -> Result<()> {
    run(&TortureArguments { ordeals: Vec::new(), short: true, seed: 0, program: None })
}

/// Runs the ordeals.
///
/// # Errors
/// If a run is lost, or the program cannot be run.
#[allow(clippy::print_stdout, reason = "the table is this program's output")]
pub fn run(arguments: &TortureArguments) -> Result<()> {
    let beside = || Ok::<_, anyhow::Error>(std::env::current_exe()?.with_file_name("mvfusion"));
    let program = arguments.program.clone().map_or_else(beside, Ok)?;
    ensure!(program.is_file(), "{} is not built: `cargo build -p mvfusion-cli`", program.display());
    let program = std::path::absolute(&program).context("cannot use the path of the program")?;
    let mut random = ChaCha8Rng::seed_from_u64(arguments.seed);
    let ordeals = if arguments.ordeals.is_empty() { Ordeal::value_variants() } else { &arguments.ordeals };
    let ground = Ground::new(&program)?;
    let mut lost = 0;
    for &ordeal in ordeals {
        let count = ordeal.count(arguments.short);
        if count == 0 {
            continue;
        }
        let tally = match ordeal {
            Ordeal::Kill => ordeals::interrupt(&ground, ordeals::KILL, count, &mut random),
            Ordeal::KillDefaults => ordeals::interrupt(&ground, ordeals::KILL_DEFAULTS, count, &mut random),
            Ordeal::Terminate => ordeals::interrupt(&ground, ordeals::TERMINATE, count, &mut random),
            Ordeal::Replace => ordeals::replace(&ground, count, &mut random),
            Ordeal::Double => ordeals::double(&ground, count, &mut random),
            Ordeal::Exact => exact::resume(&program, count),
        }?;
        let name = ordeal.to_possible_value().context("an ordeal without a name")?;
        println!("{:16}{} done, {} early, {} lost", name.get_name(), tally.done, tally.early, tally.lost.len());
        for words in &tally.lost {
            println!("                {words}");
        }
        lost += tally.lost.len();
    }
    ensure!(lost == 0, "{lost} runs were lost");
    Ok(())
}
