//! The `mvfusion` program: reads the command line, prepares the process, runs a command, ends with its exit code.

use std::process::ExitCode;

use clap::Parser;
use mvfusion_cli::{Cli, failure};

fn main() -> ExitCode {
    let cli = Cli::parse();
    let threads = mvfusion_cli::threads::count(cli.command.threads());
    limit_matrix_products(threads);
    match mvfusion_cli::run(&cli, threads, &mut std::io::stdout()) {
        Ok(()) => ExitCode::SUCCESS,
        Err(error) => failure::report(&error),
    }
}

/// Tells the matrix products of the NdArray backend how many threads they may use: they know no other way, and read it once.
fn limit_matrix_products(threads: usize) {
    if cfg!(feature = "ndarray") {
        // SAFETY: called from `main` before anything that starts a thread, so nobody reads the environment meanwhile.
        unsafe { std::env::set_var("MATMUL_NUM_THREADS", threads.to_string()) };
    }
}
