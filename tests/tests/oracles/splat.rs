//! `gsplat`: pictures, projections and gradients under the rules of gsplat, with both of its alpha clamps.

use anyhow::{Context, Result};
use burn::tensor::{DType, Device, Tensor};
use glam::{DMat3, DVec3};
use mvfusion_data::Camera;
use mvfusion_render::splat::{
    Antialias, SplatInputs, SplatPicture, SplatRules, SplatSettings, Statistic, diagnose, splat,
};
use mvfusion_tests::{Array, Checklist, Tolerance, gradient, numbers, tensor};

use crate::archive::Archive;

/// The two clamps of alpha, by the prefix of their outputs.
const CLAMPS: [(&str, f64); 2] = [("a999", 0.999), ("a990", 0.99)];

/// Vulkan promises the exponential of `x` within `3 + 2 |x|` units in the last place, and |x| reaches 5.5 where alpha
/// is visible.
const GPU_EXPONENTIAL: f64 = 14.0 * 1.2e-7;

/// What a scene allows.
struct Allowances {
    /// Of colour and alpha outside of fragile pixels.
    pictures: Tolerance,
    /// Of depths there, which reach 159: the README's metric for pictures, and of each depth what the exponential of a
    /// GPU may be off.
    depths: Tolerance,
    /// Of gradients.
    gradients: Tolerance,
    /// Of what projection makes of each Gaussian; the README names no metric, this is that of pictures.
    projections: Tolerance,
}

/// From the README of the oracle: the scene of edge cases, the antialiased one, and all others.
fn allowances(archive: &Archive) -> Allowances {
    let (pictures, gradients) = match (archive.name().contains("edge"), archive.has("compensations")) {
        (true, _) => (4e-4, 5e-4),
        (false, true) => (1e-5, 2e-3),
        (false, false) => (1e-5, 3e-5),
    };
    Allowances {
        pictures: Tolerance::absolute(pictures),
        depths: Tolerance::of_entry(GPU_EXPONENTIAL).plus(pictures),
        gradients: Tolerance::of_largest(gradients),
        projections: Tolerance::of_largest(pictures),
    }
}

/// Outputs that are not compared.
pub const LEFT_OUT: &[(&str, &str)] = &[
    ("covars3d", "an intermediate; the conics follow from it"),
    ("n_contrib", "an intermediate of the blend"),
    ("grad_scales", "with respect to activated values; grad_log_scales is compared"),
    ("_grad_opacities", "with respect to activated values; grad_logit_opacities is compared"),
    ("grad_viewmats", "cameras are not optimised"),
    ("grad_conics", "an intermediate of the backward pass"),
    ("absgrad_means2d", "densification does not use it"),
    ("compensations", "a factor of the opacities, which are compared by the picture"),
];

/// The leaves of a scene.
struct Leaves {
    inputs: SplatInputs,
    probes: Vec<Tensor<2>>,
}

impl Leaves {
    fn read(archive: &Archive, cameras: usize, device: &Device) -> Result<Self> {
        let rows = |name: &str| archive.tensor::<2>(name, device).map(|t| t.require_grad());
        Ok(Self {
            inputs: SplatInputs {
                means: rows("means")?,
                quaternions: rows("quats")?,
                log_scales: rows("log_scales")?,
                opacity_logits: archive.tensor::<1>("logit_opacities", device)?.require_grad(),
                sh: archive.tensor::<3>("sh", device)?.require_grad(),
                features: None,
                background: archive.tensor::<1>("background", device)?.require_grad(),
            },
            probes: (0..cameras).map(|_| Tensor::zeros([1, 2], (device, DType::F32)).require_grad()).collect(),
        })
    }
}

