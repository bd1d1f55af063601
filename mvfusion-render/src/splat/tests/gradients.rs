//! Gradients against finite differences, and the statistic.

use super::*;
use crate::test_support::{for_each_device, numbers};

/// Step of the central differences.
const STEP: f64 = 1e-6;
/// Truncation and cancellation error of differences with that step, relative to the largest gradient of the family.
const TOLERANCE: f64 = 2e-6;

/// A scene away from all thresholds except visibility, whose jumps (alpha at 1/255) are tiny for the few pixels that
/// may cross it. It is so small that differences of every value are affordable.
fn small_scene(seed: u64) -> Scene {
    Scene::random(seed, 6)
}

/// Smooth weights of the pixels. They differ for each copy and channel, so that no symmetry hides an error.
fn weights(device: &Device, dtype: DType, shape: [usize; 4]) -> Tensor<4> {
    let count: usize = shape.iter().product();
    let values: Vec<f64> = (0..count).map(|i| (0.37 * i as f64).sin() + 0.2 * (0.011 * i as f64).cos()).collect();
    tensor(&values, shape, device, dtype)
}

fn loss(picture: &SplatPicture) -> Tensor<1> {
    let weights = weights(&picture.packed.device(), picture.packed.dtype(), picture.packed.dims());
    (picture.packed.clone() * weights).sum()
}

/// The image and all gradients of a weighted sum of it, as values.
pub(super) fn all_numbers(scene: &Scene, device: &Device, dtype: DType) -> Vec<Vec<f64>> {
    let inputs = tracked(scene.inputs(device, dtype));
    let probe = Tensor::<2>::zeros([1, 2], (device, dtype)).require_grad();
    let settings = settings(SplatRules::inria());
    let picture = splat(inputs.clone(), Some(probe.clone()), &camera(), &settings).expect("shapes fit");
    let packed = numbers(picture.packed.clone().detach());
    let gradients = loss(&picture).backward();
    let of = |name: &str, found: Option<Vec<f64>>| found.unwrap_or_else(|| panic!("`{name}` has a gradient"));
    vec![
        packed,
        of("means", inputs.means.grad(&gradients).map(numbers)),
        of("quaternions", inputs.quaternions.grad(&gradients).map(numbers)),
        of("log_scales", inputs.log_scales.grad(&gradients).map(numbers)),
        of("opacity_logits", inputs.opacity_logits.grad(&gradients).map(numbers)),
        of("sh", inputs.sh.grad(&gradients).map(numbers)),
        of("features", inputs.features.and_then(|f| f.grad(&gradients)).map(numbers)),
        of("background", inputs.background.grad(&gradients).map(numbers)),
        of("probe", probe.grad(&gradients).map(numbers)),
    ]
}

fn tracked(inputs: SplatInputs) -> SplatInputs {
    SplatInputs {
        means: inputs.means.require_grad(),
        quaternions: inputs.quaternions.require_grad(),
        log_scales: inputs.log_scales.require_grad(),
        opacity_logits: inputs.opacity_logits.require_grad(),
        sh: inputs.sh.require_grad(),
        features: inputs.features.map(|f| f.require_grad()),
        background: inputs.background.require_grad(),
    }
}

