//! A schedule of your own: views in turn instead of at random, and learning rates that warm up and fall by a cosine.
//!
//! `cargo run -p mvfusion-model --example custom_schedule`
#![allow(clippy::print_stdout, reason = "an example shows what it found")]

use std::f64::consts::PI;

use mvfusion_data::BuiltinOptions;
use mvfusion_data::builtin::builtin;
use mvfusion_model::config::{Config, TrainConfig};
use mvfusion_model::train::optim::Rates;
use mvfusion_model::train::{Position, Trainer};
use mvfusion_model::{ModelError, device};

/// Share of a stage in which the rates rise from zero.
const WARM_UP: f64 = 0.1;

/// Factor of the rates: rises linearly, then falls to zero as half a period of a cosine.
fn factor(position: &Position) -> f64 {
    let done = position.stage_step as f64 / position.stage_length as f64;
    match done < WARM_UP {
        true => done / WARM_UP,
        false => 0.5 + 0.5 * (PI * (done - WARM_UP) / (1.0 - WARM_UP)).cos(),
    }
}

/// The configured rates, of which those of the network follow the factor. Those of the Gaussians stay.
fn schedule(configured: Rates, position: &Position) -> Rates {
    let factor = factor(position);
    Rates {
        deformation: configured.deformation * factor,
        grid: configured.grid * factor,
        motion: configured.motion * factor,
        ..configured
    }
}

fn main() -> Result<(), ModelError> {
    let scene = builtin(&BuiltinOptions { width: 64, height: 48, frames: 8, ..BuiltinOptions::default() });
    let train = TrainConfig { scale: 0.002, ..TrainConfig::default() };
    let config = Config { seed: 1, train, ..Config::default() }.scaled();
    let batch_size = config.train.batch_size;
    let mut trainer = Trainer::new(config, &scene, &device::flex())?;

    let mut in_turn = (0..scene.train.len()).cycle();
    while let Some(position) = trainer.begin_step()? {
        let views: Vec<usize> = in_turn.by_ref().take(batch_size).collect();
        trainer.show_views(&views)?;
        let rendered = trainer.render_batch(&views, &position)?;
        let losses = trainer.losses(&rendered, &position)?;
        let squared_error = losses.squared_error.clone();
        let rates = schedule(trainer.rates(&position), &position);
        trainer.learn(rendered, losses, &rates, &position)?;
        trainer.finish_step(&position)?;
        if position.ends_stage() {
            let error = squared_error.into_scalar::<f32>();
            println!("{:>11}: PSNR of the last batch {:.2} dB", position.stage.name(), -10.0 * error.log10());
        }
    }
    Ok(())
}