/// The cameras of a scene.
fn cameras(archive: &Archive) -> Result<Vec<Camera>> {
    let (views, intrinsics) = (archive.array("viewmats")?, archive.array("Ks")?);
    let (width, height) = (archive.count("width")?, archive.count("height")?);
    let camera = |index: usize| {
        let (view, k) = (views.row(index).values, intrinsics.row(index).values);
        let row = |i: usize| DVec3::new(view[4 * i], view[4 * i + 1], view[4 * i + 2]);
        Camera {
            width,
            height,
            fx: k[0],
            fy: k[4],
            cx: k[2],
            cy: k[5],
            rotation: DMat3::from_cols(row(0), row(1), row(2)).transpose(),
            translation: DVec3::new(view[3], view[7], view[11]),
        }
    };
    Ok((0..views.shape[0]).map(camera).collect())
}

/// A scene under both clamps.
pub fn check(archive: &Archive, device: &Device) -> Result<()> {
    let device = device.clone().autodiff();
    let cameras = cameras(archive)?;
    let allowances = allowances(archive);
    let mut checks = Checklist::default();
    for (prefix, alpha_clamp) in CLAMPS {
        let antialias = if archive.has("compensations") { Antialias::Compensated } else { Antialias::Off };
        let settings = SplatSettings {
            rules: SplatRules { alpha_clamp, antialias, ..SplatRules::gsplat() },
            sh_degree: archive.count("sh_degree")?,
            statistic: Statistic::ColourAndDepth,
        };
        let leaves = Leaves::read(archive, cameras.len(), &device)?;
        let pictures: Vec<SplatPicture> = cameras
            .iter()
            .zip(&leaves.probes)
            .map(|(camera, probe)| splat(leaves.inputs.clone(), Some(probe.clone()), camera, &settings))
            .collect::<Result<_, _>>()?;
        compare_pictures(&mut checks, archive, prefix, &pictures, &allowances)?;
        compare_gradients(&mut checks, archive, prefix, &leaves, &pictures, &allowances)?;
        compare_projections(&mut checks, archive, &leaves.inputs, &cameras, &settings, &allowances)?;
    }
    checks.finish()
}

/// Colour, alpha and depth of each camera, outside of the pixels that stand on a threshold.
fn compare_pictures(
    checks: &mut Checklist,
    archive: &Archive,
    prefix: &str,
    pictures: &[SplatPicture],
    allowances: &Allowances,
) -> Result<()> {
    let fragile = archive.flags(&format!("{prefix}_fragile"))?;
    for (index, picture) in pictures.iter().enumerate() {
        for copy in [picture.main(), picture.light()] {
            let pixels = copy.alpha.dims()[1] * copy.alpha.dims()[2];
            for (name, found, tolerance) in [
                ("image", copy.colour.permute([1, 2, 0]), allowances.pictures),
                ("alpha", copy.alpha.permute([1, 2, 0]), allowances.pictures),
                ("depth_acc", copy.depth.permute([1, 2, 0]), allowances.depths),
            ] {
                let name = format!("{prefix}_{name}");
                let expected = archive.array(&name)?.row(index);
                let channels = expected.values.len() / pixels;
                let found = Array::of(found).reshaped(expected.shape.clone());
                let solid = |flat: usize| !fragile[index * pixels + flat / channels];
                let name = format!("{name}, camera {index}");
                checks.close_where(name, &expected, &found, tolerance, solid);
            }
        }
    }
    Ok(())
}

