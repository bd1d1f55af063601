//! A whole training step: everything that `mvfusion train` does between two views drawn and the parameters changed.

use anyhow::{Context, Result};
use clap::Args;
use mvfusion_data::builtin::builtin;
use mvfusion_data::{BuiltinOptions, Scene};
use mvfusion_model::config::{Config, DensifyConfig, InitConfig, Interval, StageConfig, Steps, TrainConfig};
use mvfusion_model::train::Trainer;

use super::scene::SceneSize;
use super::{Row, Seconds, Subjected, medians, timed};

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
}

/// Measures every scene on every device.
pub fn measure(
    arguments: &StepArguments,
    devices: &[Subjected],
    repeat: usize,
    note: &mut impl FnMut(Row),
) -> Result<()> {
    for size in &arguments.scenes {
        let scene = scene(size);
        let mut trainers = devices
            .iter()
            .map(|subject| Trainer::new(config(size.count, arguments.still), &scene, &subject.device))
            .collect::<Result<Vec<_>, _>>()?;
        let times = medians(devices.len(), repeat, |subject| {
            let (seconds, loss) = timed(&devices[subject].device, || trainers[subject].step())?;
            loss?.context("the run is over")?;
            Ok([seconds])
        })?;
        for (Subjected { name, .. }, [seconds]) in devices.iter().zip(times) {
            note(Row {
                scene: format!("step of {BATCH} views, {} static and {size}", arguments.still),
                device: name.clone(),
                threads: rayon::current_num_threads(),
                seconds: Seconds::Step(seconds),
                pairs: None,
                peak_bytes: None,
            });
        }
    }
    Ok(())
}

fn scene(size: &SceneSize) -> Scene {
    builtin(&BuiltinOptions { width: size.width, height: size.height, frames: 4, ..BuiltinOptions::default() })
}

/// The default method at these numbers of Gaussians, in its last stage, where nothing adds or removes any.
fn config(dynamic: usize, still: usize) -> Config {
    Config {
        init: InitConfig {
            dynamic_points: dynamic,
            dynamic_from_cloud: 0,
            static_points: still,
            ..InitConfig::default()
        },
        train: TrainConfig { batch_size: BATCH, stages: StageConfig::of([0, 0, NEVER]), ..TrainConfig::default() },
        densify: DensifyConfig {
            from: Steps(NEVER),
            prune_from: Steps(NEVER),
            reset_interval: Interval(NEVER),
            ..DensifyConfig::default()
        },
        ..Config::default()
    }
}
