//! What a training step asks of a GPU, counted: launches by kernel, and the device's memory. A software driver counts as
//! a GPU does.

use std::collections::BTreeMap;
use std::sync::{Arc, Mutex, PoisonError};

use anyhow::{Context, Result, ensure};
use clap::Args;
use cubecl::config::{TypeNameFormatLevel, type_name_format};
use cubecl::logging::{LaunchObservation, LaunchObserver};
use mvfusion_model::train::{Stage, Trainer};
use mvfusion_render::device::is_gpu;

use super::Subjected;
use super::growth::Run;
use super::scene::SceneSize;
use super::step::config;

/// Steps before the counted ones: the first ones compile kernels and fill the memory pools.
const WARM_UP: usize = 2;

/// What to train.
#[derive(Debug, Args)]
pub struct LaunchArguments {
    /// Dynamic Gaussians and the pictures' size, as COUNT@WIDTHxHEIGHT.
    #[arg(long, default_value = "4000@160x120")]
    scene: SceneSize,
    /// Static Gaussians beside them.
    #[arg(long = "static", default_value_t = 10_000)]
    still: usize,
    /// Counted steps.
    #[arg(long, default_value_t = 2)]
    steps: usize,
}

/// Counts of launches by the kernel's name.
#[derive(Default)]
struct Counter(Mutex<BTreeMap<&'static str, usize>>);

impl LaunchObserver for Counter {
    fn launched(&self, kernel: &'static str) {
        *self.0.lock().unwrap_or_else(PoisonError::into_inner).entry(kernel).or_default() += 1;
    }
}

/// What a stage's steps asked for, and the memory after them.
struct Counted {
    launches: BTreeMap<String, usize>,
    /// Buffers in use, and bytes taken from the driver.
    slices: u64,
    reserved: u64,
}

/// Counts the steps of every stage on the first GPU, and prints them.
pub fn measure(arguments: &LaunchArguments, devices: &[Subjected]) -> Result<()> {
    let gpu = devices.iter().find(|subject| is_gpu(&subject.device));
    let gpu = gpu.context("there is no GPU, not even a software driver, so there is nothing to count")?;
    ensure!(arguments.steps > 0, "--steps must be at least 1");
    let run = Run::new(&arguments.scene, arguments.still);
    let scene = run.scene();
    let counted = Stage::ALL.map(|stage| -> Result<Counted> {
        let mut trainer = Trainer::new(config(&run, stage), &scene, &gpu.device)?;
        let mut steps = |count: usize| (0..count).try_for_each(|_| trainer.step().map(|_| ()));
        steps(WARM_UP)?;
        let counter = Arc::new(Counter::default());
        let observation = LaunchObservation::new(counter.clone());
        steps(arguments.steps)?;
        drop(observation);
        let usage = gpu.device.memory_pool_usage().context("a GPU knows its memory")?;
        let counts = counter.0.lock().unwrap_or_else(PoisonError::into_inner);
        let mut launches: BTreeMap<String, usize> = BTreeMap::new();
        for (name, count) in counts.iter() {
            *launches.entry(type_name_format(name, TypeNameFormatLevel::Short)).or_default() += count;
        }
        Ok(Counted { launches, slices: usage.number_allocs, reserved: usage.bytes_reserved })
    });
    let counted = counted.into_iter().collect::<Result<Vec<_>>>()?;
    print(&run, &gpu.name, arguments.steps, &counted);
    Ok(())
}

#[allow(clippy::print_stdout, reason = "the table is this program's output")]
fn print(run: &Run, device: &str, steps: usize, counted: &[Counted]) {
    println!("A step of two views, {}, on {device}.\n", run.name());
    let row = |name: &str, of: &dyn Fn(&Counted) -> String| {
        println!("| {name} | {} |", counted.iter().map(of).collect::<Vec<_>>().join(" | "));
    };
    println!("| | {} |\n|---|{}", Stage::ALL.map(Stage::name).join(" | "), "---|".repeat(counted.len()));
    let a_step = |count: usize| format!("{:.1}", count as f64 / steps as f64);
    row("launches", &|stage| a_step(stage.launches.values().sum()));
    let names: BTreeMap<&String, usize> =
        counted.iter().flat_map(|stage| &stage.launches).fold(BTreeMap::new(), |mut all, (name, count)| {
            *all.entry(name).or_default() += count;
            all
        });
    let mut names: Vec<(&String, usize)> = names.into_iter().collect();
    names.sort_by_key(|&(_, count)| std::cmp::Reverse(count));
    for (name, _) in names {
        row(&format!("`{name}`"), &|stage| a_step(stage.launches.get(name).copied().unwrap_or(0)));
    }
    row("live slices of the pools", &|stage| stage.slices.to_string());
    row("reserved memory", &|stage| format!("{} MiB", stage.reserved >> 20));
}
