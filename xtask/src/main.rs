//! The project's chores; `cargo xtask help` lists them.

mod bench;
mod ci;
mod deny;
mod docs;
mod gpu;
mod mutate;
#[cfg(feature = "ptx")]
mod ptx;
mod results;
mod splice;
mod torture;
mod wheel;

use clap::{Parser, Subcommand};

/// Chores of the MVFusion-GS project.
#[derive(Debug, Parser)]
#[command(name = "cargo xtask")]
struct Arguments {
    #[command(subcommand)]
    chore: Chore,
}

#[derive(Debug, Subcommand)]
enum Chore {
    /// Everything that continuous integration runs, cheapest check first.
    Ci,
    /// Checks the Markdown files and their generated lists; `--write` writes the lists.
    Docs(docs::DocsArguments),
    /// Times the ops on this machine.
    Bench(bench::BenchArguments),
    /// Packs what a machine with a GPU is asked, or runs it there.
    Gpu(gpu::GpuArguments),
    /// Gives every reader damaged files, 100 000 unless told otherwise.
    Mutate(mutate::MutateArguments),
    /// Compiles every kernel for NVIDIA GPUs, without one, and counts registers, spills and shared memory.
    #[cfg(feature = "ptx")]
    Ptx(ptx::PtxArguments),
    /// Puts the table of a sweep into the page of docs/ that names it.
    Results(results::ResultsArguments),
    /// Kills, terminates, replaces and doubles trainings, and checks that none is lost.
    Torture(torture::TortureArguments),
    /// Builds the Python package, installs it into a fresh environment, and tests it there.
    Wheel,
}

fn main() -> anyhow::Result<()> {
    match Arguments::parse().chore {
        Chore::Ci => ci::run(),
        Chore::Docs(arguments) => docs::run(&arguments),
        Chore::Bench(arguments) => bench::run(&arguments),
        Chore::Gpu(arguments) => gpu::run(&arguments),
        Chore::Mutate(arguments) => mutate::run(&arguments),
        #[cfg(feature = "ptx")]
        Chore::Ptx(arguments) => ptx::run(&arguments),
        Chore::Results(arguments) => results::run(&arguments),
        Chore::Torture(arguments) => torture::run(&arguments),
        Chore::Wheel => wheel::check(),
    }
}
