//! Benchmarks: what an op costs on each device of this machine, printed and, if asked for, written as JSON.

mod amdahl;
mod growth;
#[cfg(feature = "cube")]
mod launches;
mod lpips;
mod net;
mod processor;
mod scene;
mod seeding;
mod splat;
mod step;
mod threads;
mod view;

use std::num::NonZeroUsize;
use std::path::PathBuf;
use std::time::Instant;

use anyhow::{Context, Result, bail, ensure};
use clap::{Args, Subcommand};
use mvfusion_model::{Device, device};
use serde::Serialize;

/// What to measure, and how.
#[derive(Debug, Args)]
pub struct BenchArguments {
    #[command(subcommand)]
    subject: Subject,
    /// Devices to compare, as `mvfusion devices` names them; all by default.
    #[arg(long, global = true, value_delimiter = ',')]
    devices: Vec<String>,
    /// Write the metrics to this file as JSON.
    #[arg(long, global = true)]
    json: Option<PathBuf>,
    /// Threads to use; all cores by default. `step` compares several numbers, as 1,2,4.
    #[arg(long, global = true, value_delimiter = ',')]
    threads: Vec<NonZeroUsize>,
    /// Counted repetitions, after those that are not counted.
    #[arg(long, global = true, default_value_t = 5)]
    repeat: usize,
}

/// A thing to measure.
#[derive(Debug, Subcommand)]
enum Subject {
    /// The splat op: forward alone, forward and backward.
    Splat(splat::SplatArguments),
    /// HexPlane look-up, then trunk and all heads, forward and backward.
    Net(net::NetArguments),
    /// A whole training step of each stage with two views.
    Step(step::StepArguments),
    /// Launches by kernel and memory of a training step, counted on a GPU or a software driver.
    #[cfg(feature = "cube")]
    Launches(launches::LaunchArguments),
    /// LPIPS of a pair of pictures. Its metric does not depend on the weights, which are random here.
    Lpips(lpips::LpipsArguments),
    /// Moving pixels and the motion hull of a synthetic film, on the CPU.
    Seeding(seeding::SeedingArguments),
    /// Latency of the viewer, from a request to a picture.
    View(view::ViewArguments),
}

/// One measurement; times in seconds, medians over the repetitions.
#[derive(Debug, Serialize)]
struct Row {
    scene: String,
    device: String,
    threads: usize,
    seconds: Seconds,
    #[serde(skip_serializing_if = "Option::is_none")]
    pairs: Option<Pairs>,
    /// Largest memory of the process.
    #[serde(skip_serializing_if = "Option::is_none")]
    peak_bytes: Option<u64>,
}