/// One family of parameters: its name and its values.
type Family = (&'static str, fn(&mut Scene) -> &mut Vec<f64>);

const FAMILIES: [Family; 7] = [
    ("means", |scene| &mut scene.means),
    ("quaternions", |scene| &mut scene.quaternions),
    ("log_scales", |scene| &mut scene.log_scales),
    ("opacity_logits", |scene| &mut scene.opacity_logits),
    ("sh", |scene| &mut scene.sh),
    ("features", |scene| &mut scene.features),
    ("background", |scene| &mut scene.background),
];

fn differences(scene: &Scene, device: &Device, settings: &SplatSettings, family: Family) -> Vec<f64> {
    let value = |index: usize, step: f64| {
        let mut moved = scene.clone();
        (family.1)(&mut moved)[index] += step;
        let picture = splat(moved.inputs(device, DType::F64), None, &camera(), settings).expect("shapes fit");
        numbers(loss(&picture))[0]
    };
    let count = (family.1)(&mut scene.clone()).len();
    (0..count).map(|i| (value(i, STEP) - value(i, -STEP)) / (2.0 * STEP)).collect()
}

fn assert_close(name: &str, found: &[f64], expected: &[f64]) {
    let scale = expected.iter().fold(0.0f64, |m, x| m.max(x.abs()));
    assert!(scale > 0.0, "the test says nothing about `{name}`");
    for (i, (a, b)) in found.iter().zip(expected).enumerate() {
        assert!((a - b).abs() <= TOLERANCE * scale, "`{name}` {i}: {a} is not {b}, largest {scale}");
    }
    assert_eq!(found.len(), expected.len());
}

#[test]
fn gradients_are_the_differences_of_the_picture() {
    for_each_device(|device| {
        for (seed, rules) in rule_sets().into_iter().enumerate() {
            // No visible jumps: below this opacity, alpha stays under the clamp and nothing crosses 1/255.
            let scene = small_scene(20 + seed as u64);
            let (tracking, settings) = (device.clone().autodiff(), settings(rules));
            let inputs = tracked(scene.inputs(&tracking, DType::F64));
            let picture = splat(inputs.clone(), None, &camera(), &settings).expect("shapes fit");
            let gradients = loss(&picture).backward();
            let found = [
                inputs.means.grad(&gradients).map(numbers),
                inputs.quaternions.grad(&gradients).map(numbers),
                inputs.log_scales.grad(&gradients).map(numbers),
                inputs.opacity_logits.grad(&gradients).map(numbers),
                inputs.sh.grad(&gradients).map(numbers),
                inputs.features.and_then(|f| f.grad(&gradients)).map(numbers),
                inputs.background.grad(&gradients).map(numbers),
            ];
            for (family, found) in FAMILIES.into_iter().zip(found) {
                let expected = differences(&scene, &device, &settings, family);
                assert_close(family.0, &found.expect("it is tracked"), &expected);
            }
        }
    });
}

/// Gradient of the probe for a loss on the image.
fn statistic(
    scene: &Scene,
    device: &Device,
    settings: &SplatSettings,
    loss: impl Fn(&SplatPicture) -> Tensor<1>,
) -> Vec<f64> {
    let device = device.clone().autodiff();
    let probe = Tensor::<2>::zeros([1, 2], (&device, DType::F64)).require_grad();
    let picture =
        splat(scene.inputs(&device, DType::F64), Some(probe.clone()), &camera(), settings).expect("shapes fit");
    numbers(probe.grad(&loss(&picture).backward()).expect("the probe has a gradient"))
}

fn weighted<const D: usize>(layer: Tensor<D>) -> Tensor<1> {
    let [channels, height, width] = [layer.dims()[0], layer.dims()[1], layer.dims()[2]];
    let weights = weights(&layer.device(), layer.dtype(), [1, channels, height, width]);
    (layer.reshape([1, channels, height, width]) * weights).sum()
}

#[test]
fn the_statistic_sums_to_the_gradient_of_the_principal_point() {
    for_each_device(|device| {
        let (scene, settings) = (small_scene(31), settings(SplatRules::inria()));
        let found = statistic(&scene, &device, &settings, |picture| weighted(picture.main().colour));
        let value = |step: f64, axis: usize| {
            let mut moved = camera();
            *[&mut moved.cx, &mut moved.cy][axis] += step;
            let picture = splat(scene.inputs(&device, DType::F64), None, &moved, &settings).expect("shapes fit");
            numbers(weighted(picture.main().colour))[0]
        };
        let half_size = [camera().width as f64 / 2.0, camera().height as f64 / 2.0];
        let sums = [0, 1].map(|axis| found.iter().skip(axis).step_by(2).sum::<f64>() / half_size[axis]);
        let expected = [0, 1].map(|axis| (value(STEP, axis) - value(-STEP, axis)) / (2.0 * STEP));
        assert_close("statistic", &sums, &expected);
    });
}

#[test]
fn the_statistic_counts_the_main_picture_and_no_other() {
    for_each_device(|device| {
        let (scene, settings) = (small_scene(32), settings(SplatRules::inria()));
        let main = statistic(&scene, &device, &settings, |p| weighted(p.main().colour) + weighted(p.main().depth));
        let both = statistic(&scene, &device, &settings, |p| {
            weighted(p.main().colour) + weighted(p.main().depth) + weighted(p.light().colour) * 3.0
        });
        assert_close("statistic", &both, &main);
        let light = statistic(&scene, &device, &settings, |p| weighted(p.light().colour));
        assert!(light.iter().all(|&x| x == 0.0));
    });
}

#[test]
fn the_statistic_counts_features_only_if_told_to() {
    for_each_device(|device| {
        let scene = small_scene(33);
        let features = |picture: &SplatPicture| weighted(picture.main().features.expect("there are features"));
        let mut settings = settings(SplatRules::inria());
        assert!(statistic(&scene, &device, &settings, features).iter().all(|&x| x == 0.0));
        settings.statistic = Statistic::AllChannels;
        assert!(statistic(&scene, &device, &settings, features).iter().any(|&x| x != 0.0));
    });
}

#[test]
fn uses_of_one_probe_add_up() {
    for_each_device(|device| {
        let (scene, settings) = (small_scene(34), settings(SplatRules::inria()));
        let once = statistic(&scene, &device, &settings, |p| weighted(p.main().colour));
        let device = device.autodiff();
        let probe = Tensor::<2>::zeros([1, 2], (&device, DType::F64)).require_grad();
        let render = || {
            let inputs = scene.inputs(&device, DType::F64);
            weighted(splat(inputs, Some(probe.clone()), &camera(), &settings).expect("shapes fit").main().colour)
        };
        let gradients = (render() + render() * 2.0).backward();
        let twice = numbers(probe.grad(&gradients).expect("the probe has a gradient"));
        assert_close("probe", &twice, &once.iter().map(|x| 3.0 * x).collect::<Vec<_>>());
    });
}

#[test]
fn a_held_alpha_passes_its_gradient_only_in_the_inria_rules() {
    for_each_device(|device| {
        let mut scene = small_scene(35);
        scene.count = 1;
        scene.means = vec![0.0, 0.0, 3.0];
        scene.quaternions.truncate(4);
        // Hundreds of pixels wide, so that alpha is clamped everywhere.
        scene.log_scales = vec![4.0; 3];
        scene.opacity_logits = vec![9.0];
        scene.sh.truncate(3 * SH_ROWS);
        scene.features.truncate(FEATURES);
        let gradient = |rules| {
            let tracking = device.clone().autodiff();
            let inputs = tracked(scene.inputs(&tracking, DType::F64));
            let picture = splat(inputs.clone(), None, &camera(), &settings(rules)).expect("shapes fit");
            let gradients = picture.main().alpha.sum().backward();
            numbers(inputs.opacity_logits.grad(&gradients).expect("it is tracked"))[0]
        };
        assert!(gradient(SplatRules::inria()) > 0.0);
        assert_eq!(gradient(SplatRules::gsplat()), 0.0);
    });
}
