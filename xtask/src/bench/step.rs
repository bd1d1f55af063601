//! A whole training step of each stage: everything that `mvfusion train` does between two views drawn and the parameters
//! changed. Numbers of threads are compared, and series in which one factor grows.

use std::fs;
use std::num::NonZeroUsize;
use std::path::PathBuf;

use anyhow::{Context, Result, ensure};
use clap::Args;
use mvfusion_cli::sweep::table::{Plot, Point, Series, Spread};
use mvfusion_data::Scene;
use mvfusion_model::config::{Config, DensifyConfig, InitConfig, Interval, StageConfig, Steps, TrainConfig};
use mvfusion_model::train::{Stage, Trainer};
use rayon::ThreadPool;

use super::growth::{Factor, Run};
use super::scene::SceneSize;
use super::{Row, Seconds, Subjected, amdahl, medians, processor, threads, timed};

/// Views of a step (DeGauss: 2 for video).
const BATCH: usize = 2;

/// A step that is never reached.
const NEVER: usize = 1_000_000;

/// What to train.
#[derive(Debug, Args)]
pub struct StepArguments {
    /// Dynamic Gaussians and the pictures' size, as COUNT@WIDTHxHEIGHT.
    #[arg(long = "scene", value_delimiter = ',', default_values = ["4000@160x120"])]
    scenes: Vec<SceneSize>,
    /// Static Gaussians beside them.
    #[arg(long = "static", default_value_t = 10_000)]
    still: usize,
    /// Let this grow, and keep all else as in the first scene.
    #[arg(long, value_enum)]
    vary: Option<Factor>,
    /// What it grows through, instead of its default values.
    #[arg(long, value_delimiter = ',', requires = "vary")]
    values: Vec<String>,
    /// Draw the milliseconds of a step over what varies, or over the threads, in this SVG file.
    #[arg(long)]
    plot: Option<PathBuf>,
}

/// A measured step.
#[derive(Clone, Copy, Debug, PartialEq)]
struct Measured {
    /// Where it stands on the axis of what varies.
    x: f64,
    stage: Stage,
    threads: usize,
    wall: f64,
}

/// Measures every scene, or the series, in every stage on every device with every number of threads.
pub fn measure(
    arguments: &StepArguments,
    devices: &[Subjected],
    threads: &[NonZeroUsize],
    repeat: usize,
    note: &mut impl FnMut(Row),
) -> Result<()> {
    let pools = threads::pools(threads)?;
    let runs = runs(arguments)?;
    let is_single = runs.len() == 1 || arguments.vary.is_some();
    ensure!(arguments.plot.is_none() || is_single, "--plot draws one scene, or what --vary names");
    print_heading();
    let mut measured = vec![Vec::new(); devices.len()];
    for (x, run) in &runs {
        let scene = run.scene();
        let mut times: Vec<Vec<Measured>> = vec![Vec::new(); devices.len()];
        for stage in Stage::ALL {
            measure_stage((*x, run, stage), &scene, devices, &pools, repeat, &mut |device, row, step| {
                times[device].push(step);
                note(row);
            })?;
        }
        for ((Subjected { name, .. }, times), all) in devices.iter().zip(times).zip(&mut measured) {
            print_shares(name, &times);
            all.extend(times);
        }
    }
    match &arguments.plot {
        Some(path) => {
            let text = plot(arguments.vary, &runs[0].1, devices, &measured).svg();
            fs::write(path, text).with_context(|| format!("cannot write {}", path.display()))
        }
        None => Ok(()),
    }
}

/// The runs to measure, each with its value on the axis of a plot.
fn runs(arguments: &StepArguments) -> Result<Vec<(f64, Run)>> {
    let runs = arguments.scenes.iter().map(|size| Run::new(size, arguments.still));
    match (arguments.vary, runs.clone().next()) {
        (Some(factor), Some(first)) => factor.series(&first, &arguments.values),
        _ => Ok(runs.map(|run| (0.0, run)).collect()),
    }
}

