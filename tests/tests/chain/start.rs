//! Starts: a scene that cannot be trained is refused, and refinement begins as the base deformation.

use mvfusion_model::model::DeformationLevel;
use mvfusion_model::model::gaussians::RawGaussians;
use mvfusion_model::train::{Stage, Trainer};
use mvfusion_tests::{backends, numbers};

use crate::training::{config, scene};

/// Every number of the Gaussians, as bits.
fn bits(gaussians: RawGaussians) -> Vec<u64> {
    let masks = gaussians.mask_logits.expect("the dynamic branch has masks");
    let all = [
        numbers(gaussians.means),
        numbers(gaussians.sh),
        numbers(gaussians.opacity_logits),
        numbers(gaussians.log_scales),
        numbers(gaussians.quaternions),
        numbers(masks),
    ];
    all.concat().into_iter().map(f64::to_bits).collect()
}

#[test]
fn the_refined_model_starts_as_the_base_model() {
    let scene = scene();
    for backend in backends() {
        let mut trainer = Trainer::new(config(), &scene, &(backend.device)()).expect("the run can start");
        while trainer.position().is_some_and(|position| position.stage != Stage::Refinement) {
            trainer.step().expect("a step succeeds");
        }
        let model = &trainer.state().model;
        assert!(model.motion.is_some(), "motion is measured when the stage begins");
        // On frames, between them, and outside of them.
        for time in [0.0, 1.0 / 6.0, 0.4, 5.0 / 6.0, 0.99, -0.2, 1.3] {
            let at = |level| bits(model.dynamic_at(time, level, trainer.render_context()));
            let (base, refined) = (at(DeformationLevel::Base), at(DeformationLevel::Refined));
            assert_ne!(base, at(DeformationLevel::Still), "{}: the base model moves at {time}", backend.name);
            assert_eq!(base, refined, "{}: at {time}", backend.name);
        }
        trainer.step().expect("a step succeeds");
        trainer.step().expect("a step succeeds");
        let model = &trainer.state().model;
        let at = |level| bits(model.dynamic_at(0.4, level, trainer.render_context()));
        assert_ne!(at(DeformationLevel::Base), at(DeformationLevel::Refined), "{}: refinement learns", backend.name);
    }
}

#[test]
fn a_scene_of_one_still_camera_is_refused_before_the_first_step() {
    let mut scene = scene();
    let camera = scene.train[0].camera;
    scene.train.retain(|view| view.camera == camera);
    let backend = &backends()[0];
    let error = Trainer::new(config(), &scene, &(backend.device)()).expect_err("refused").to_string();
    assert!(error.contains("from one camera that stands still") && error.contains("one that moves"), "{error}");
}
