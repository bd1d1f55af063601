//! A finished run, opened without the program: configuration, scene, last checkpoint, and the render of a held-out
//! view.
//!
//! `cargo run -p mvfusion-model --example open_run [RUN [PICTURE.png]]`
//!
//! Without arguments, a small run is trained first.
#![allow(clippy::print_stdout, reason = "an example shows what it found")]

use std::error::Error;
use std::path::{Path, PathBuf};

use mvfusion_data::Capture;
use mvfusion_model::config::{Config, TrainConfig};
use mvfusion_model::device;
use mvfusion_model::evaluation::{Layer, LayerRenderer, quantise};
use mvfusion_model::model::RenderContext;
use mvfusion_model::train::{TrainedModel, Trainer};

/// The files of a run folder that are read here.
const CONFIG: &str = "config.toml";
const CHECKPOINT: &str = "checkpoints/final.safetensors";

fn main() -> Result<(), Box<dyn Error>> {
    let folder = tempfile::tempdir()?;
    let mut arguments = std::env::args_os().skip(1).map(PathBuf::from);
    let run = match arguments.next() {
        Some(run) => run,
        None => {
            train(folder.path())?;
            folder.path().to_owned()
        }
    };
    let picture = arguments.next().unwrap_or_else(|| folder.path().join("picture.png"));
    render(&run, &picture)
}

/// Opens a run and renders its first held-out view.
fn render(run: &Path, picture: &Path) -> Result<(), Box<dyn Error>> {
    let config: Config = toml::from_str(&std::fs::read_to_string(run.join(CONFIG))?)?;
    let scene = config.open_scene()?;
    // The file has the configuration as it was given; model and steps follow from what `train.scale` makes of it.
    let config = config.scaled();
    let trained = TrainedModel::load(&run.join(CHECKPOINT), &config, &device::flex())?;

    let context = RenderContext::new(&config, &scene);
    let view = scene.test.first().ok_or("the scene has no held-out view")?;
    // A held-out photo has no moment: it shows the static branch, if there is one.
    let is_still = scene.capture == Capture::Photos && trained.model.static_.is_some();
    let moment = (!is_still).then_some(view.time);
    let (level, weights) = (trained.level(&config), config.motion.weights);
    let renderer = LayerRenderer::new(&trained.model, level, &context, &[Layer::Composed], weights)?;
    for layer in renderer.render(&view.camera, moment)? {
        quantise(layer.values.unsqueeze_dim(0))?.save(picture)?;
    }
    println!("`{}` after {} steps: {}", view.name, trained.steps, picture.display());
    Ok(())
}

/// Trains a small run and writes what a run folder has of it.
fn train(run: &Path) -> Result<(), Box<dyn Error>> {
    let train = TrainConfig { scale: 0.0005, ..TrainConfig::default() };
    let config = Config { train, ..Config::default() };
    let scene = config.open_scene()?;
    let config = config.for_times_of(&scene);
    let mut trainer = Trainer::new(config.scaled(), &scene, &device::flex())?;
    while trainer.step()?.is_some() {}
    std::fs::write(run.join(CONFIG), toml::to_string(&config)?)?;
    std::fs::create_dir_all(run.join("checkpoints"))?;
    trainer.state().save(&run.join(CHECKPOINT))?;
    Ok(())
}
