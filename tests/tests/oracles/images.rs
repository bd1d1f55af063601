//! `image_ops`: SSIM, the structure map, edge-aware variation and the entropy of a mask.

use anyhow::Result;
use burn::tensor::Device;
use mvfusion_model::train::loss::terms::{edge_variation, entropy};
use mvfusion_render::window::{Window, ssim_map, structure_map};
use mvfusion_tests::{Array, Checklist, Tolerance, gradient};

use crate::archive::Archive;

/// Of maps; from the README of the oracle.
const MAPS: Tolerance = Tolerance::absolute(1e-4);

/// Of single numbers.
const VALUES: Tolerance = Tolerance::absolute(1e-5);

/// Of gradients.
const GRADIENTS: Tolerance = Tolerance::of_largest(5e-5);

/// Of the entropy's gradient, which is large near 0 and 1.
const ENTROPY_GRADIENT: Tolerance = Tolerance::of_largest(1e-4);

/// Of windows, which are single precision on both sides.
const WINDOWS: Tolerance = Tolerance::absolute(1e-8);

/// All operations of a file.
pub fn check(archive: &Archive, device: &Device) -> Result<()> {
    let device = device.clone().autodiff();
    let mut checks = Checklist::default();
    let (wide, narrow) = (Window::gaussian(11, 1.5), Window::gaussian(5, 1.5));
    for (name, window) in [("out.window11", &wide), ("out.window5", &narrow)] {
        checks.close(name, archive.array(name)?, &square(window), WINDOWS);
    }

    let a = || archive.tensor::<4>("in.a", &device).map(|a| a.require_grad());
    let b = archive.tensor::<4>("in.b", &device)?;
    let first = a()?;
    let map = ssim_map(first.clone(), b.clone(), &wide);
    let mean = map.clone().mean();
    let gradients = mean.backward();
    checks.close("ssim_map", archive.array("out.ssim_map")?, &Array::of(map), MAPS);
    checks.close_number("ssim", archive.number("out.ssim")?, Array::of(mean).values[0], VALUES);
    checks.close("grad.ssim.a", archive.array("out.grad.ssim.a")?, &gradient(&first, &gradients), GRADIENTS);

    let first = a()?;
    let map = structure_map(first.clone(), b.clone(), &narrow);
    let gradients = (map.clone() * archive.tensor("in.cot", &device)?).sum().backward();
    checks.close("structure_map", archive.array("out.structure_map")?, &Array::of(map), MAPS);
    checks.close("grad.structure.a", archive.array("out.grad.structure.a")?, &gradient(&first, &gradients), GRADIENTS);

    let variation = edge_variation(archive.tensor("in.depth", &device)?, &b);
    checks.close_number("edge_tv", archive.number("out.edge_tv")?, Array::of(variation).values[0], VALUES);

    let mask = archive.tensor::<4>("in.p", &device)?.require_grad();
    let value = entropy(mask.clone());
    let gradients = value.backward();
    checks.close_number("entropy", archive.number("out.entropy")?, Array::of(value).values[0], VALUES);
    checks.close(
        "grad.entropy.p",
        archive.array("out.grad.entropy.p")?,
        &gradient(&mask, &gradients),
        ENTROPY_GRADIENT,
    );
    checks.finish()
}

/// A separable window as the square that it stands for.
fn square(window: &Window) -> Array {
    let weights: Vec<f64> = window.weights().iter().map(|&w| f64::from(w)).collect();
    let size = weights.len();
    Array::new([size, size], (0..size * size).map(|i| weights[i / size] * weights[i % size]).collect())
}
