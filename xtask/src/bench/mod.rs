//! Benchmarks: what an op costs on this machine, printed and, if asked for, written as JSON.

mod net;
mod splat;

use std::path::PathBuf;
use std::time::Instant;

use anyhow::{Context, Result};
use clap::{Args, Subcommand};
use mvfusion_model::{Device, device};
use serde::Serialize;

/// What to measure, and how.
#[derive(Debug, Args)]
pub struct BenchArguments {
    #[command(subcommand)]
    subject: Subject,
    /// Write the figures to this file as JSON.
    #[arg(long, global = true)]
    json: Option<PathBuf>,
    /// Threads to use; all cores by default.
    #[arg(long, global = true)]
    threads: Option<usize>,
    /// Counted repetitions, after one that is not counted.
    #[arg(long, global = true, default_value_t = 5)]
    repeat: usize,
}

/// A thing to measure.
#[derive(Clone, Copy, Debug, Subcommand)]
enum Subject {
    /// The splat op, forward and backward, on two scenes.
    Splat,
    /// HexPlane look-up, trunk and all heads, forward and backward.
    Net,
}

/// One measurement; times in seconds, medians over the repetitions.
#[derive(Debug, Serialize)]
struct Row {
    scene: String,
    device: &'static str,
    threads: usize,
    forward_seconds: f64,
    backward_seconds: f64,
    #[serde(skip_serializing_if = "Option::is_none")]
    pairs: Option<Pairs>,
}

/// Gaussian-pixel pairs of a splat.
#[derive(Clone, Copy, Debug, Serialize)]
struct Pairs {
    intersections: usize,
    evaluated: usize,
    contributing: usize,
    forward_contributing_per_second_per_core: f64,
    backward_contributing_per_second_per_core: f64,
}

/// Runs a benchmark.
pub fn run(arguments: &BenchArguments) -> Result<()> {
    if let Some(threads) = arguments.threads {
        rayon::ThreadPoolBuilder::new()
            .num_threads(threads)
            .build_global()
            .context("cannot set the number of threads")?;
    }
    let rows = match arguments.subject {
        Subject::Splat => splat::measure(arguments.repeat)?,
        Subject::Net => net::measure(arguments.repeat)?,
    };
    for row in &rows {
        print(row);
    }
    if let Some(path) = &arguments.json {
        let text = serde_json::to_string_pretty(&rows)?;
        std::fs::write(path, text).with_context(|| format!("cannot write {}", path.display()))?;
    }
    Ok(())
}

#[allow(clippy::print_stdout, reason = "the table is this program's output")]
fn print(row: &Row) {
    println!(
        "{} on {}, {} threads: forward {:.1} ms, backward {:.1} ms",
        row.scene,
        row.device,
        row.threads,
        1e3 * row.forward_seconds,
        1e3 * row.backward_seconds
    );
    if let Some(pairs) = row.pairs {
        println!(
            "    {} tile entries, {:.2} M pairs evaluated, {:.2} M contributing; per core forward {:.0} M/s, backward {:.0} M/s",
            pairs.intersections,
            1e-6 * pairs.evaluated as f64,
            1e-6 * pairs.contributing as f64,
            1e-6 * pairs.forward_contributing_per_second_per_core,
            1e-6 * pairs.backward_contributing_per_second_per_core
        );
    }
}

/// The CPU devices that were compiled in.
fn devices() -> Vec<(&'static str, Device)> {
    vec![
        #[cfg(feature = "flex")]
        ("flex", device::flex()),
        #[cfg(feature = "ndarray")]
        ("ndarray", device::ndarray()),
    ]
}

/// Median forward and backward seconds of `repeat` runs after one that is not counted. `run` returns both.
fn medians(repeat: usize, mut run: impl FnMut() -> Result<(f64, f64)>) -> Result<(f64, f64)> {
    run()?;
    let runs = (0..repeat.max(1)).map(|_| run()).collect::<Result<Vec<_>>>()?;
    let median = |pick: fn(&(f64, f64)) -> f64| {
        let mut sorted: Vec<f64> = runs.iter().map(pick).collect();
        sorted.sort_by(f64::total_cmp);
        sorted[sorted.len() / 2]
    };
    Ok((median(|run| run.0), median(|run| run.1)))
}

/// Seconds that `work` took, and its result.
fn timed<T>(work: impl FnOnce() -> T) -> (f64, T) {
    let started = Instant::now();
    let result = work();
    (started.elapsed().as_secs_f64(), result)
}
