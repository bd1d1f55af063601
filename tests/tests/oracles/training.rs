//! Training on a GPU backend: the same losses as on the CPU, and no memory that grows.

use std::path::Path;
use std::process::Command;

use anyhow::{Context, Result, ensure};
use burn::tensor::Device;
use libtest_mimic::{Completion, Trial};
use mvfusion_data::builtin::builtin;
use mvfusion_data::{BuiltinOptions, Scene};
use mvfusion_model::config::{
    Branches, Config, DensifyConfig, GridConfig, InitConfig, Interval, ModelConfig, MotionConfig, StageConfig, Steps,
    TrainConfig,
};
use mvfusion_model::train::Trainer;
use mvfusion_tests::{Backend, Checklist, Tolerance, backends, numbers};

/// How far a loss may be from the CPU's.
const LOSSES: Tolerance = Tolerance::of_entry(1e-3);

/// The three stages of the run whose memory is watched: the steps of each, and those after which everything that a stage
/// keeps has been allocated. They are few, because a driver that computes on the CPU takes minutes for them.
const LONG: [[usize; 2]; 3] = [[300, 100], [80, 30], [50, 20]];

/// Equal parts of a stage from there to its end. What leaks, leaks in all of them; a pool of another thread, or a queue
/// that was longer than ever, shows in one.
const PARTS: usize = 5;

/// What memory may grow by in such a part if half of them grow by more: the noise of allocators.
const GROWTH: i64 = (16 << 20) / PARTS as i64;

/// Where Linux tells the memory of a process.
const PROCESS_MEMORY: &str = "/proc/self/statm";

/// Set in the process that the memory trial runs in.
const ALONE: &str = "MVFUSION_TRIAL_ALONE";

/// The trials of a GPU backend.
pub fn trials(backend: Backend) -> Vec<Trial> {
    let device = backend.device;
    vec![
        memory_trial(backend),
        Trial::test(format!("training::{}::twenty_steps", backend.name), move || {
            losses_agree(&device()).map_err(|error| format!("{error:#}").into())
        }),
    ]
}

/// The trial that watches the memory of its process, and so runs in one of its own.
fn memory_trial(backend: Backend) -> Trial {
    let name = format!("training::{}::memory", backend.name);
    let own_name = name.clone();
    Trial::ignorable_test(name, move || {
        if !Path::new(PROCESS_MEMORY).exists() {
            return Ok(Completion::ignored_with(format!("{PROCESS_MEMORY} tells a process's memory on Linux alone")));
        }
        if std::env::var_os(ALONE).is_some() {
            memory_stays(&(backend.device)()).map_err(|error| format!("{error:#}"))?;
            return Ok(Completion::Completed);
        }
        let program = std::env::current_exe()?;
        let child = Command::new(program).args([&own_name, "--exact"]).env(ALONE, "1").output()?;
        if child.status.success() {
            return Ok(Completion::Completed);
        }
        Err(String::from_utf8_lossy(&child.stdout).into_owned().into())
    })
}

/// A scene of few, small pictures.
fn scene() -> Scene {
    builtin(&BuiltinOptions { width: 64, height: 48, frames: 6, ..BuiltinOptions::default() })
}

/// A run of the given stages with 500 Gaussians at most, the modules, and nothing that changes rows.
pub fn config(branches: Branches, stages: StageConfig) -> Config {
    Config {
        seed: 3,
        init: InitConfig { dynamic_points: 250, dynamic_from_cloud: 20, static_points: 250, ..InitConfig::default() },
        model: ModelConfig {
            width: 32,
            grid: GridConfig {
                features: 8,
                resolution: [8, 8, 8, 6],
                multipliers: vec![1, 2],
                ..GridConfig::default()
            },
            sh_degree: 2,
            branches,
            ..ModelConfig::default()
        },
        motion: MotionConfig {
            interval: Interval(5),
            samples: 6,
            knot_stride: 2,
            window: 1,
            hidden: 32,
            attention_width: 32,
            heads: 2,
            ..MotionConfig::default()
        },
        train: TrainConfig { stages, ..TrainConfig::default() },
        densify: DensifyConfig {
            from: Steps(1_000_000),
            prune_from: Steps(1_000_000),
            reset_interval: Interval(1_000_000),
            ..DensifyConfig::default()
        },
        ..Config::default()
    }
}

/// The losses of twenty steps through all stages.
pub fn losses(device: &Device) -> Result<Vec<f64>> {
    let stages = StageConfig::of([6, 6, 8]);
    let mut trainer = Trainer::new(config(Branches::Both, stages), &scene(), device)?;
    let mut losses = Vec::new();
    while let Some(loss) = trainer.step()? {
        losses.push(numbers(loss.total)[0]);
        losses.push(numbers(loss.squared_error)[0]);
    }
    Ok(losses)
}

fn losses_agree(device: &Device) -> Result<()> {
    let reference = backends().into_iter().next().context("a CPU backend is compiled in")?;
    let (wanted, found) = (losses(&(reference.device)())?, losses(device)?);
    ensure!(wanted.len() == 40, "{} losses", wanted.len());
    let mut checks = Checklist::default();
    for (step, (wanted, found)) in wanted.chunks(2).zip(found.chunks(2)).enumerate() {
        checks.close_number(format!("loss of step {step}"), wanted[0], found[0], LOSSES);
        checks.close_number(format!("squared error of step {step}"), wanted[1], found[1], LOSSES);
    }
    checks.finish()
}

/// Bytes that the process and the device hold.
fn held(device: &Device) -> Result<[i64; 2]> {
    let status = std::fs::read_to_string(PROCESS_MEMORY).context("the process tells its memory")?;
    let pages: i64 = status.split_whitespace().nth(1).context("the second field")?.parse()?;
    let usage = device.memory_pool_usage().context("the device tells its memory")?;
    Ok([pages * 4096, i64::try_from(usage.bytes_reserved)?])
}

fn memory_stays(device: &Device) -> Result<()> {
    let stages = StageConfig::of(LONG.map(|[steps, _]| steps));
    // One branch takes a third of the launches of two: on a driver that computes on the CPU they are what a step costs.
    let config = config(Branches::Dynamic, stages);
    let config = Config { init: InitConfig { dynamic_points: 500, dynamic_from_cloud: 0, ..config.init }, ..config };
    let mut trainer = Trainer::new(config, &scene(), device)?;
    for [steps, warm] in LONG {
        let part = (steps - warm) / PARTS;
        let mut readings = Vec::new();
        for step in 1..=steps {
            let loss = trainer.step()?.context("the run is not over")?;
            if step % 50 == 0 {
                ensure!(numbers(loss.total)[0].is_finite(), "the loss at step {step} of {steps}");
            }
            if step >= warm && (step - warm).is_multiple_of(part) {
                readings.push(held(device)?);
            }
        }
        for (index, what) in ["process", "device"].into_iter().enumerate() {
            let readings: Vec<i64> = readings.iter().map(|held| held[index]).collect();
            let mut growth: Vec<i64> = readings.windows(2).map(|pair| pair[1] - pair[0]).collect();
            growth.sort_unstable();
            let median = growth[growth.len() / 2];
            ensure!(
                median <= GROWTH,
                "the {what} grows by {median} bytes in {part} steps; from step {warm} of {steps} it holds {readings:?}"
            );
        }
    }
    Ok(())
}
