//! Steps whose loss is not finite: skipped, counted, told; and the same run, interrupted.

use burn::tensor::{Tensor, TensorData};
use mvfusion_model::config::{BadStepRule, Config, Interval};
use mvfusion_model::model::gaussians::Attribute;
use mvfusion_model::train::{BadSteps, MOST_BAD_STEPS, TrainState, Trainer};
use mvfusion_tests::{backends, numbers};

use crate::training::{config, hash, scene};

/// The logarithm of a size that overflows single precision, though it is a number itself.
const OVERFLOWING: f32 = 100.0;

/// A run that skips bad steps, in which the loss looks at sizes at every step, or only at every tenth (`loss.spiky`).
fn skipping(always: bool) -> Config {
    let mut config = config();
    config.train.on_bad_step = BadStepRule::Skip;
    config.loss.large = if always { 0.01 } else { 0.0 };
    // What is spoilt stays as it is.
    (config.densify.interval, config.densify.prune_interval) = (Interval(1000), Interval(1000));
    config
}

/// A trainer whose first Gaussian has such a size.
fn spoilt(config: &Config) -> Trainer {
    let device = (backends()[0].device)();
    let mut state = Trainer::new(config.clone(), &scene(), &device).expect("the run can start").state().clone();
    let sizes: Tensor<2> = state.model.dynamic.plain(Attribute::LogScales).expect("every branch has sizes");
    let row = Tensor::from_data(TensorData::new(vec![OVERFLOWING, 0.0, 0.0], [1, 3]), &sizes.device());
    let rest = sizes.clone().narrow(0, 1, sizes.dims()[0] - 1);
    state.model.dynamic.replace(Attribute::LogScales, Tensor::cat(vec![row, rest], 0));
    Trainer::with_state(config.clone(), &scene(), &device.autodiff(), state).expect("the run can go on")
}

/// Whether the next step is skipped, whether it changes a parameter, and the counts after it.
fn next(trainer: &mut Trainer) -> (bool, bool, BadSteps) {
    let before = hash(trainer);
    let loss = trainer.step().expect("a bad step is skipped").expect("the run goes on").total;
    (!numbers(loss)[0].is_finite(), hash(trainer) != before, trainer.state().bad_steps)
}

#[test]
fn a_step_that_is_not_finite_changes_nothing_and_is_counted() {
    let config = skipping(false);
    let mut trainer = spoilt(&config);
    let (mut skipped, mut learned) = (0, 0);
    for _ in 0..13 {
        let (is_bad, changes, counts) = next(&mut trainer);
        assert_eq!(changes, !is_bad, "after {skipped} skipped steps");
        (skipped, learned) = (skipped + usize::from(is_bad), learned + usize::from(!is_bad));
        assert_eq!((counts.total, counts.in_a_row > 0), (skipped, is_bad));
    }
    assert!(skipped > 0 && learned > 0, "{skipped} skipped, {learned} learned");

    // The counts are part of the state.
    let file = tempfile::tempdir().expect("folder");
    let path = file.path().join("half.safetensors");
    trainer.state().save(&path).expect("written");
    let device = (backends()[0].device)().autodiff();
    let state = TrainState::load(&path, &config, &device).expect("read");
    assert_eq!(state.bad_steps, trainer.state().bad_steps);
    let mut resumed = Trainer::with_state(config, &scene(), &device, state).expect("the run can go on");
    for _ in 0..9 {
        assert_eq!(next(&mut trainer), next(&mut resumed));
    }
    assert_eq!(hash(&trainer), hash(&resumed));
    assert!(trainer.state().bad_steps.total > skipped, "another step was skipped");
}

#[test]
fn training_ends_after_ten_such_steps_in_a_row_and_tells_the_tensor_the_step_and_the_views() {
    let mut trainer = spoilt(&skipping(true));
    let before = hash(&trainer);
    for _ in 1..MOST_BAD_STEPS {
        trainer.step().expect("a bad step is skipped");
    }
    let said = trainer.step().expect_err("one too many").to_string();
    assert_eq!((hash(&trainer), trainer.state().bad_steps.total), (before, MOST_BAD_STEPS));
    for part in ["10 steps in a row", "at step 10 (step 10 of stage geometry)", "the view `cam", "at time 0", "loss"] {
        assert!(said.contains(part), "`{part}` is missing: {said}");
    }
    let mut stopping = skipping(true);
    stopping.train.on_bad_step = BadStepRule::Stop;
    let said = spoilt(&stopping).step().expect_err("the default is to stop").to_string();
    assert!(said.contains("at step 1 (step 1 of stage geometry), which showed the view `cam"), "{said}");
}
