//! Training on a scene of one moment, whose masks leave some views nothing: no number is lost.

use std::sync::Arc;

use anyhow::{Result, ensure};
use image::{Rgb, RgbImage};
use libtest_mimic::Trial;
use mvfusion_data::builtin::builtin;
use mvfusion_data::{BuiltinOptions, Mask, Picture, Scene};
use mvfusion_model::config::{Branches, StageConfig};
use mvfusion_model::train::Trainer;
use mvfusion_tests::{Backend, backends, numbers};

use super::trial;
use crate::training::config;

/// Steps of the three stages.
const STAGES: [usize; 3] = [3, 3, 4];

/// On CPU backends; the losses and ops of such a step are tried on every backend ([`super::cases`]).
pub fn trials(backend: Backend) -> Vec<Trial> {
    if backends().iter().all(|cpu| cpu.name != backend.name) {
        return Vec::new();
    }
    vec![trial(backend, "training", move || trains(backend))]
}

/// One moment. The first view has no valid pixel, the second one.
fn scene() -> Scene {
    let mut scene = builtin(&BuiltinOptions { width: 40, height: 30, frames: 1, ..BuiltinOptions::default() });
    let nothing = RgbImage::new(40, 30);
    let mut one = nothing.clone();
    one.put_pixel(17, 11, Rgb([255; 3]));
    for (view, mask) in scene.train.iter_mut().zip([nothing, one]) {
        view.mask = Some(Mask { picture: Picture::Memory(Arc::new(mask)), inverted: false });
    }
    scene
}

fn trains(backend: Backend) -> Result<()> {
    let mut config = config(Branches::Both, StageConfig::of(STAGES));
    config.model.grid.resolution[3] = 2;
    config.train.batch_size = 2;
    let mut trainer = Trainer::new(config, &scene(), &(backend.device)())?;
    while let Some(loss) = trainer.step()? {
        let values = [numbers(loss.total)[0], numbers(loss.squared_error)[0]];
        ensure!(values.iter().all(|value| value.is_finite()), "{values:?} at {:?}", trainer.position());
    }
    let model = &trainer.state().model;
    ensure!(model.motion.is_some(), "motion was not measured");
    let level = trainer.final_level();
    for time in [0.0, 0.5] {
        let seen = model.dynamic_at(time, level, trainer.render_context());
        let parts = [numbers(seen.means), numbers(seen.log_scales), numbers(seen.opacity_logits), numbers(seen.sh)];
        ensure!(parts.iter().flatten().all(|number| number.is_finite()), "a Gaussian at {time} is no number");
    }
    Ok(())
}
