//! The `mvfusion` program: reads the command line, prepares the process, runs a command, ends with its exit code.

use std::process::ExitCode;

use clap::Parser;
use mvfusion_cli::args::ProgressForm;
use mvfusion_cli::progress::{Form, Verbosity};
use mvfusion_cli::stdout::Output;
use mvfusion_cli::{Cli, failure};

fn main() -> ExitCode {
    keep_heap();
    let cli = match Cli::try_parse() {
        Ok(cli) => cli,
        Err(error) => {
            let arguments = std::env::args_os().map(|argument| argument.to_string_lossy().into_owned());
            let form = if ProgressForm::is_json_in(arguments) { Form::Json } else { Form::Normal };
            let verbosity = Verbosity { form, ..Verbosity::NORMAL };
            return failure::refuse(&error, verbosity);
        }
    };
    let verbosity = cli.output.verbosity();
    failure::report_panics(verbosity);
    let threads = mvfusion_cli::threads::count(cli.command.threads());
    limit_matrix_products(threads);
    let mut out = Output::new(std::io::stdout());
    failure::report(&mvfusion_cli::run(&cli, threads, &mut out), verbosity)
}

/// Tells the matrix products of the NdArray backend how many threads they may use: they know no other way, and read it once.
fn limit_matrix_products(threads: usize) {
    if cfg!(feature = "ndarray") {
        // SAFETY: called from `main` before anything that starts a thread, so nobody reads the environment meanwhile.
        unsafe { std::env::set_var("MATMUL_NUM_THREADS", threads.to_string()) };
    }
}

/// Lets the allocator keep freed memory for the next step. A step frees and takes the same few hundred buffers; without
/// this, glibc returns some of them to the system and fetches them again, page by page.
#[cfg(all(target_os = "linux", target_env = "gnu"))]
fn keep_heap() {
    /// The largest threshold that glibc takes: larger buffers are mapped on their own.
    const MAPPED_ABOVE: i32 = 32 << 20;
    /// Bytes to fetch beyond what is needed.
    const AHEAD: i32 = 64 << 20;
    // SAFETY: these calls set parameters of the allocator, before another thread is started.
    unsafe {
        libc::mallopt(libc::M_MMAP_THRESHOLD, MAPPED_ABOVE);
        libc::mallopt(libc::M_TRIM_THRESHOLD, i32::MAX);
        libc::mallopt(libc::M_TOP_PAD, AHEAD);
    }
}

/// Other allocators are left as they are.
#[cfg(not(all(target_os = "linux", target_env = "gnu")))]
fn keep_heap() {}
