//! Runs of other shapes than the default: one branch, accumulated gradients, still Gaussians sorted out; and runs that break.

use burn::tensor::Tensor;
use glam::{DVec2, DVec3};
use mvfusion_data::builtin::builtin;
use mvfusion_data::{BuiltinKind, BuiltinOptions, Scene};
use mvfusion_model::ModelError;
use mvfusion_model::config::{Branches, Config, Interval, StageConfig, Steps, StillRule};
use mvfusion_model::evaluation::{Evaluator, Protocol, Split, evaluate};
use mvfusion_model::model::DeformationLevel;
use mvfusion_model::model::gaussians::{Attribute, Gaussians};
use mvfusion_model::train::{TrainState, Trainer};
use mvfusion_tests::{backends, numbers};

use crate::training::{MEASUREMENTS, config, hash, interrupted, scene, train};

/// 4DGS with motion-aware refinement plugged in.
fn one_branch() -> Config {
    let mut config = config();
    config.model.branches = Branches::Dynamic;
    config.loss.composed_dssim = 0.0;
    (config.densify.max_radius, config.densify.max_scale) = (20.0, 0.1);
    config
}

fn started(config: &Config) -> Trainer {
    Trainer::new(config.clone(), &scene(), &(backends()[0].device)()).expect("the run can start")
}

#[test]
fn one_branch_trains_refines_and_is_scored_without_a_static_picture() {
    let mut config = one_branch();
    // Without resets, which throw a run of this length back.
    config.densify.reset_interval = Interval(1000);
    let mut trainer = started(&config);
    let mut errors = Vec::new();
    while let Some(loss) = trainer.step().expect("a step succeeds") {
        errors.push(numbers(loss.squared_error)[0]);
    }
    let mean = |errors: &[f64]| errors.iter().sum::<f64>() / errors.len() as f64;
    assert!(mean(&errors[27..]) < mean(&errors[..5]), "{errors:?}");
    let state = trainer.state();
    assert!(state.model.static_.is_none() && state.model.network.masks.is_none());
    assert!(state.counts()[0].added > 0, "{:?}", state.counts());
    assert_eq!(state.refreshes, MEASUREMENTS);

    let nothing = |_, _: &_, _: &_| Ok::<(), ModelError>(());
    let model = state.model.plain();
    let (level, context) = (trainer.final_level(), trainer.render_context());
    let evaluator = Evaluator::without_lpips(Protocol::Mvfusion);
    let metrics =
        evaluate(&model, &scene(), Split::Test, level, context, &evaluator, nothing).expect("the views can be scored");
    assert!(metrics.mean.composed.psnr.is_some() && metrics.mean.dynamic_region.is_some());
    assert!(metrics.mean.static_.is_none() && metrics.mean.mask_iou.is_none());
}

#[test]
fn plugged_in_refinement_starts_as_the_identity() {
    let mut trainer = started(&one_branch());
    while trainer.state().completed < 20 {
        trainer.step().expect("a step succeeds").expect("the run is not over");
    }
    let model = trainer.state().model.plain();
    let at = |level| numbers(model.dynamic_at(0.4, level, trainer.render_context()).means);
    assert!(model.motion.is_some());
    assert_eq!(at(DeformationLevel::Base), at(DeformationLevel::Refined));
    assert_ne!(at(DeformationLevel::Base), at(DeformationLevel::Still));
}

#[test]
fn runs_of_other_shapes_survive_saving_and_loading() {
    let mut accumulating = config();
    (accumulating.train.accumulation, accumulating.model.exposure) = (4, true);
    for config in [one_branch(), accumulating] {
        let mut whole = started(&config);
        train(&mut whole);
        assert!(whole.state().counts().iter().any(|counts| counts.pruned > 0), "{:?}", whole.state().counts());
        // 11 and 22 lie between two steps of an accumulating static branch.
        let device = (backends()[0].device)();
        let resumed = interrupted(&config, &[3, 11, 20, 22, 29], &scene(), &device);
        assert_eq!(hash(&resumed), hash(&whole), "{:?}", config.model.branches);
    }
}

#[test]
fn under_accumulation_the_static_branch_moves_at_every_fourth_step_and_the_dynamic_one_at_each() {
    let mut config = config();
    config.train.accumulation = 4;
    config.densify.until = Steps(0);
    let mut trainer = started(&config);
    let positions = |trainer: &Trainer| {
        let model = &trainer.state().model;
        let of = |gaussians: &Gaussians| gaussians.plain(Attribute::Means).map(numbers);
        (of(&model.dynamic), model.static_.as_ref().and_then(of))
    };
    // The first stage does not accumulate.
    for _ in 0..10 {
        let before = positions(&trainer);
        trainer.step().expect("a step succeeds");
        assert_ne!(before.1, positions(&trainer).1);
    }
    for step in 1..=8 {
        let before = positions(&trainer);
        trainer.step().expect("a step succeeds");
        let after = positions(&trainer);
        assert_ne!(before.0, after.0, "step {step}");
        assert_eq!(before.1 != after.1, step % 4 == 0, "step {step}");
        assert_eq!(
            trainer.state().static_.as_ref().is_some_and(|state| state.pending.is_some()),
            step % 4 != 0,
            "step {step}"
        );
    }
}

