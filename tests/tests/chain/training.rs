//! A short run of all three stages on a small built-in scene: the same whatever the threads, and whether or not it was
//! interrupted.

use std::fmt::Write;

use burn::tensor::Device;
use mvfusion_data::builtin::builtin;
use mvfusion_data::{BuiltinOptions, Scene};
use mvfusion_model::ModelError;
use mvfusion_model::config::{
    BranchDensifyConfig, Config, DensifyConfig, GridBoundsRule, GridConfig, InitConfig, Interval, ModelConfig,
    MotionConfig, StageConfig, Steps, TrainConfig, Uncovered,
};
use mvfusion_model::evaluation::{Evaluation, Evaluator, Protocol, Split, evaluate};
use mvfusion_model::train::{TrainState, Trainer, parameter_hash};
use mvfusion_tests::{backends, numbers};

use crate::child;

/// A scene of few, small pictures.
pub fn scene() -> Scene {
    builtin(&BuiltinOptions { width: 48, height: 36, frames: 6, ..BuiltinOptions::default() })
}

/// A run of 32 steps with everything in it that changes rows.
pub fn config() -> Config {
    let defaults = DensifyConfig::default();
    let thresholds = |branch: &BranchDensifyConfig| {
        let mut branch = branch.clone();
        (branch.geometry_threshold, branch.threshold, branch.prune_above) = (3e-4, 3e-4, 20);
        branch
    };
    Config {
        seed: 5,
        init: InitConfig { dynamic_points: 400, dynamic_from_cloud: 20, ..InitConfig::default() },
        model: ModelConfig {
            width: 16,
            grid: GridConfig {
                features: 4,
                resolution: [8, 8, 8, 10],
                multipliers: vec![1, 2],
                ..GridConfig::default()
            },
            sh_degree: 2,
            ..ModelConfig::default()
        },
        motion: MotionConfig {
            interval: Interval(5),
            samples: 6,
            knot_stride: 2,
            window: 1,
            hidden: 16,
            attention_width: 16,
            heads: 2,
            chunk: 150,
            ..MotionConfig::default()
        },
        train: TrainConfig {
            stages: StageConfig::of([10, 10, 12]),
            dynamic_sh_interval: Interval(6),
            static_sh_interval: Interval(9),
            ..TrainConfig::default()
        },
        densify: DensifyConfig {
            from: Steps(2),
            until: Steps(100),
            interval: Interval(5),
            prune_from: Steps(2),
            prune_interval: Interval(6),
            // Above what a reset leaves, so that the next pruning finds something.
            min_opacity: 0.012,
            reset_interval: Interval(8),
            dynamic: thresholds(&defaults.dynamic),
            static_: thresholds(&defaults.static_),
            ..defaults
        },
        ..Config::default()
    }
}

/// Trains to the end.
pub fn train(trainer: &mut Trainer) {
    while trainer.step().expect("a step succeeds").is_some() {}
}

fn metrics(trainer: &Trainer, scene: &Scene) -> Evaluation {
    let model = trainer.state().model.plain();
    let nothing = |_, _: &_, _: &_| Ok::<(), ModelError>(());
    let evaluator = Evaluator::without_lpips(Protocol::Mvfusion);
    evaluate(&model, scene, Split::Test, trainer.final_level(), trainer.render_context(), &evaluator, nothing)
        .expect("the views can be scored")
}

/// SHA-256 of all parameters.
pub fn hash(trainer: &Trainer) -> String {
    parameter_hash(&trainer.state().model).expect("the device hands its numbers back")
}

/// Measurements of motion in the run of [`config`] (A2): at the end of the second stage, and after steps 5 and 10 of
/// the third.
pub const MEASUREMENTS: usize = 3;

/// Fails unless the run had in it what the tests are about.
fn assert_eventful(state: &TrainState) {
    let [dynamic, static_] = state.counts();
    for counts in [dynamic, static_] {
        assert!(counts.added > 0 && counts.resets > 0, "{:?}", state.counts());
    }
    assert!(dynamic.pruned + static_.pruned > 0, "{:?}", state.counts());
    assert_eq!(state.refreshes, MEASUREMENTS);
}

/// Runs once on every backend and tells all that must not depend on the number of threads.
fn account() -> String {
    let scene = scene();
    let mut account = String::new();
    for backend in backends() {
        let mut trainer = Trainer::new(config(), &scene, &(backend.device)()).expect("the run can start");
        train(&mut trainer);
        assert_eventful(trainer.state());
        let metrics = serde_json::to_string(&metrics(&trainer, &scene)).expect("metrics serialise");
        let counts = trainer.state().counts();
        writeln!(account, "{}: {} {counts:?} {metrics}", backend.name, hash(&trainer)).expect("a string takes it");
    }
    account
}

#[test]
fn a_run_is_the_same_with_one_thread_and_with_two() {
    if let Some(report) = child::report_path() {
        std::fs::write(report, account()).expect("the report can be written");
        return;
    }
    let with = |threads: &str| {
        let environment = [("RAYON_NUM_THREADS", threads), ("MATMUL_NUM_THREADS", threads)];
        child::run_alone("training::a_run_is_the_same_with_one_thread_and_with_two", &environment)
    };
    let alone = with("1");
    assert_eq!(alone, with("2"));
    assert_eq!(alone, with("3"));
}

