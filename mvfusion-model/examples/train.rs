//! The plain loop: trains a model on a built-in scene and scores the held-out views.
//!
//! `cargo run -p mvfusion-model --example train`
#![allow(clippy::print_stdout, reason = "an example shows what it found")]

use mvfusion_data::BuiltinOptions;
use mvfusion_data::builtin::builtin;
use mvfusion_model::config::{Config, TrainConfig};
use mvfusion_model::evaluation::{Evaluator, Protocol, Split, evaluate};
use mvfusion_model::train::Trainer;
use mvfusion_model::{ModelError, device};

fn main() -> Result<(), ModelError> {
    // Eight cameras that film a room in which a block flies. `mvfusion_data::open` reads a folder instead.
    let scene = builtin(&BuiltinOptions { width: 64, height: 48, frames: 8, ..BuiltinOptions::default() });

    // The defaults are the paper's for Neu3D. This takes a five-hundredth of their steps, intervals and horizons.
    let train = TrainConfig { scale: 0.002, ..TrainConfig::default() };
    let config = Config { seed: 1, train, ..Config::default() }.scaled();

    let mut trainer = Trainer::new(config, &scene, &device::flex())?;
    while let Some(losses) = trainer.step()? {
        let done = trainer.state().completed;
        if done.is_multiple_of(25) {
            // Reading a number waits for the device, so this is not done in every step.
            println!("step {done:4}: loss {:.4}", losses.total.into_scalar::<f32>());
        }
    }

    // The model without autodiff, as deep in its stages as it was trained.
    let model = trainer.state().model.plain();
    let evaluator = Evaluator::without_lpips(Protocol::Mvfusion);
    let (level, context) = (trainer.final_level(), trainer.render_context());
    let ignore = |_, _: &_, _: &_| Ok::<_, ModelError>(());
    let scores = evaluate(&model, &scene, Split::Test, level, context, &evaluator, ignore)?.mean;
    let number = |value: Option<f64>| value.map_or("unknown".to_owned(), |value| format!("{value:.3}"));
    println!("held-out views: PSNR {} dB, SSIM {}", number(scores.composed.psnr), number(scores.composed.ssim));
    Ok(())
}
