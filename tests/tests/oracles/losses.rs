//! `loss_coarse` and `loss_fine`: composition, every term of the losses, and both losses as wholes.

use anyhow::{Result, bail};
use burn::tensor::{Device, Tensor};
use mvfusion_model::config::LossConfig;
use mvfusion_model::model::composition::{Blending, BranchRenders, Composition, within};
use mvfusion_model::train::loss::terms::{
    above, behind, dssim, edge_variation, entropy, l1, large, likeness, masked_dssim, spiky,
};
use mvfusion_model::train::loss::{LossContext, LossSchedule, Pictures, Windows, light_loss, main_loss};
use mvfusion_render::window::{ssim_map, structure_map};
use mvfusion_tests::{Array, Checklist, Tolerance, gradient, numbers};

use crate::archive::Archive;
use crate::composition::mask_pictures;

/// Of maps; from the README of the oracle.
const MAPS: Tolerance = Tolerance::absolute(1e-5);

/// Of the SSIM map, where variances cancel.
const SSIM_MAP: Tolerance = Tolerance::absolute(1e-4);

/// Of terms and totals.
const VALUES: Tolerance = Tolerance::of_entry(2e-5);

/// Of gradients.
const GRADIENTS: Tolerance = Tolerance::of_largest(5e-5);

/// The photo is darkened in the first stage.
const DARKENING: f64 = 0.9;

/// The inputs that gradients are given of.
const INPUTS: [&str; 7] = ["I_f", "I_b", "M", "D_f", "D_b", "scaling_f", "scaling_b"];

/// The first stage.
pub fn check_geometry(archive: &Archive, device: &Device) -> Result<()> {
    check(archive, device, Stage::Geometry)
}

/// The first stage with the mask of this program, which is clamped (docs/departures.md).
pub fn check_clamped_geometry(archive: &Archive, device: &Device) -> Result<()> {
    check(archive, device, Stage::ClampedGeometry)
}

/// The later stages.
pub fn check_deformation(archive: &Archive, device: &Device) -> Result<()> {
    check(archive, device, Stage::Deformation)
}

#[derive(Clone, Copy, PartialEq)]
enum Stage {
    Geometry,
    ClampedGeometry,
    Deformation,
}

/// The leaves of one graph, and what they are composed to.
struct Inputs {
    layers: BranchRenders,
    /// Its mask in the order of the files.
    mask: Tensor<4>,
    dynamic_depth: Tensor<4>,
    static_depth: Tensor<4>,
    log_scales: [Tensor<2>; 2],
    blend: Composition,
}

impl Inputs {
    /// Fresh leaves.
    fn read(archive: &Archive, device: &Device, stage: Stage) -> Result<Self> {
        let leaf = |name: &str| archive.tensor::<4>(&format!("in.{name}"), device).map(|t| t.require_grad());
        let rows = |name: &str| archive.tensor::<2>(&format!("in.{name}"), device).map(|t| t.require_grad());
        let mask = leaf("M")?;
        let layers = BranchRenders { dynamic: leaf("I_f")?, static_: leaf("I_b")?, mask: mask_pictures(mask.clone()) };
        // Ours clamps the mask of the first stage; the oracle, as the original, does not.
        let blending = match stage {
            Stage::Geometry => Blending::GeometryUnclamped,
            Stage::ClampedGeometry => Blending::Geometry,
            Stage::Deformation => Blending::Deformation,
        };
        Ok(Self {
            blend: layers.clone().compose_within(blending, Some(&valid(archive, device)?)),
            layers,
            mask,
            dynamic_depth: leaf("D_f")?,
            static_depth: leaf("D_b")?,
            log_scales: [rows("scaling_f")?, rows("scaling_b")?],
        })
    }

    fn pictures(&self) -> Pictures {
        Pictures {
            composition: self.blend.clone(),
            dynamic_depth: self.dynamic_depth.clone(),
            static_depth: self.static_depth.clone(),
        }
    }