#[test]
fn still_gaussians_move_to_the_static_branch_or_go() {
    for rule in [StillRule::Prune, StillRule::Reassign] {
        let mut config = config();
        (config.motion.still, config.motion.still_below) = (rule, 0.5);
        // Nothing else changes rows.
        (config.densify.interval, config.densify.prune_interval) = (Interval(1000), Interval(1000));
        let mut trainer = started(&config);
        let counts = |trainer: &Trainer| {
            let model = &trainer.state().model;
            let static_ = model.static_.as_ref().map_or(0, |branch| branch.count());
            (model.dynamic.count(), static_)
        };
        let before = counts(&trainer);
        train(&mut trainer);
        let after = counts(&trainer);
        let gone = before.0 - after.0;
        assert!(gone > 0 && after.0 > 0, "{rule:?}: {before:?} to {after:?}");
        assert_eq!(after.1 - before.1, if rule == StillRule::Reassign { gone } else { 0 }, "{rule:?}");
        let cache = trainer.state().model.motion.as_ref().expect("motion was measured");
        assert_eq!(cache.intensity.dims()[0], after.0);
    }
}

/// What a run says that is started with one number of the given attribute spoilt.
fn complaint(attribute: Attribute, value: f64) -> String {
    let device = (backends()[0].device)();
    let mut state: TrainState = started(&config()).state().clone();
    let values: Tensor<2> = state.model.dynamic.plain(attribute).expect("the dynamic branch has it");
    let spoilt = values.clone().narrow(0, 0, 1) * value;
    let rest = values.clone().narrow(0, 1, values.dims()[0] - 1);
    state.model.dynamic.replace(attribute, Tensor::cat(vec![spoilt, rest], 0));
    let mut config = config();
    config.train.log_interval = 1;
    let mut trainer = Trainer::with_state(config, &scene(), &device.autodiff(), state).expect("the run can go on");
    trainer.step().expect_err("a spoilt run stops").to_string()
}

#[test]
fn a_run_stops_at_the_first_number_that_is_not_finite_and_names_it() {
    for (attribute, value) in
        [(Attribute::ShDc, f64::NAN), (Attribute::Means, f64::NAN), (Attribute::LogScales, f64::INFINITY)]
    {
        let said = complaint(attribute, value);
        assert!(said.contains(&format!("parameter dynamic.{attribute}")), "{said}");
        assert!(said.contains("step 1 of stage geometry"), "{said}");
    }
}

/// A film in which each moment was seen by one camera alone.
fn by_one_camera_at_a_time() -> Scene {
    let mut scene = scene();
    let moments = scene.training_times();
    let cameras = scene.train.len() / moments.len();
    let turn = |index: usize| index / moments.len() == (index % moments.len()) % cameras;
    let kept = scene.train.drain(..).enumerate().filter(|&(index, _)| turn(index)).map(|(_, view)| view).collect();
    Scene { train: kept, ..scene }
}

#[test]
fn gaussians_are_born_where_a_film_is_wrong() {
    for (film, least_share) in [(scene(), 0.9), (by_one_camera_at_a_time(), 0.0)] {
        let mut config = config();
        config.model.lifetime = true;
        // One round, after the last step, and nothing else that changes rows.
        config.train.stages = StageConfig::of([10, 10, 2]);
        (config.densify.interval, config.densify.prune_interval) = (Interval(1000), Interval(1000));
        (config.densify.births_interval, config.densify.births) = (Interval(12), 60);
        let device = (backends()[0].device)();
        let mut trainer = Trainer::new(config, &film, &device).expect("the run can start");
        let before = trainer.state().model.dynamic.count();
        train(&mut trainer);
        let model = trainer.state().model.plain();
        let born = model.dynamic.count() - before;
        assert!((1..=60).contains(&born) && trainer.state().counts()[0].added == born, "{born}");
        let cache = model.motion.as_ref().expect("motion was measured");
        assert_eq!(cache.intensity.dims()[0], before + born);

        // The network, as far as it has learned, leaves them on what moves at their moment.
        let moments = numbers(model.dynamic.plain(Attribute::TimeCentres).expect("it has lifetimes"));
        let (mut seen, mut right) = (0usize, 0usize);
        for (row, &moment) in moments.iter().enumerate().skip(before) {
            let means = numbers(model.dynamic_at(moment, trainer.final_level(), trainer.render_context()).means);
            let place = DVec3::from_slice(&means[3 * row..]);
            for view in film.train.iter().filter(|view| (view.time - moment).abs() < 1e-6) {
                let mask = view.truth.dynamic_mask.as_ref().expect("a built-in scene").mask().expect("in memory");
                let position = view.camera.project(place).unwrap_or(DVec2::MAX);
                let pixel = mask.get_pixel_checked(position.x as u32, position.y as u32);
                seen += usize::from(pixel.is_some());
                right += usize::from(pixel.is_some_and(|pixel| pixel.0[0] > 0));
            }
        }
        assert!(seen >= born && right as f64 >= least_share * seen as f64, "{right} of {seen}");
    }
}

#[test]
fn births_in_photos_compare_them_with_opacities_that_were_not_just_reset() {
    let photos = BuiltinOptions { width: 48, height: 36, photos: 6, ..BuiltinOptions::of_kind(BuiltinKind::Casual) };
    let photos = builtin(&photos);
    let faintest = |births: usize| {
        let mut config = config();
        (config.model.lifetime, config.init.photo_points) = (true, births);
        (config.train.stages, config.densify.reset_interval) = (StageConfig::of([8, 2, 2]), Interval(8));
        let mut trainer = Trainer::new(config, &photos, &(backends()[0].device)()).expect("the run can start");
        (0..8).for_each(|_| _ = trainer.step().expect("a step succeeds"));
        let static_ = trainer.state().model.plain().static_.expect("it has two branches");
        let logits = numbers(static_.plain(Attribute::OpacityLogits).expect("every Gaussian has one"));
        logits.into_iter().fold(f64::INFINITY, f64::min)
    };
    // A reset leaves logits of -4.6 and less.
    assert!(faintest(0) < -4.0 && faintest(20) > -4.0);
}
