//! Splats of hard Gaussians, by all rules.

use anyhow::Result;
use burn::tensor::Tensor;
use glam::{DMat3, DVec3};
use mvfusion_data::Camera;
use mvfusion_render::splat::{Antialias, SplatInputs, SplatRules, SplatSettings, Statistic, splat};
use mvfusion_tests::{Tolerance, gradient};

use super::cases::{Case, Leaf, Numbers, Outcome};

/// Of pictures and gradients: a few dozen roundings, through conics.
const PICTURE: Tolerance = Tolerance::of_largest(2e-5);
const GRADIENT: Tolerance = Tolerance::of_largest(1e-4).plus(1e-9);

pub const CASES: [(&str, Case); 6] = [
    ("splats_at_the_camera", at_the_camera),
    ("splats_without_extent", without_extent),
    ("splats_as_large_as_the_world", huge),
    ("splats_clear_and_opaque", clear_and_opaque),
    ("splats_degenerate", degenerate),
    ("splats_in_one_pixel", one_pixel),
];

/// Gaussians that are changed before they are splatted.
struct Scene {
    means: Vec<[f64; 3]>,
    log_scales: Vec<[f64; 3]>,
    quaternions: Vec<[f64; 4]>,
    opacity_logits: Vec<f64>,
    size: [usize; 2],
}

/// Five ordinary Gaussians one behind the other, off the thresholds.
fn plain() -> Scene {
    Scene {
        means: vec![[0.1, -0.2, 2.1], [-0.5, 0.3, 3.2], [0.6, 0.4, 4.3], [-0.2, -0.6, 5.1], [0.3, 0.1, 6.2]],
        log_scales: vec![
            [-1.6, -1.2, -1.9],
            [-1.1, -0.9, -1.4],
            [-0.8, -1.3, -1.0],
            [-0.7, -0.6, -1.2],
            [-0.5, -0.4, -0.6],
        ],
        quaternions: vec![
            [0.9, 0.1, -0.3, 0.2],
            [0.5, -0.6, 0.2, 0.4],
            [0.3, 0.8, 0.1, -0.5],
            [1.2, 0.0, 0.4, 0.1],
            [-0.7, 0.2, 0.5, 0.6],
        ],
        opacity_logits: vec![-0.4, 0.3, -0.9, 0.6, 1.1],
        size: [27, 22],
    }
}

fn at_the_camera(numbers: Numbers<'_>) -> Result<Outcome> {
    splatted(numbers, || {
        let mut scene = plain();
        // In the camera, on its plane, just before and just behind the near plane at 0.2, and behind the camera.
        scene.means[0] = [0.0, 0.0, 0.0];
        scene.means[1] = [0.4, -0.3, 0.0];
        scene.means[2] = [0.01, 0.02, 0.1999];
        scene.means[3] = [0.03, -0.02, 0.2001];
        scene.log_scales[3] = [-5.0, -4.5, -5.5];
        scene
    })
}

fn without_extent(numbers: Numbers<'_>) -> Result<Outcome> {
    splatted(numbers, || {
        let mut scene = plain();
        scene.log_scales[0] = [-20.0; 3];
        scene.log_scales[1] = [-45.0; 3];
        scene.log_scales[2] = [-120.0; 3];
        scene
    })
}

fn huge(numbers: Numbers<'_>) -> Result<Outcome> {
    splatted(numbers, || {
        let mut scene = plain();
        scene.log_scales[1] = [3.0; 3];
        scene.log_scales[2] = [6.0, 5.5, 6.5];
        scene.log_scales[4] = [12.0; 3];
        scene
    })
}

fn clear_and_opaque(numbers: Numbers<'_>) -> Result<Outcome> {
    splatted(numbers, || {
        let mut scene = plain();
        scene.opacity_logits = vec![-120.0, 9.0, -30.0, 14.0, 120.0];
        scene
    })
}

fn degenerate(numbers: Numbers<'_>) -> Result<Outcome> {
    splatted(numbers, || {
        let mut scene = plain();
        // A needle, a sheet of paper seen from its edge, and quaternions that are tiny, huge or nothing.
        scene.log_scales[0] = [0.5, -14.0, -14.0];
        scene.log_scales[1] = [-0.5, -0.4, -20.0];
        scene.quaternions[1] = [0.5f64.sqrt(), 0.0, 0.5f64.sqrt(), 0.0];
        scene.quaternions[2] = scene.quaternions[2].map(|q| 1e-9 * q);
        scene.quaternions[3] = [0.0; 4];
        scene.quaternions[4] = scene.quaternions[4].map(|q| 1e9 * q);
        scene
    })
}

fn one_pixel(numbers: Numbers<'_>) -> Result<Outcome> {
    splatted(numbers, || Scene { size: [1, 1], ..plain() })
}

/// The scene by the rules of 3DGS and of gsplat, with and without compensation.
fn splatted(numbers: Numbers<'_>, scene: impl Fn() -> Scene) -> Result<Outcome> {
    let compensated = SplatRules { antialias: Antialias::Compensated, ..SplatRules::gsplat() };
    let mut outcome = Vec::new();
    for (name, rules) in [("3DGS", SplatRules::inria()), ("gsplat", SplatRules::gsplat()), ("antialiased", compensated)]
    {
        outcome.extend(one(numbers, &scene(), name, rules)?);
    }
    Ok(outcome)
}

fn one(numbers: Numbers<'_>, scene: &Scene, name: &str, rules: SplatRules) -> Result<Outcome> {
    let count = scene.means.len();
    let inputs = SplatInputs {
        means: numbers.leaf(scene.means.as_flattened().to_vec(), [count, 3]),
        quaternions: numbers.leaf(scene.quaternions.as_flattened().to_vec(), [count, 4]),
        log_scales: numbers.leaf(scene.log_scales.as_flattened().to_vec(), [count, 3]),
        opacity_logits: numbers.leaf(scene.opacity_logits.clone(), [count]),
        sh: numbers.noise(0.3, 0.3, 31, [count, 4, 3]),
        features: Some(numbers.noise(0.5, 0.2, 32, [count, 1])),
        background: numbers.leaf([0.2, 0.4, 0.6, 0.1], [4]),
    };
    let [width, height] = scene.size;
    let camera = Camera::centred(width, height, 24.0, DMat3::IDENTITY, DVec3::ZERO);
    let settings = SplatSettings { rules, sh_degree: 1, statistic: Statistic::ColourAndDepth };
    let picture = splat(inputs.clone(), None, &camera, &settings)?;
    let [_, channels, ..] = picture.packed.dims();
    let main: Tensor<4> = picture.packed.narrow(0, 0, 1).narrow(1, 0, channels);
    let leaves: [Leaf<'_>; 6] = [
        ("means", &|gradients| gradient(&inputs.means, gradients)),
        ("quaternions", &|gradients| gradient(&inputs.quaternions, gradients)),
        ("log-scales", &|gradients| gradient(&inputs.log_scales, gradients)),
        ("opacity logits", &|gradients| gradient(&inputs.opacity_logits, gradients)),
        ("sh", &|gradients| gradient(&inputs.sh, gradients)),
        ("background", &|gradients| gradient(&inputs.background, gradients)),
    ];
    Ok(numbers.and_back(name, main, &leaves, [PICTURE, GRADIENT]))
}
