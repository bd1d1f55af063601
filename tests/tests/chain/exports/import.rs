//! Training that starts from files of Gaussians.

use std::path::Path;

use burn::tensor::Device;
use mvfusion_model::ModelError;
use mvfusion_model::config::{Branches, Config};
use mvfusion_model::model::gaussians::{Attribute, Gaussians};
use mvfusion_model::model::{DeformationLevel, Model, RenderContext};
use mvfusion_model::train::{TrainedModel, Trainer};
use mvfusion_tests::{backends, every_backend, numbers};

use super::Run;
use crate::training::config;

/// What a picture may differ by after a way through files.
const PICTURE: f64 = 1e-4;

/// The configuration of a run that starts from the files of an export.
fn starting_from(run: &Run, export: &Path) -> Config {
    let mut config = run.config.clone();
    config.init.static_ply = Some(export.join("static.ply")).filter(|path| path.exists());
    config.init.dynamic_ply = Some(export.join("dynamic.ply"));
    config
}

/// Every number of the layers of a model, as the first held-out view shows them at a time.
fn layers(model: &Model, run: &Run, time: f64, level: DeformationLevel, context: &RenderContext) -> Vec<f64> {
    let view = &run.scene.test[0];
    let pictures = model.render(&view.camera, time, level, None, context).expect("rendered");
    let dynamic = pictures.dynamic.main();
    let mut values = numbers(dynamic.colour);
    values.extend(dynamic.features.map(numbers).into_iter().flatten());
    values.extend(pictures.static_.map(|picture| numbers(picture.main().colour)).into_iter().flatten());
    values
}

fn started(config: &Config, run: &Run, device: &Device) -> Trainer {
    Trainer::new(config.clone(), &run.scene, device).expect("the run can start")
}

#[test]
fn what_was_exported_looks_the_same_when_training_starts_from_it() {
    let mut one_branch = config();
    one_branch.model.branches = Branches::Dynamic;
    one_branch.loss.composed_dssim = 0.0;
    for config in [config(), one_branch] {
        let run = Run::new(config);
        for (time, level) in [(None, DeformationLevel::Still), (Some(0.4), DeformationLevel::Refined)] {
            let export = run.export(&format!("{level:?}"), |args| args.time = time);
            for backend in every_backend() {
                let device = (backend.device)();
                let before =
                    TrainedModel::load(&run.checkpoint(), &run.config, &device).expect("the checkpoint fits").model;
                let trainer = started(&starting_from(&run, &export), &run, &device);
                let after = trainer.state().model.plain();
                let wanted = layers(&before, &run, time.unwrap_or(0.0), level, trainer.render_context());
                // What was moved when it was written is not moved once more.
                let found = layers(&after, &run, 0.0, DeformationLevel::Still, trainer.render_context());
                assert!(wanted.iter().any(|&value| value > 0.1), "there is something to see");
                let off = found.iter().zip(&wanted).map(|(a, b)| (a - b).abs()).max_by(f64::total_cmp);
                let off = off.expect("pixels");
                assert!(found.len() == wanted.len() && off < PICTURE, "{}, {level:?}: off by {off}", backend.name);
            }
        }
    }
}

#[test]
fn training_goes_on_from_imported_gaussians() {
    let run = Run::new(config());
    let export = run.export("gaussians", |_| {});
    let mut trainer = started(&starting_from(&run, &export), &run, &(backends()[0].device)());
    let first = trainer.step().expect("a step succeeds").expect("the run is not over");
    assert!(numbers(first.total)[0].is_finite());
    crate::training::train(&mut trainer);
    assert_eq!(trainer.state().completed, 32);
}

#[test]
fn colours_are_cut_or_filled_up_to_the_degree_of_the_configuration() {
    let run = Run::new(config());
    let export = run.export("gaussians", |_| {});
    let device = (backends()[0].device)();
    let rest = |trainer: &Trainer| {
        let branch = trainer.state().model.static_.clone().expect("a static branch");
        let values = branch.plain(Attribute::ShRest).expect("colours");
        (values.dims()[1], branch.sh_degree, numbers(values))
    };
    let own = rest(&run.trainer).2;
    // In use is what the file has, as far as there is room.
    for (degree, width, in_use) in [(0, 0, 0), (1, 9, 1), (3, 45, 2)] {
        let mut config = starting_from(&run, &export);
        config.model.sh_degree = degree;
        let (found_width, found_degree, values) = rest(&started(&config, &run, &device));
        assert_eq!((found_width, found_degree), (width, in_use));
        for (row, own) in own.chunks(24).enumerate() {
            let filled = own.iter().copied().chain(std::iter::repeat(0.0));
            assert!(values[row * width..(row + 1) * width].iter().copied().eq(filled.take(width)));
        }
    }
}

#[test]
fn a_file_may_start_one_branch_alone_and_masks_are_made_up_where_it_has_none() {
    let run = Run::new(config());
    let export = run.export("gaussians", |_| {});
    let device = (backends()[0].device)();
    let mut config = run.config.clone();
    config.init.dynamic_logit = 0.75;
    // The static branch's file, which has no masks, for the dynamic one.
    config.init.dynamic_ply = Some(export.join("static.ply"));
    let trainer = started(&config, &run, &device);
    let plain = started(&run.config, &run, &device);
    let means = |trainer: &Trainer| {
        let model = &trainer.state().model;
        let of = |gaussians: &Gaussians| numbers(gaussians.means.val());
        (of(&model.dynamic), of(model.static_.as_ref().expect("a static branch")))
    };
    assert_eq!(means(&trainer).1, means(&plain).1, "the static branch is drawn as without the file");
    assert_eq!(means(&trainer).0, means(&run.trainer).1);
    let masks = trainer.state().model.dynamic.plain(Attribute::MaskLogits).expect("masks");
    assert_eq!(numbers(masks)[..6], [0.0, 0.0, 0.75, 0.0, 0.0, 0.75]);
}

/// What is said of a configuration with which no run can start.
fn refusal(run: &Run, config: &Config) -> ModelError {
    Trainer::new(config.clone(), &run.scene, &(backends()[0].device)()).expect_err("refused")
}

#[test]
fn files_that_do_not_fit_the_configuration_are_refused_with_the_key() {
    let run = Run::new(config());
    let export = run.export("gaussians", |_| {});
    let config = starting_from(&run, &export);

    let mut few = config.clone();
    few.densify.static_.max_gaussians = 3;
    let said = refusal(&run, &few);
    assert!(matches!(&said, ModelError::Config { key, .. } if key == "init.static_ply"), "{said}");
    assert!(said.to_string().contains("`densify.static.max_gaussians`"), "{said}");

    let mut one_branch = config.clone();
    one_branch.model.branches = Branches::Dynamic;
    let said = refusal(&run, &one_branch);
    assert!(said.to_string().contains("`init.dynamic_ply`"), "{said}");

    let mut missing = config;
    missing.init.dynamic_ply = Some(export.join("no.ply"));
    assert!(refusal(&run, &missing).to_string().contains("no.ply"));
    // Points are no Gaussians.
    missing.init.dynamic_ply = Some(run.place.path().join("scene/points3D.ply"));
    assert!(refusal(&run, &missing).to_string().contains("`f_dc_0`"));
}