/// Measures a stage. Devices and numbers of threads take turns.
fn measure_stage(
    (x, run, stage): (f64, &Run, Stage),
    scene: &Scene,
    devices: &[Subjected],
    pools: &[ThreadPool],
    repeat: usize,
    found: &mut impl FnMut(usize, Row, Measured),
) -> Result<()> {
    let subjects: Vec<(usize, &ThreadPool)> =
        (0..devices.len()).flat_map(|device| pools.iter().map(move |pool| (device, pool))).collect();
    let trainer = |&(device, pool): &(usize, &ThreadPool)| {
        pool.install(|| Trainer::new(config(run, stage), scene, &devices[device].device))
    };
    let mut trainers = subjects.iter().map(trainer).collect::<Result<Vec<_>, _>>()?;
    let times = medians(subjects.len(), repeat, |subject| {
        let ((device, pool), trainer) = (subjects[subject], &mut trainers[subject]);
        pool.install(|| {
            let before = processor::seconds();
            let (wall, loss) = timed(&devices[device].device, || trainer.step())?;
            loss?.context("the run is over")?;
            let spent = processor::seconds().zip(before).map(|(after, before)| after - before);
            Ok([wall, spent.unwrap_or(f64::NAN)])
        })
    })?;
    for ((device, pool), [wall, spent]) in subjects.into_iter().zip(times) {
        let threads = pool.current_num_threads();
        let row = Row {
            scene: format!("step of {BATCH} views, {}", run.name()),
            device: devices[device].name.clone(),
            threads,
            seconds: Seconds::Stage { stage: stage.name(), wall, processor: spent.is_finite().then_some(spent) },
            pairs: None,
            peak_bytes: None,
        };
        found(device, row, Measured { x, stage, threads, wall });
    }
    Ok(())
}

#[allow(clippy::print_stdout, reason = "the table is this program's output")]
fn print_heading() {
    println!("| run | device | threads | stage | ms | processor ms | idle |\n|---|---|---|---|---|---|---|");
}

/// The row of a table.
pub(super) fn table_row(row: &Row, stage: &str, wall: f64, processor: Option<f64>) -> String {
    let of_processor = |show: &dyn Fn(f64) -> String| processor.map_or("-".to_owned(), show);
    format!(
        "| {} | {} | {} | {stage} | {:.1} | {} | {} |",
        row.scene,
        row.device,
        row.threads,
        1e3 * wall,
        of_processor(&|seconds| format!("{:.1}", 1e3 * seconds)),
        of_processor(&|seconds| format!("{:.0} %", 100.0 * processor::idle_share(wall, seconds, row.threads))),
    )
}

/// Amdahl's shares of a run's stages, if there are several numbers of threads.
#[allow(clippy::print_stdout, reason = "the shares are this program's output")]
fn print_shares(device: &str, measured: &[Measured]) {
    for stage in Stage::ALL {
        let times = measured.iter().filter(|step| step.stage == stage).map(|step| (step.threads, step.wall));
        if let Some(share) = amdahl::serial_share(&times.collect::<Vec<_>>()) {
            println!("\n{device}, {}: {:.0} % of a step on one thread is serial (Amdahl)", stage.name(), 100.0 * share);
        }
    }
}

