//! Pictures of a model that was trained for a few steps.

use mvfusion_data::{BuiltinOptions, builtin};
use mvfusion_model::config::{Config, GridConfig, ModelConfig, StageConfig, TrainConfig};
use mvfusion_model::train::Trainer;
use serde_json::{Value, json};

use super::super::frame::parts;
use super::super::protocol::tests::request;
use super::super::protocol::{Limits, Message};
use super::*;

/// A renderer of a model that passed through all stages.
fn renderer_of(source: MotionSource) -> FrameRenderer {
    let scene = builtin::builtin(&BuiltinOptions { width: 32, height: 24, frames: 3, ..Default::default() });
    let train = TrainConfig { stages: StageConfig::of([2, 2, 2]), ..TrainConfig::default() };
    let grid = GridConfig { features: 2, resolution: [4; 4], multipliers: vec![1], ..GridConfig::default() };
    let model = ModelConfig { width: 8, grid, ..ModelConfig::default() };
    let config = Config { train, model, ..Config::default() };
    let device = crate::device::open("cpu").expect("this build has a CPU device").device;
    let mut trainer = Trainer::new(config, &scene, &device).expect("a trainer");
    while trainer.step().expect("a step").is_some() {}
    let (level, step) = (trainer.final_level(), trainer.state().completed);
    let shown = Shown { model: trainer.state().model.plain(), level, step };
    let mut renderer = FrameRenderer::new(trainer.render_context().clone(), scene, source);
    renderer.show(step, || shown);
    renderer
}

fn measured() -> MotionSource {
    MotionSource::Measured(Config::default().motion.weights)
}

/// The facts of a picture and its JPEG, for a request with these changes.
fn rendered(renderer: &mut FrameRenderer, changes: &[(&str, Value)]) -> Result<(Value, Vec<u8>), String> {
    let mut message = request(1);
    message["size"] = json!([32, 24]);
    message["pose"] = Value::Null;
    message["view"] = json!({"set": "test", "index": 0});
    changes.iter().for_each(|(key, value)| message[key] = value.clone());
    let limits = Limits { pixels: 10_000, train: renderer.scene.train.len(), test: renderer.scene.test.len() };
    let Ok(Message::Frame(request)) = Message::parse(&message.to_string(), &limits) else { panic!("a request") };
    match renderer.answer(&request) {
        Answer::Refused { reason, .. } => Err(reason),
        Answer::Frame(bytes) => {
            let (facts, jpeg) = parts(&bytes).expect("a frame");
            Ok((facts, jpeg.to_vec()))
        }
    }
}

#[test]
#[cfg(feature = "flex")]
fn a_time_that_was_seen_needs_no_networks_and_gives_the_same_picture() {
    let mut renderer = renderer_of(measured());
    let with_mfta = [("mfta", json!(true))];
    let (_, first) = rendered(&mut renderer, &with_mfta).expect("a picture");
    assert!(renderer.moments.get(MomentKey::new(0.5, true)).is_some());
    assert!(renderer.moments.get(MomentKey::new(0.5, false)).is_none(), "without attention, it is another moment");
    // Without motion, a new moment would be another one.
    renderer.shown.as_mut().expect("a model").model.motion = None;
    let (_, again) = rendered(&mut renderer, &with_mfta).expect("a picture");
    assert!(first == again, "the picture is not that of the cached moment");
    renderer.moments.clear();
    let (_, new) = rendered(&mut renderer, &with_mfta).expect("a picture");
    assert!(first != new, "the networks have no effect, so nothing was tested");
}

#[test]
#[cfg(feature = "flex")]
fn only_what_the_photo_of_a_view_shows_is_compared_with_it() {
    let mut renderer = renderer_of(measured());
    let psnr = |facts: &Value| facts.get("psnr").and_then(Value::as_f64);
    let time = renderer.scene.test[0].time;
    let (facts, _) = rendered(&mut renderer, &[("time", json!(time))]).expect("a picture");
    assert!(psnr(&facts).is_some_and(|psnr| (3.0..60.0).contains(&psnr)), "{facts}");
    // An address keeps six digits.
    let (facts, _) = rendered(&mut renderer, &[("time", json!(time + 4e-7))]).expect("a picture");
    assert!(psnr(&facts).is_some(), "{facts}");
    for change in [("layer", json!("mask")), ("background", json!(0.75)), ("time", json!(time + 0.01))] {
        let (facts, _) = rendered(&mut renderer, &[("time", json!(time)), change]).expect("a picture");
        assert_eq!(psnr(&facts), None, "{facts}");
    }
}

#[test]
#[cfg(feature = "flex")]
fn every_layer_is_rendered_and_depth_and_motion_have_a_scale() {
    let mut renderer = renderer_of(measured());
    for layer in Layer::ALL {
        let (facts, _) = rendered(&mut renderer, &[("layer", json!(layer.name()))]).expect("a picture");
        assert_eq!(facts.get("scale").is_some(), layer.is_motion() || layer == Layer::Depth, "{layer}");
    }
    let Shown { model, level, .. } = renderer.shown.as_ref().expect("a model");
    assert_eq!(unavailable_layers(model, *level, measured()), []);
    let (facts, _) = rendered(&mut renderer, &[("time", Value::Null)]).expect("the static branch");
    assert_eq!(facts["gaussians"]["alive"].as_u64(), Some(0));
}

#[test]
#[cfg(feature = "flex")]
fn a_training_shows_what_it_has_measured_and_tells_what_it_has_not() {
    let mut renderer = renderer_of(MotionSource::Training);
    let Shown { model, level, .. } = renderer.shown.as_ref().expect("a model");
    let names: Vec<&str> =
        unavailable_layers(model, *level, renderer.source).into_iter().map(|(name, _)| name).collect();
    assert_eq!(names, ["position_variance", "rotation_variance", "scale_variance"]);
    rendered(&mut renderer, &[("layer", json!("motion"))]).expect("a picture");
    let error = rendered(&mut renderer, &[("layer", json!("scale_variance"))]).expect_err("refused");
    assert!(error.contains("scale_variance"), "{error}");
}

#[test]
#[cfg(feature = "flex")]
fn another_model_is_taken_only_if_its_step_is_another_one() {
    let mut renderer = renderer_of(MotionSource::Training);
    rendered(&mut renderer, &[]).expect("a picture");
    let (shown, key) = (renderer.shown.clone().expect("a model"), MomentKey::new(0.5, false));
    renderer.show(shown.step, || panic!("the model is the same"));
    assert!(renderer.moments.get(key).is_some());
    let next = Shown { step: shown.step + 1, ..shown.clone() };
    renderer.show(next.step, || next);
    assert!(renderer.moments.get(key).is_none(), "moments of the old model are forgotten");
    renderer.forget();
    assert!(rendered(&mut renderer, &[]).is_err_and(|error| error.contains("no model")));
}