/// The loss of all cameras, and its gradients.
fn compare_gradients(
    checks: &mut Checklist,
    archive: &Archive,
    prefix: &str,
    leaves: &Leaves,
    pictures: &[SplatPicture],
    allowances: &Allowances,
) -> Result<()> {
    let device = &leaves.inputs.means.device();
    let cotangent = |name: &str, index: usize| -> Result<Tensor<3>> {
        let stored = archive.array(name)?.row(index);
        let (height, width) = (stored.shape[0], stored.shape[1]);
        let shape = [height, width, stored.values.len() / (height * width)];
        Ok(tensor(&stored.values, shape, device, DType::F32).permute([2, 0, 1]))
    };
    let mut losses = Vec::new();
    for (index, picture) in pictures.iter().enumerate() {
        let main = picture.main();
        losses.push((main.colour * cotangent("v_image", index)?).sum());
        losses.push((main.alpha * cotangent("v_alpha", index)?).sum());
        losses.push((main.depth * cotangent("v_depth", index)?).sum());
    }
    let magnitude: f64 = losses.iter().map(|part| numbers(part.clone())[0].abs()).sum();
    let loss = losses.into_iter().reduce(|sum, part| sum + part).context("there is no camera")?;
    let gradients = loss.backward();
    // A sum that may cancel, each of whose parts is as good as the pictures.
    let tolerance = Tolerance::absolute(allowances.pictures.absolute * magnitude.max(1.0));
    checks.close_number(
        format!("{prefix}_loss"),
        archive.number(&format!("{prefix}_loss"))?,
        numbers(loss)[0],
        tolerance,
    );

    let inputs = &leaves.inputs;
    for (name, found) in [
        ("means", gradient(&inputs.means, &gradients)),
        ("quats", gradient(&inputs.quaternions, &gradients)),
        ("log_scales", gradient(&inputs.log_scales, &gradients)),
        ("logit_opacities", gradient(&inputs.opacity_logits, &gradients)),
        ("sh", gradient(&inputs.sh, &gradients)),
        ("background", gradient(&inputs.background, &gradients)),
    ] {
        let name = format!("{prefix}_grad_{name}");
        checks.close(&name, archive.array(&name)?, &found, allowances.gradients);
    }
    // The probe's gradient is in normalised device coordinates: half a picture's side is one.
    let [_, _, height, width] = pictures[0].packed.dims();
    let half = [width as f64 / 2.0, height as f64 / 2.0];
    let found = leaves.probes.iter().flat_map(|probe| gradient_of_centres(probe, &gradients, half)).collect();
    let name = format!("{prefix}_grad_means2d");
    let expected = archive.array(&name)?;
    checks.close(&name, expected, &Array::new(expected.shape.clone(), found), allowances.gradients);
    Ok(())
}

/// The statistic of a probe with respect to pixel positions.
fn gradient_of_centres(probe: &Tensor<2>, gradients: &burn::tensor::Gradients, half: [f64; 2]) -> Vec<f64> {
    let per_device_unit = gradient(probe, gradients).values;
    per_device_unit.iter().enumerate().map(|(i, v)| v / half[i % 2]).collect()
}

/// What projection makes of each Gaussian that is not culled.
fn compare_projections(
    checks: &mut Checklist,
    archive: &Archive,
    inputs: &SplatInputs,
    cameras: &[Camera],
    settings: &SplatSettings,
    allowances: &Allowances,
) -> Result<()> {
    for (index, camera) in cameras.iter().enumerate() {
        let found = diagnose(inputs, camera, settings)?;
        let radii = archive.array("radii")?.row(index);
        let expected: Vec<[i32; 2]> = radii.values.chunks_exact(2).map(|r| [r[0] as i32, r[1] as i32]).collect();
        checks.same(format!("radii, camera {index}"), &expected, &found.radii);
        let visible = |row: usize| expected[row] != [0, 0];
        let flat = |rows: Vec<Vec<f64>>| {
            let columns = rows.first().map_or(0, Vec::len);
            Array::new([rows.len(), columns], rows.concat())
        };
        for (name, found) in [
            ("means2d", flat(found.means2d.iter().map(|v| v.to_vec()).collect())),
            ("depths", flat(found.depths.iter().map(|&v| vec![v]).collect())),
            ("conics", flat(found.conics.iter().map(|v| v.to_vec()).collect())),
            ("colors", flat(found.colours.iter().map(|v| v.to_vec()).collect())),
        ] {
            let columns = found.shape[1];
            let mut expected = archive.array(name)?.row(index).reshaped(found.shape.clone());
            // Culled rows hold nothing of meaning, and must not set the scale of the others.
            let culled = |flat: usize| !visible(flat / columns);
            expected.values.iter_mut().enumerate().for_each(|(i, v)| *v = if culled(i) { 0.0 } else { *v });
            let name = format!("{name}, camera {index}");
            checks.close_where(name, &expected, &found, allowances.projections, |flat| !culled(flat));
        }
    }
    Ok(())
}