/// Milliseconds of a step over what varies, a line for each stage; otherwise over the threads.
fn plot(vary: Option<Factor>, run: &Run, devices: &[Subjected], measured: &[Vec<Measured>]) -> Plot {
    let mut series = Vec::new();
    for (Subjected { name, .. }, measured) in devices.iter().zip(measured) {
        let mut counts: Vec<usize> = measured.iter().map(|step| step.threads).collect();
        counts.sort_unstable();
        counts.dedup();
        let lines: Vec<Option<usize>> = match vary {
            Some(_) => counts.into_iter().map(Some).collect(),
            None => vec![None],
        };
        for (stage, threads) in Stage::ALL.into_iter().flat_map(|stage| lines.iter().map(move |&line| (stage, line))) {
            let steps = measured.iter().filter(|step| step.stage == stage && threads.is_none_or(|n| n == step.threads));
            let point = |step: &Measured| Point {
                x: if vary.is_some() { step.x } else { step.threads as f64 },
                spread: Some(Spread { mean: 1e3 * step.wall, deviation: None }),
                paper: None,
                is_comparable: true,
            };
            let of_threads = threads.map_or(String::new(), |threads| format!(", {threads} threads"));
            let name = format!("{}, {name}{of_threads}", stage.name());
            series.push(Series { name, points: steps.map(point).collect() });
        }
    }
    let x_title = vary.map_or("threads", Factor::title);
    let title = match vary {
        Some(factor) => format!("A training step over {}", factor.title()),
        None => format!("A training step of {}", run.name()),
    };
    Plot { file: String::new(), title, x_title: x_title.to_owned(), y_title: "ms per step".to_owned(), series }
}

/// The default method at these numbers of Gaussians, in one stage that never ends and in which nothing adds or removes
/// any.
pub(super) fn config(run: &Run, stage: Stage) -> Config {
    let steps = Stage::ALL.map(|other| if other == stage { NEVER } else { 0 });
    Config {
        init: InitConfig {
            dynamic_points: run.dynamic,
            dynamic_from_cloud: 0,
            static_points: run.still,
            ..InitConfig::default()
        },
        train: TrainConfig { batch_size: BATCH, stages: StageConfig::of(steps), ..TrainConfig::default() },
        densify: DensifyConfig {
            from: Steps(NEVER),
            prune_from: Steps(NEVER),
            reset_interval: Interval(NEVER),
            ..DensifyConfig::default()
        },
        ..Config::default()
    }
}

#[cfg(all(test, feature = "flex"))]
mod tests {
    use super::*;

    fn tiny() -> Run {
        let mut run = Run::new(&SceneSize { count: 30, width: 32, height: 24 }, 50);
        run.scene.frames = 2;
        run
    }

    #[test]
    fn every_stage_is_measured_with_every_number_of_threads() {
        let pools = threads::pools(&[NonZeroUsize::MIN]).expect("one thread");
        let devices = [Subjected { name: "flex".to_owned(), device: mvfusion_model::device::flex() }];
        for stage in Stage::ALL {
            let mut found = Vec::new();
            measure_stage((7.0, &tiny(), stage), &tiny().scene(), &devices, &pools, 1, &mut |_, row, step| {
                found.push((row, step));
            })
            .expect("measured");
            let [(row, step)] = found.as_slice() else { panic!("one device and one number of threads") };
            assert_eq!((step.x, step.stage, step.threads), (7.0, stage, 1));
            assert!(step.wall > 0.0);
            assert!(table_row(row, stage.name(), step.wall, None).ends_with("| - | - |"));
        }
    }

    #[test]
    fn a_plot_has_a_line_for_each_stage_and_number_of_threads() {
        let devices = [Subjected { name: "flex".to_owned(), device: mvfusion_model::device::flex() }];
        let step = |x: f64, stage, threads| Measured { x, stage, threads, wall: 0.01 * x };
        let steps =
            Stage::ALL.iter().flat_map(|&stage| [step(1.0, stage, 1), step(2.0, stage, 1), step(1.0, stage, 2)]);
        let measured = [steps.collect::<Vec<_>>()];
        let over = |vary| plot(vary, &tiny(), &devices, &measured);
        assert_eq!(over(Some(Factor::Frames)).series.len(), 6);
        let threads = over(None);
        assert_eq!((threads.series.len(), threads.series[0].points.len()), (3, 3));
        assert!(over(Some(Factor::Frames)).svg().contains("refinement, flex, 2 threads"));
    }
}
