//! The project's own oracle: a small file that `make.py` beside it computes from the formulas, independently.

use anyhow::{Result, ensure};
use burn::module::Param;
use burn::nn::Linear;
use burn::tensor::{DType, Device, Gradients, Tensor};
use glam::{DMat3, DVec3};
use libtest_mimic::Trial;
use mvfusion_data::Camera;
use mvfusion_model::model::network::Mlp;
use mvfusion_render::splat::{SplatInputs, SplatRules, SplatSettings, splat};
use mvfusion_render::window::{Window, ssim_map};
use mvfusion_tests::{Array, Backend, Checklist, Tolerance, gradient, splat_gradients, tensor};

use crate::archive::Archive;
use crate::hexplane::{compare_planes, field};
use crate::kinds::Check;
use crate::network::layer_gradients;

/// The file; its format is told in `make.py`.
const FILE: &[u8] = include_bytes!("../../oracles/own.npz");

/// Single precision against double precision, through some ten operations.
const TOLERANCE: Tolerance = Tolerance::of_largest(2e-5);

/// SSIM subtracts nearly equal moments.
const SSIM: Tolerance = Tolerance::of_largest(1e-4);

/// The gradient of a picture with respect to the shape of a Gaussian amplifies the rounding of its conic.
const SPLAT: Tolerance = Tolerance::of_largest(5e-5);

/// The cases of the file.
const CASES: [(&str, Check); 3] = [("hexplane", check_hexplane), ("ssim", check_ssim), ("splat", check_splat)];

/// One trial a case.
pub fn trials(backend: Backend) -> Vec<Trial> {
    let trial = |(name, check): (&'static str, Check)| {
        Trial::test(format!("oracle::{}::own::{name}", backend.name), move || {
            run(name, check, backend).map_err(|error| format!("{error:#}").into())
        })
    };
    CASES.into_iter().map(trial).collect()
}

fn run(name: &str, check: Check, backend: Backend) -> Result<()> {
    let archive = Archive::embedded("own", FILE)?.part(name);
    check(&archive, &(backend.device)().autodiff())?;
    let unseen = archive.unseen(|_| true);
    ensure!(unseen.is_empty(), "not looked at: {unseen:?}");
    Ok(())
}

/// A leaf of the file.
fn leaf<const D: usize>(archive: &Archive, name: &str, device: &Device) -> Result<Tensor<D>> {
    Ok(archive.tensor::<D>(&format!("in.{name}"), device)?.require_grad())
}

/// The field with the first layer of a trunk behind it.
fn check_hexplane(archive: &Archive, device: &Device) -> Result<()> {
    let field = field(archive, device)?;
    let (points, times) = (leaf::<2>(archive, "points", device)?, leaf::<2>(archive, "times", device)?);
    let weight = archive.array("in.weight")?.transposed();
    let shape = [weight.shape[0], weight.shape[1]];
    let layer = Linear {
        weight: Param::from_tensor(tensor(&weight.values, shape, device, DType::F32)),
        bias: Some(Param::from_tensor(archive.tensor("in.bias", device)?)),
    };
    let trunk = Mlp::rectified(vec![layer]);
    let value = trunk.forward(field.forward(points.clone(), times.clone()));

    let mut checks = Checklist::default();
    let gradients = backward(&mut checks, archive, value, TOLERANCE)?;
    let [weight, bias] = layer_gradients(&trunk.layers[0], &gradients);
    for (name, found) in [
        ("points", gradient(&points, &gradients)),
        ("times", gradient(&times, &gradients)),
        ("weight", weight),
        ("bias", bias),
    ] {
        checks.close(name, archive.array(&format!("out.grad.{name}"))?, &found, TOLERANCE);
    }
    let planes = gradient(&field.planes.val(), &gradients);
    compare_planes(&mut checks, archive, "out.grad.", &planes, field.layout(), TOLERANCE);
    checks.finish()
}

fn check_ssim(archive: &Archive, device: &Device) -> Result<()> {
    let (a, b) = (leaf::<4>(archive, "a", device)?, leaf::<4>(archive, "b", device)?);
    let mut checks = Checklist::default();
    let map = ssim_map(a.clone(), b.clone(), &Window::gaussian(11, 1.5));
    let gradients = backward(&mut checks, archive, map, SSIM)?;
    for (name, leaf) in [("a", a), ("b", b)] {
        checks.close(name, archive.array(&format!("out.grad.{name}"))?, &gradient(&leaf, &gradients), SSIM);
    }
    checks.finish()
}

/// A picture by the rules of 3DGS, with an extra feature.
fn check_splat(archive: &Archive, device: &Device) -> Result<()> {
    let rows = |name: &str| leaf::<2>(archive, name, device);
    let inputs = SplatInputs {
        means: rows("means")?,
        quaternions: rows("quaternions")?,
        log_scales: rows("log_scales")?,
        opacity_logits: leaf(archive, "opacity_logits", device)?,
        sh: leaf(archive, "sh", device)?,
        features: Some(rows("features")?),
        background: leaf(archive, "background", device)?,
    };
    let settings = SplatSettings { rules: SplatRules::inria(), sh_degree: 1, ..SplatSettings::default() };
    let picture = splat(inputs.clone(), None, &camera(archive)?, &settings)?;
    let [_, channels, height, width] = picture.packed.dims();
    let main: Tensor<3> = picture.packed.narrow(0, 0, 1).reshape([channels, height, width]);

    let mut checks = Checklist::default();
    let gradients = backward(&mut checks, archive, main, SPLAT)?;
    for (name, found) in splat_gradients(&inputs, &gradients) {
        checks.close(name, archive.array(&format!("out.grad.{name}"))?, &found, SPLAT);
    }
    checks.finish()
}

fn camera(archive: &Archive) -> Result<Camera> {
    let rotation = &archive.array("in.rotation")?.values;
    let (size, focal) = (archive.counts("in.size")?, archive.array("in.focal")?);
    Ok(Camera {
        width: size[0],
        height: size[1],
        fx: focal.values[0],
        fy: focal.values[1],
        cx: size[0] as f64 / 2.0,
        cy: size[1] as f64 / 2.0,
        // Row by row in the file, column by column in the matrix.
        rotation: DMat3::from_cols_slice(rotation).transpose(),
        translation: DVec3::from_slice(&archive.array("in.translation")?.values),
    })
}

/// Compares the value of a case and goes back from it under the stored cotangent.
fn backward<const D: usize>(
    checks: &mut Checklist,
    archive: &Archive,
    value: Tensor<D>,
    tolerance: Tolerance,
) -> Result<Gradients> {
    checks.close("value", archive.array("out.value")?, &Array::of(value.clone()), tolerance);
    let cotangent = archive.tensor::<D>("in.cot", &value.device())?;
    Ok((value * cotangent).sum().backward())
}