    /// Compares the value of a loss and its gradients. One that is not stored is zero, unless none is stored: the file
    /// leaves out those that equal the gradients of an earlier step.
    fn compare(&self, checks: &mut Checklist, archive: &Archive, loss: Tensor<1>, names: &Names) -> Result<()> {
        let gradients = loss.backward();
        checks.close_number(&names.value, archive.number(&names.value)?, numbers(loss)[0], VALUES);
        if !INPUTS.iter().any(|input| archive.has(&format!("{}.{input}", names.gradient))) {
            return Ok(());
        }
        let found = [
            gradient(&self.layers.dynamic, &gradients),
            gradient(&self.layers.static_, &gradients),
            gradient(&self.mask, &gradients),
            gradient(&self.dynamic_depth, &gradients),
            gradient(&self.static_depth, &gradients),
            gradient(&self.log_scales[0], &gradients),
            gradient(&self.log_scales[1], &gradients),
        ];
        for (input, found) in INPUTS.into_iter().zip(found) {
            let name = format!("{}.{input}", names.gradient);
            let zeros = found.zeros_like();
            checks.close(&name, archive.find(&name).unwrap_or(&zeros), &found, GRADIENTS);
        }
        Ok(())
    }
}

/// Where a loss and its gradients are stored.
struct Names {
    value: String,
    gradient: String,
}

/// The mask of valid pixels.
fn valid(archive: &Archive, device: &Device) -> Result<Tensor<4>> {
    archive.tensor("in.V", &device.clone().inner())
}

fn check(archive: &Archive, device: &Device, stage: Stage) -> Result<()> {
    let device = &device.clone().autodiff();
    let valid = valid(archive, device)?;
    let photos = archive.tensor::<4>("in.GT", &device.clone().inner())? * valid.clone();
    let scene = Scene { photos, valid, extent: archive.number("in.ext")?, windows: Windows::default() };
    let mut checks = Checklist::default();
    check_maps(&mut checks, archive, &scene, &Inputs::read(archive, device, stage)?)?;
    for name in archive.names().filter_map(|name| name.strip_prefix("out.term.")) {
        let inputs = Inputs::read(archive, device, stage)?;
        let loss = term(name, &inputs, &scene)?;
        let names = Names { value: format!("out.term.{name}"), gradient: format!("out.grad.{name}") };
        inputs.compare(&mut checks, archive, loss, &names)?;
    }
    for name in archive.names().filter_map(|name| name.strip_prefix("out.total.")) {
        let inputs = Inputs::read(archive, device, stage)?;
        let loss = total(name, &inputs, &scene, stage)?;
        let names = Names { value: format!("out.total.{name}"), gradient: format!("out.grad.total.{name}") };
        inputs.compare(&mut checks, archive, loss, &names)?;
    }
    checks.finish()
}

/// What the losses compare with.
struct Scene {
    /// Black at invalid pixels.
    photos: Tensor<4>,
    valid: Tensor<4>,
    extent: f64,
    windows: Windows,
}

fn check_maps(checks: &mut Checklist, archive: &Archive, scene: &Scene, inputs: &Inputs) -> Result<()> {
    let blend = inputs.blend.clone();
    let windows = &scene.windows;
    let ssim = ssim_map(blend.composed.clone(), scene.photos.clone(), &windows.ssim);
    let structure = structure_map(blend.dynamic.clone(), blend.lit.clone(), &windows.structure);
    for (name, found, tolerance) in [
        ("I_f_clamped", blend.dynamic, MAPS),
        ("I_b_light", blend.lit, MAPS),
        ("brightness", blend.brightness, MAPS),
        ("structure_map", structure, MAPS),
        ("ssim_map", ssim, SSIM_MAP),
        ("I", blend.composed, MAPS),
        ("M_f", blend.mask, MAPS),
        ("M_b", blend.static_mask, MAPS),
    ] {
        let expected = archive.array(&format!("out.map.{name}"))?;
        checks.close(format!("map.{name}"), expected, &Array::of(found), tolerance);
    }
    Ok(())
}