/// A run that is saved, loaded and continued after each of `pauses` steps.
pub fn interrupted(config: &Config, pauses: &[usize], scene: &Scene, device: &Device) -> Trainer {
    let folder = tempfile::tempdir().expect("a temporary folder");
    let path = folder.path().join("state.safetensors");
    let mut trainer = Trainer::new(config.clone(), scene, device).expect("the run can start");
    for &pause in pauses {
        while trainer.state().completed < pause {
            trainer.step().expect("a step succeeds").expect("the run is not over");
        }
        trainer.state().save(&path).expect("the state can be saved");
        let device = device.clone().autodiff();
        let state = TrainState::load(&path, config, &device).expect("the state can be loaded");
        trainer = Trainer::with_state(config.clone(), scene, &device, state).expect("the run can go on");
    }
    train(&mut trainer);
    trainer
}

/// The same from Gaussians where motion was seen, with moments of their own.
fn with_lifetimes() -> Config {
    let mut config = config();
    (config.model.lifetime, config.model.grid.bounds, config.model.uncovered) =
        (true, GridBoundsRule::Motion, Uncovered::Static);
    config.init.motion_points = 200;
    (config.loss.dynamic_where_moving, config.loss.static_where_still) = (true, true);
    (config.loss.mask_motion, config.loss.mask_still, config.loss.static_opacity) = (0.1, 0.1, 0.1);
    (config.loss.still_opacity, config.train.lonely_visits) = (0.1, 0.5);
    (config.densify.births_interval, config.densify.births, config.densify.relocate) = (Interval(6), 20, 0.05);
    config
}

#[test]
fn a_run_that_was_saved_and_loaded_goes_on_as_if_it_had_not_been() {
    let scene = scene();
    for (backend, config) in backends().iter().flat_map(|backend| [(backend, config()), (backend, with_lifetimes())]) {
        let device = (backend.device)();
        let mut whole = Trainer::new(config.clone(), &scene, &device).expect("the run can start");
        train(&mut whole);
        // Within each stage, on its borders, and right after a densification, a pruning, a reset and a refresh.
        let resumed = interrupted(&config, &[3, 5, 8, 10, 16, 20, 25, 29], &scene, &device);
        assert_eq!(hash(&resumed), hash(&whole), "{}, lifetimes: {}", backend.name, config.model.lifetime);
        assert_eq!(resumed.state().counts(), whole.state().counts());
        let relocated: usize = whole.state().counts().iter().map(|counts| counts.relocated).sum();
        assert_eq!(relocated > 0, config.densify.relocate > 0.0, "{:?}", whole.state().counts());
        assert_eq!(resumed.state().streams, whole.state().streams);
        assert_eq!(resumed.state().normalisers, whole.state().normalisers);
    }
}

#[test]
fn views_that_go_through_the_networks_together_look_as_each_alone() {
    let scene = scene();
    for config in [config(), with_lifetimes()] {
        let mut trainer = Trainer::new(config, &scene, &(backends()[0].device)()).expect("the run can start");
        train(&mut trainer);
        let (model, level, context) = (trainer.state().model.plain(), trainer.final_level(), trainer.render_context());
        // The first and the last frame, whose neighbours end on one side, and one between.
        let mut views: Vec<_> = scene.train.iter().map(|view| (view.camera, view.time)).collect();
        views.sort_by(|a, b| a.1.total_cmp(&b.1));
        let views = [0, views.len() / 2, views.len() - 1].map(|index| views[index]);
        let together = model.render_all(&views, level, None, context).expect("rendered");
        for ((camera, time), together) in views.iter().zip(together) {
            let alone = model.render(camera, *time, level, None, context).expect("rendered");
            let (together, alone) = (numbers(together.dynamic.packed), numbers(alone.dynamic.packed));
            let apart = together.iter().zip(&alone).map(|(a, b)| (a - b).abs()).fold(0.0, f64::max);
            assert!(apart < 1e-5, "at {time}: {apart}");
        }
    }
}

#[test]
fn motion_is_measured_at_the_end_of_the_second_stage_and_then_at_every_interval() {
    /// Stages of a short run; the second ends with step 5, the third with step 12.
    const STAGES: [usize; 3] = [2, 3, 7];
    /// Intervals, and the steps of the run after which motion is measured (A2): the last of the second stage, and those
    /// of the third whose number within it is a multiple of the interval, but for its last, behind which no step would
    /// read the measurement.
    const MEASURED: [(usize, &[usize]); 5] =
        [(1, &[5, 6, 7, 8, 9, 10, 11]), (2, &[5, 7, 9, 11]), (3, &[5, 8, 11]), (7, &[5]), (100, &[5])];
    let scene = scene();
    for (interval, expected) in MEASURED {
        let mut config = config();
        config.motion.interval = Interval(interval);
        config.train.stages = StageConfig::of(STAGES);
        let mut trainer = Trainer::new(config, &scene, &(backends()[0].device)()).expect("the run can start");
        let mut measured = Vec::new();
        while trainer.step().expect("a step succeeds").is_some() {
            measured.resize(trainer.state().refreshes, trainer.state().completed);
        }
        assert_eq!(measured, expected, "interval {interval}");
    }
}

#[test]
fn training_lowers_the_error() {
    // Without resets, which throw a run of this length back.
    let mut config = config();
    config.densify.reset_interval = Interval(1000);
    let mut trainer = Trainer::new(config, &scene(), &(backends()[0].device)()).expect("the run can start");
    let mut errors = Vec::new();
    while let Some(loss) = trainer.step().expect("a step succeeds") {
        errors.push(numbers(loss.squared_error)[0]);
    }
    let mean = |errors: &[f64]| errors.iter().sum::<f64>() / errors.len() as f64;
    let (first, last) = (mean(&errors[..5]), mean(&errors[errors.len() - 5..]));
    assert!(last < 0.7 * first, "from {first} to {last}");
}
