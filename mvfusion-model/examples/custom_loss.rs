//! A loss term of your own: bounds how elongated the dynamic Gaussians become, as PhysGaussian does.
//!
//! `cargo run -p mvfusion-model --example custom_loss`
#![allow(clippy::print_stdout, reason = "an example shows what it found")]

use burn::tensor::Tensor;
use burn::tensor::activation::relu;
use mvfusion_data::BuiltinOptions;
use mvfusion_data::builtin::builtin;
use mvfusion_model::config::{Config, TrainConfig};
use mvfusion_model::model::gaussians::Gaussians;
use mvfusion_model::train::Trainer;
use mvfusion_model::{ModelError, device};

/// Weight of the term.
const WEIGHT: f64 = 5.0;

/// Ratio of the longest to the shortest axis that costs nothing.
const FREE_RATIO: f64 = 1.5;

/// Mean over the Gaussians of how far the logarithm of that ratio is above the free one: `[1]`.
fn elongation(gaussians: &Gaussians) -> Tensor<1> {
    let log_scales = gaussians.log_scales.val();
    let log_ratio = log_scales.clone().max_dim(1) - log_scales.min_dim(1);
    relu(log_ratio - FREE_RATIO.ln()).mean()
}

/// Trains with or without the term, and gives the elongation at the end.
fn train(weight: f64) -> Result<f32, ModelError> {
    let scene = builtin(&BuiltinOptions { width: 64, height: 48, frames: 8, ..BuiltinOptions::default() });
    let train = TrainConfig { scale: 0.002, ..TrainConfig::default() };
    let config = Config { seed: 1, train, ..Config::default() }.scaled();
    let mut trainer = Trainer::new(config, &scene, &device::flex())?;

    // `Trainer::step` makes the same calls; only the total is another here.
    while let Some(position) = trainer.begin_step()? {
        let views = trainer.draw_views();
        let rendered = trainer.render_batch(&views, &position)?;
        let mut losses = trainer.losses(&rendered, &position)?;
        losses.total = losses.total + elongation(&trainer.state().model.dynamic) * weight;
        let rates = trainer.rates(&position);
        trainer.learn(rendered, losses, &rates, &position)?;
        trainer.finish_step(&position)?;
    }
    Ok(elongation(&trainer.state().model.plain().dynamic).into_scalar::<f32>())
}

fn main() -> Result<(), ModelError> {
    let (without, with) = (train(0.0)?, train(WEIGHT)?);
    println!("elongation {without:.4} without the term, {with:.4} with it");
    assert!(with < without, "the term is there to lower it");
    Ok(())
}
