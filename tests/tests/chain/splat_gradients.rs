//! The splat op against finite differences: every input, under both sets of rules.

use burn::tensor::{DType, Device, Tensor};
use glam::{DMat3, DVec3};
use mvfusion_data::Camera;
use mvfusion_model::random::Stream;
use mvfusion_render::splat::{SplatInputs, SplatRules, SplatSettings, splat};
use mvfusion_tests::{Array, backends, gradient, numbers, tensor};

use crate::differences::{Values, compare};
use crate::margins::keep_off_thresholds;

/// Gaussians of the scene.
const COUNT: usize = 70;

/// The last ones lie behind the camera: no light, no gradient.
const BEHIND: usize = 3;

/// Further channels of each Gaussian.
const FEATURES: usize = 3;

/// A small camera that looks along a skew direction.
pub fn camera() -> Camera {
    let turn = DMat3::from_axis_angle(DVec3::new(0.3, -0.8, 0.2).normalize(), 0.4);
    let camera = Camera::centred(40, 28, 33.0, turn, DVec3::new(0.4, -0.3, -0.6));
    // Pixels that are not square, a principal point off the middle.
    Camera { fy: 36.0, cx: 18.7, cy: 14.9, ..camera }
}

/// A point that falls into the picture or a little outside, at a depth.
pub fn point_before(camera: &Camera, depth: f64, stream: &mut Stream) -> DVec3 {
    let side = |pixels: usize, focal: f64, stream: &mut Stream| {
        0.55 * pixels as f64 / focal * stream.uniform(-1.0, 1.0) * depth
    };
    let x = side(camera.width, camera.fx, stream);
    let y = side(camera.height, camera.fy, stream);
    camera.rotation.transpose() * (DVec3::new(x, y, depth) - camera.translation)
}

/// `count` numbers from a function of a random stream.
pub fn draw(count: usize, stream: &mut Stream, mut number: impl FnMut(&mut Stream) -> f64) -> Vec<f64> {
    (0..count).map(|_| number(stream)).collect()
}

fn scene(camera: &Camera, settings: &SplatSettings) -> Values {
    let stream = &mut Stream::new(11, 0);
    let depth = |row: usize, stream: &mut Stream| if row < COUNT - BEHIND { stream.uniform(1.5, 5.0) } else { -1.0 };
    let means = (0..COUNT)
        .flat_map(|row| {
            let depth = depth(row, stream);
            point_before(camera, depth, stream).to_array()
        })
        .collect();
    let mut values = Values::from([
        ("means".into(), Array::new([COUNT, 3], means)),
        ("quaternions".into(), Array::new([COUNT, 4], draw(COUNT * 4, stream, Stream::normal))),
        ("log_scales".into(), Array::new([COUNT, 3], draw(COUNT * 3, stream, |s| s.uniform(-3.2, -1.2)))),
        ("opacity_logits".into(), Array::list(draw(COUNT, stream, |s| s.uniform(-3.0, 2.5)))),
        ("sh".into(), Array::new([COUNT, 16, 3], draw(COUNT * 48, stream, |s| 0.25 * s.normal()))),
        ("features".into(), Array::new([COUNT, FEATURES], draw(COUNT * FEATURES, stream, |s| s.normal()))),
        ("background".into(), Array::list(draw(3 + FEATURES, stream, Stream::unit))),
    ]);
    let mut logits = values["opacity_logits"].values.clone();
    if settings.rules == SplatRules::gsplat() {
        // Opaque enough for the clamp; only these rules have a gradient there that is the derivative.
        logits[..4].iter_mut().for_each(|logit| *logit = 5.5);
    }
    let device = (backends()[0].device)();
    keep_off_thresholds(&mut logits, camera, settings, |logits| {
        let mut moved = values.clone();
        moved.insert("opacity_logits".into(), Array::list(logits.to_vec()));
        inputs(&moved, &device)
    });
    values.insert("opacity_logits".into(), Array::list(logits));
    values
}

/// The values as leaves on a device.
fn inputs(values: &Values, device: &Device) -> SplatInputs {
    fn leaf<const D: usize>(values: &Values, name: &str, device: &Device) -> Tensor<D> {
        let array = &values[name];
        let shape = array.shape.as_slice().try_into().expect("each input has its own number of axes");
        let leaf = tensor(&array.values, shape, device, DType::F64);
        if leaf.is_autodiff() { leaf.require_grad() } else { leaf }
    }
    SplatInputs {
        means: leaf(values, "means", device),
        quaternions: leaf(values, "quaternions", device),
        log_scales: leaf(values, "log_scales", device),
        opacity_logits: leaf(values, "opacity_logits", device),
        sh: leaf(values, "sh", device),
        features: Some(leaf(values, "features", device)),
        background: leaf(values, "background", device),
    }
}

fn gradients_are_derivatives(rules: SplatRules) {
    let camera = camera();
    let settings = SplatSettings { rules, sh_degree: 3, ..SplatSettings::default() };
    let values = scene(&camera, &settings);
    let size = 2 * (3 + FEATURES + 2) * camera.height * camera.width;
    // Both copies of the picture count, with weights of their own.
    let weights = draw(size, &mut Stream::new(12, 0), Stream::normal);
    for backend in backends() {
        let plain = (backend.device)();
        let device = plain.clone().autodiff();
        let inputs_with_leaves = inputs(&values, &device);
        let picture =
            splat(inputs_with_leaves.clone(), None, &camera, &settings).expect("the scene can be rendered").packed;
        let loss = (picture.clone() * tensor(&weights, picture.dims(), &device, DType::F64)).sum();
        let found = loss.backward();
        let leaves = inputs_with_leaves;
        let gradients = Values::from([
            ("means".into(), gradient(&leaves.means, &found)),
            ("quaternions".into(), gradient(&leaves.quaternions, &found)),
            ("log_scales".into(), gradient(&leaves.log_scales, &found)),
            ("opacity_logits".into(), gradient(&leaves.opacity_logits, &found)),
            ("sh".into(), gradient(&leaves.sh, &found)),
            ("features".into(), gradient(&leaves.features.expect("the scene has features"), &found)),
            ("background".into(), gradient(&leaves.background, &found)),
        ]);
        let loss = |values: &Values| {
            let picture = splat(inputs(values, &plain), None, &camera, &settings).expect("still renderable").packed;
            numbers(picture).iter().zip(&weights).map(|(value, weight)| value * weight).sum()
        };
        compare(&values, &gradients, loss).unwrap_or_else(|error| panic!("{}: {error}", backend.name));
    }
}

#[test]
fn gradients_of_a_picture_by_the_rules_of_3dgs_are_its_derivatives() {
    gradients_are_derivatives(SplatRules::inria());
}

#[test]
fn gradients_of_a_picture_by_the_rules_of_gsplat_are_its_derivatives() {
    gradients_are_derivatives(SplatRules::gsplat());
}
