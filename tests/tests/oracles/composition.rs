//! `compose_eval` and `brightness`: how the pictures of the branches become one.

use anyhow::Result;
use burn::tensor::{Device, Tensor};
use mvfusion_model::model::composition::{Blending, BranchRenders, brightness};
use mvfusion_model::model::mask::MaskChannel;
use mvfusion_tests::{Array, Checklist, Tolerance, gradient};

use crate::archive::Archive;

/// From the README of the oracle.
const EVALUATION: Tolerance = Tolerance::absolute(1e-6);

/// From the README of the oracle.
const BRIGHTNESS: Tolerance = Tolerance::of_largest(1e-6);

/// Brightness where the control is zero; the oracle has the map without it as well.
const OFFSET: f64 = 0.5;

/// The mask channels of a picture or of splat features, from the files' order (brightness, static, dynamic) to ours, and
/// back again.
pub fn mask_pictures<const D: usize>(channels: Tensor<D>) -> Tensor<D> {
    let order = [MaskChannel::Brightness, MaskChannel::Static, MaskChannel::Dynamic];
    Tensor::cat(order.map(|channel| channel.of(&channels)).to_vec(), 1)
}

/// The layers of a file.
pub fn layers(archive: &Archive, device: &Device) -> Result<BranchRenders> {
    Ok(BranchRenders {
        dynamic: archive.tensor("in.I_f", device)?,
        static_: archive.tensor("in.I_b", device)?,
        mask: mask_pictures(archive.tensor("in.M", device)?),
    })
}

/// The composition of evaluation.
pub fn check_evaluation(archive: &Archive, device: &Device) -> Result<()> {
    let blend = layers(archive, device)?.compose(Blending::Evaluation);
    let mut checks = Checklist::default();
    for (name, found) in [
        ("out.I", blend.composed),
        ("out.M_f", blend.mask),
        ("out.I_b_light", blend.lit),
        ("out.brightness", blend.brightness),
    ] {
        checks.close(name, archive.array(name)?, &Array::of(found), EVALUATION);
    }
    checks.finish()
}

/// The brightness map and its slope, at the knee and its neighbours too.
pub fn check_brightness(archive: &Archive, device: &Device) -> Result<()> {
    let control = archive.tensor::<1>("in.x", &device.clone().autodiff())?.require_grad();
    let found = brightness(control.clone());
    let gradients = found.clone().sum().backward();
    let found = Array::of(found);
    let mut checks = Checklist::default();
    checks.close("brightness", archive.array("out.brightness")?, &found, BRIGHTNESS);
    checks.close("g", archive.array("out.g")?, &found.map(|b| b - OFFSET), BRIGHTNESS);
    checks.close("grad.x", archive.array("out.grad.x")?, &gradient(&control, &gradients), BRIGHTNESS);
    checks.finish()
}