/// What was timed.
#[derive(Clone, Copy, Debug, Serialize)]
#[serde(rename_all = "snake_case")]
enum Seconds {
    /// Both passes, and the forward pass where nothing is kept for another.
    Passes { render: Option<f64>, forward: f64, backward: f64 },
    /// A comparison, or a search.
    Whole(f64),
    /// A step of a stage, and the processor time of all threads where the system tells it.
    Stage { stage: &'static str, wall: f64, processor: Option<f64> },
}

/// Gaussian-pixel pairs of a splat.
#[derive(Clone, Copy, Debug, Serialize)]
struct Pairs {
    intersections: usize,
    evaluated: usize,
    contributing: usize,
}

/// A device under its name.
struct Subjected {
    name: String,
    device: Device,
}

/// Runs a benchmark.
pub fn run(arguments: &BenchArguments) -> Result<()> {
    let compares = matches!(arguments.subject, Subject::Step(_));
    ensure!(compares || arguments.threads.len() < 2, "only `step` compares several numbers of threads");
    if let Some(threads) = arguments.threads.first().filter(|_| !compares) {
        rayon::ThreadPoolBuilder::new()
            .num_threads(threads.get())
            // As in the program.
            .use_current_thread()
            .build_global()
            .context("cannot set the number of threads")?;
    }
    if let Subject::View(_) = arguments.subject
        && arguments.threads.is_empty()
    {
        mvfusion_cli::threads::start(mvfusion_cli::threads::count(None))?;
    }
    let devices = devices(&arguments.devices)?;
    let mut rows = Vec::new();
    let mut note = |row: Row| {
        print(&row);
        rows.push(row);
    };
    match &arguments.subject {
        Subject::Splat(subject) => splat::measure(subject, &devices, arguments.repeat, &mut note)?,
        Subject::Net(subject) => net::measure(subject, &devices, arguments.repeat, &mut note)?,
        Subject::Step(subject) => step::measure(subject, &devices, &arguments.threads, arguments.repeat, &mut note)?,
        #[cfg(feature = "cube")]
        Subject::Launches(subject) => launches::measure(subject, &devices)?,
        Subject::Lpips(subject) => lpips::measure(subject, &devices, arguments.repeat, &mut note)?,
        Subject::Seeding(subject) => seeding::measure(subject, &mut note)?,
        Subject::View(subject) => {
            let device = arguments.devices.first().map_or("cpu", String::as_str);
            view::measure(subject, device, &mut note)?;
        }
    }
    if let Some(path) = &arguments.json {
        let text = serde_json::to_string_pretty(&rows)?;
        std::fs::write(path, text).with_context(|| format!("cannot write {}", path.display()))?;
    }
    Ok(())
}

#[allow(clippy::print_stdout, reason = "the table is this program's output")]
fn print(row: &Row) {
    if let Seconds::Stage { stage, wall, processor } = row.seconds {
        println!("{}", step::table_row(row, stage, wall, processor));
        return;
    }
    print!("{} on {}, {} threads: ", row.scene, row.device, row.threads);
    match row.seconds {
        Seconds::Passes { render, forward, backward } => {
            if let Some(render) = render {
                print!("render {:.2} ms ({:.1} frames/s), ", 1e3 * render, 1.0 / render);
            }
            println!("forward {:.2} ms, backward {:.2} ms", 1e3 * forward, 1e3 * backward);
        }
        Seconds::Whole(seconds) | Seconds::Stage { wall: seconds, .. } => println!("{:.2} ms", 1e3 * seconds),
    }
    if let Some(bytes) = row.peak_bytes {
        println!("    at most {} MiB of memory", bytes >> 20);
    }
    if let Some(pairs) = row.pairs {
        println!(
            "    {} tile entries, {:.2} M pairs evaluated, {:.2} M contributing",
            pairs.intersections,
            1e-6 * pairs.evaluated as f64,
            1e-6 * pairs.contributing as f64,
        );
    }
}

/// The devices of these names, or all that were compiled in and found.
fn devices(names: &[String]) -> Result<Vec<Subjected>> {
    let subjected = |name: &str, device: Device| Subjected { name: name.to_owned(), device };
    let mut there = vec![
        #[cfg(feature = "flex")]
        subjected("flex", device::flex()),
        #[cfg(feature = "ndarray")]
        subjected("ndarray", device::ndarray()),
    ];
    #[cfg(any(feature = "wgpu", feature = "cuda"))]
    for gpu in device::gpus() {
        // A GPU that is open may disturb what is measured beside it.
        if names.is_empty() || names.contains(&gpu.label()) {
            let software = if gpu.is_software { ", software" } else { "" };
            there.push(subjected(
                &format!("{} ({}{software})", gpu.label(), gpu.properties()?.name),
                gpu.device.clone(),
            ));
        }
    }
    if names.is_empty() {
        return Ok(there);
    }
    for name in names {
        if !there.iter().any(|device| is_called(&device.name, name)) {
            let known = there.iter().map(|device| device.name.clone());
            #[cfg(any(feature = "wgpu", feature = "cuda"))]
            let known = known.chain(device::gpus().iter().map(|gpu| gpu.label()));
            bail!("there is no device `{name}`; there are: {}", known.collect::<Vec<_>>().join(", "));
        }
    }
    there.retain(|device| names.iter().any(|name| is_called(&device.name, name)));
    Ok(there)
}

/// Whether `name` is the first word of a device's full name.
fn is_called(full: &str, name: &str) -> bool {
    full.split(' ').next() == Some(name)
}

/// For each of `subjects`, the medians of what `run` gives, over `repeat` runs after two that are not counted: a GPU's
/// driver compiles in the first and finds its memory in the second. Subjects take turns, so that whatever else the
/// machine does meets all of them.
fn medians<const N: usize>(
    subjects: usize,
    repeat: usize,
    mut run: impl FnMut(usize) -> Result<[f64; N]>,
) -> Result<Vec<[f64; N]>> {
    ensure!(repeat > 0, "--repeat is 0: nothing would be measured");
    let mut runs = vec![Vec::new(); subjects];
    for turn in 0..2 + repeat {
        for (subject, runs) in runs.iter_mut().enumerate() {
            let times = run(subject)?;
            if turn >= 2 {
                runs.push(times);
            }
        }
    }
    Ok(runs.iter().map(|runs| std::array::from_fn(|i| median(runs.iter().map(|run| run[i]).collect()))).collect())
}

fn median(mut numbers: Vec<f64>) -> f64 {
    numbers.sort_by(f64::total_cmp);
    numbers[numbers.len() / 2]
}

/// Seconds until the device has done what `work` asks of it, and its result. The device was idle before.
fn timed<T>(device: &Device, work: impl FnOnce() -> T) -> Result<(f64, T)> {
    device.sync()?;
    let started = Instant::now();
    let result = work();
    device.sync()?;
    Ok((started.elapsed().as_secs_f64(), result))
}