/// A term of the losses, unweighted.
fn term(name: &str, inputs: &Inputs, scene: &Scene) -> Result<Tensor<1>> {
    let blend = inputs.blend.clone();
    let (photos, windows) = (scene.photos.clone(), &scene.windows);
    let valid = |picture: Tensor<4>| within(picture, Some(&scene.valid));
    let still_lit = blend.lit.clone().detach();
    let dark = photos.clone() * DARKENING;
    let (front, back) = (inputs.dynamic_depth.clone(), inputs.static_depth.clone().detach());
    let dynamic_answers = above(&blend.mask, 0.51);
    let static_answers = above(&blend.static_mask, 0.51);
    Ok(match name {
        "main.l1" => l1(blend.composed, photos),
        "main.coarse_mean" => l1(blend.dynamic * 0.5 + still_lit * 0.5, dark),
        "main.coarse_mask" => l1(blend.mask * blend.dynamic + blend.static_mask * still_lit, dark),
        "main.bg_l1" => l1(blend.lit, photos),
        "main.bg_dssim" => dssim(blend.lit, photos, &windows.ssim),
        "main.fg_dssim" => dssim(blend.dynamic, photos, &windows.ssim),
        "main.depth_back" => behind(front, back, above(&blend.mask, 0.6), scene.extent),
        "main.depth_back_nodetach" => behind(front, inputs.static_depth.clone(), above(&blend.mask, 0.6), scene.extent),
        "main.depth_forward" => behind(back, front, valid(-above(&blend.mask, 0.4) + 1.0), scene.extent),
        "main.depth_edge_tv" => edge_variation(inputs.static_depth.clone() / scene.extent, &photos),
        "main.penalize_dynamic" => likeness(blend.dynamic, still_lit, dynamic_answers, &windows.structure),
        "main.fg_comp_dssim" => masked_dssim(blend.dynamic, photos, dynamic_answers, &windows.ssim),
        "main.bg_comp_dssim" => masked_dssim(blend.lit, photos, static_answers, &windows.ssim),
        "main.fg_comp_l1" => l1(blend.dynamic * dynamic_answers.clone(), photos * dynamic_answers),
        "main.bg_comp_l1" => l1(blend.lit * static_answers.clone(), photos * static_answers),
        "light.l_to_one" => valid(blend.brightness - 1.0).abs().mean(),
        "light.explicit" => l1((blend.static_.detach() * blend.brightness).clamp(0.0, 1.0), photos),
        "light.dssim" => dssim(blend.composed, photos, &windows.ssim),
        "light.large_fg" => large(inputs.log_scales[0].clone(), scene.extent),
        "light.large_bg" => large(inputs.log_scales[1].clone(), scene.extent),
        "light.spiky_fg" => spiky(inputs.log_scales[0].clone()),
        "light.spiky_bg" => spiky(inputs.log_scales[1].clone()),
        "light.entropy" => entropy(blend.mask),
        _ => bail!("no term of ours is called `{name}`"),
    })
}

/// A whole loss: `main.neu3d.it900` and its like.
fn total(name: &str, inputs: &Inputs, scene: &Scene, stage: Stage) -> Result<Tensor<1>> {
    let [part, config_name, step] = name.split('.').collect::<Vec<_>>()[..] else { bail!("`{name}` is no total") };
    let (config, densify_until, length) = match config_name {
        "neu3d" => (LossConfig::default(), 16_000, 20_000),
        "masked" => (LossConfig { geometry_mean: false, ..LossConfig::default() }, 16_000, 20_000),
        "onthego_indoor" => (onthego_indoor(), 26_000, 30_000),
        _ => bail!("the configuration `{config_name}` is not known"),
    };
    let schedule = LossSchedule {
        geometry: stage != Stage::Deformation,
        step: step.trim_start_matches("it").parse()?,
        total: length,
        densify_until,
        brightness_end: config.brightness_end,
    };
    let context = LossContext {
        photos: &scene.photos,
        valid: Some(&scene.valid),
        motion: None,
        config: &config,
        schedule,
        extent: scene.extent,
        windows: &scene.windows,
    };
    match part {
        "main" => Ok(main_loss(&inputs.pictures(), &context)),
        "light" => Ok(light_loss(&inputs.pictures(), inputs.log_scales.clone(), &context)),
        _ => bail!("there is no {part} loss"),
    }
}

/// DeGauss' weights for indoor photos (METHOD §11.1).
fn onthego_indoor() -> LossConfig {
    LossConfig {
        main: 4.0,
        depth_back: 0.0,
        depth_forward: 0.0,
        depth_smooth: 0.1,
        penalize_dynamic: 0.0,
        brightness_end: 0.2,
        large: 0.0,
        spiky: 0.0,
        entropy: 0.001,
        ..LossConfig::default()
    }
}
