//! The ops that compare renders with photos, as cases.

use anyhow::Result;
use burn::tensor::Device;
use mvfusion_render::objective::{
    GeometryTerms, MaskNormalisation, ObjectiveInputs, ObjectiveMasks, ObjectiveTerms, objective,
};
use mvfusion_render::picture;
use mvfusion_render::window::Window;
use mvfusion_tests::{Array, Tolerance, gradient};

use super::ops::{MOMENTS, Outcome};
use super::{normal, uniform};

/// A quotient that a shader may round otherwise.
const QUOTIENT: Tolerance = Tolerance::of_largest(3e-7);

/// Height and width: no multiple of a cube.
const SIZE: [usize; 2] = [37, 53];

pub fn unpacked(device: &Device) -> Result<Outcome> {
    let bytes: Vec<u8> = (0..=u8::MAX).cycle().take(7 * 41 * 3).collect();
    let mut outcome = Vec::new();
    // The last word is whole or not.
    for (height, width, channels) in [(7, 41, 3), (7, 41, 1), (16, 16, 1), (1, 1, 1)] {
        let bytes = &bytes[..height * width * channels];
        let planes = picture::planes(bytes, [height, width, channels], device);
        outcome.push((format!("{channels} channels of {height}x{width}"), Array::of(planes), QUOTIENT));
    }
    Ok(outcome)
}

/// Every term of both stages, with and without masks and exposure.
pub fn objective_and_back(device: &Device) -> Result<Outcome> {
    let mut outcome = Vec::new();
    for (normalisation, exposed, masked) in [
        (MaskNormalisation::Geometry, false, [false; 3]),
        (MaskNormalisation::GeometryUnclamped, true, [true, false, true]),
        (MaskNormalisation::Deformation, false, [false; 3]),
        (MaskNormalisation::Deformation, true, [true; 3]),
    ] {
        let [height, width] = SIZE;
        let dynamic = uniform([2, 8, height, width], [0.05, 0.95], 51, device);
        let static_ = uniform([2, 5, height, width], [0.05, 0.95], 52, device);
        let exposure = exposed.then(|| normal([3, 4], 0.3, 53, device));
        let plane = |seed| uniform([1, height, width], [0.0, 1.0], seed, device).inner();
        // The moving pixels lie within their surroundings, and both within the valid ones.
        let valid = plane(54).greater_elem(0.2).float();
        let around = plane(55).greater_elem(0.5).float() * valid.clone();
        let moving = plane(56).greater_elem(0.5).float() * around.clone();
        let masks = ObjectiveMasks {
            valid: masked[0].then_some(valid),
            moving: masked[1].then_some(moving),
            around: masked[2].then_some(around),
        };
        let inputs = ObjectiveInputs {
            dynamic: dynamic.clone(),
            static_: static_.clone(),
            exposure: exposure.clone(),
            photo: uniform([3, height, width], [0.0, 1.0], 57, device).inner(),
            masks,
        };
        let found = objective(inputs, &terms(normalisation, masked[2]))?;
        let gradients = found.loss.backward();
        let name = |what: &str| format!("{what}, {normalisation:?}, exposure {exposed}, masks {masked:?}");
        outcome.push((name("loss"), Array::of(found.loss), MOMENTS));
        outcome.push((name("squared error"), Array::of(found.squared_error), MOMENTS));
        outcome.push((name("dynamic"), gradient(&dynamic, &gradients), MOMENTS));
        outcome.push((name("static"), gradient(&static_, &gradients), MOMENTS));
        if let Some(exposure) = exposure {
            outcome.push((name("exposure"), gradient(&exposure, &gradients), MOMENTS));
        }
    }
    Ok(outcome)
}

/// Every term with a weight of its own.
fn terms(normalisation: MaskNormalisation, by_motion: bool) -> ObjectiveTerms {
    let in_geometry = normalisation != MaskNormalisation::Deformation;
    ObjectiveTerms {
        normalisation,
        extent: 2.5,
        dynamic_region: by_motion,
        static_region: by_motion,
        ssim: Window::gaussian(11, 1.5),
        structure: Window::gaussian(5, 1.5),
        geometry: in_geometry.then_some(GeometryTerms { l1: 0.7, dssim: 0.3, mean: false }),
        composed_l1: 0.8,
        depth_back: 0.11,
        depth_back_detached: false,
        depth_forward: 0.12,
        depth_smooth: 0.13,
        likeness: 0.14,
        branch_dssim: 0.15,
        branch_l1: 0.16,
        dynamic_above: 0.4,
        static_above: 0.3,
        composed_dssim: 0.2,
        brightness: 0.17,
        explicit_brightness: 0.18,
        // Unclamped shares have no entropy.
        entropy: if normalisation == MaskNormalisation::GeometryUnclamped { 0.0 } else { 0.19 },
        mask_motion: 0.21,
        mask_still: 0.22,
    }
}
