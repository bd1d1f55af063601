//! `deform` and `deform_4dgs`: the deformation network with given weights, and what it makes of the Gaussians.

use anyhow::{Context, Result};
use burn::module::Param;
use burn::nn::Linear;
use burn::tensor::{DType, Device, Gradients, Tensor};
use mvfusion_model::model::gaussians::{Attribute, Gaussians};
use mvfusion_model::model::mask::MaskChannel;
use mvfusion_model::model::network::{AttributeHeads, DeformationNetwork, MaskHeads, Mlp, Offsets};
use mvfusion_tests::{Array, Checklist, Tolerance, gradient, tensor};

use crate::archive::Archive;
use crate::composition::mask_pictures;
use crate::hexplane::{compare_planes, field};
use crate::variants::direct_in_file_order;

/// From the README of the oracle.
const TOLERANCE: Tolerance = Tolerance::of_largest(5e-5).plus(1e-6);

/// Colour coefficients that our Gaussians have; the files have eight dead ones and one for the masks more.
const COEFFICIENTS: usize = 16;

/// The coefficient of the files that holds the mask logits.
const MASK_COEFFICIENT: usize = 24;

/// Outputs of these kinds that are not compared.
pub const LEFT_OUT: &[(&str, &str)] = &[
    ("out.act.scale", "activated inside the splat op"),
    ("out.act.rotation", "activated inside the splat op"),
    ("out.act.opacity", "activated inside the splat op"),
];

/// The layer of a name, with weights `[out, in]` in the file and `[in, out]` in ours.
pub fn linear(archive: &Archive, name: &str, device: &Device) -> Result<Linear> {
    let weight = archive.array(&format!("in.w.{name}.weight"))?.transposed();
    let bias = archive.array(&format!("in.w.{name}.bias"))?;
    let shape = [weight.shape[0], weight.shape[1]];
    Ok(Linear {
        weight: Param::from_tensor(tensor(&weight.values, shape, device, DType::F32)),
        bias: Some(Param::from_tensor(tensor(&bias.values, [bias.values.len()], device, DType::F32))),
    })
}

/// The layers of the given names, one after another.
pub fn mlp(archive: &Archive, names: &[&str], device: &Device) -> Result<Mlp> {
    let layers: Result<_> = names.iter().map(|name| linear(archive, name, device)).collect();
    Ok(Mlp::rectified(layers?))
}

/// A file's network; with mask heads if the file has them.
pub fn deformation(archive: &Archive, device: &Device) -> Result<DeformationNetwork> {
    let head = |name: &str| mlp(archive, &[&format!("{name}.l1"), &format!("{name}.l2")], device);
    let mask =
        |name: &str| mlp(archive, &[&format!("{name}.l1"), &format!("{name}.l2"), &format!("{name}.l3")], device);
    let trunk: &[&str] = if archive.has("in.w.trunk2.weight") { &["trunk", "trunk2"] } else { &["trunk"] };
    let masks = match archive.has("in.w.mask_dynamic.l1.weight") {
        false => None,
        true => Some(MaskHeads {
            static_: mask("mask_static")?,
            brightness: mask("mask_bright")?,
            dynamic: mask("mask_dynamic")?,
        }),
    };
    Ok(DeformationNetwork {
        grid: field(archive, device)?,
        trunk: mlp(archive, trunk, device)?,
        heads: AttributeHeads {
            means: head("pos")?,
            log_scales: head("scale")?,
            quaternions: head("rot")?,
            opacity_logits: Some(head("opacity")?),
            sh: Some(head("sh")?),
        },
        masks,
    })
}

/// Every layer of a network under its name in the files.
pub fn layers(network: &DeformationNetwork) -> Vec<(String, &Linear)> {
    let heads = &network.heads;
    let mut chains = vec![("pos", &heads.means), ("scale", &heads.log_scales), ("rot", &heads.quaternions)];
    chains.extend(heads.opacity_logits.as_ref().map(|head| ("opacity", head)));
    chains.extend(heads.sh.as_ref().map(|head| ("sh", head)));
    if let Some(masks) = &network.masks {
        chains.extend([
            ("mask_static", &masks.static_),
            ("mask_bright", &masks.brightness),
            ("mask_dynamic", &masks.dynamic),
        ]);
    }
    let trunk = network.trunk.layers.iter().zip(["trunk", "trunk2"]).map(|(layer, name)| (name.to_owned(), layer));
    trunk.chain(chains.into_iter().flat_map(|(name, chain)| chain_layers(name, chain))).collect()
}

/// The layers `name.l1`, `name.l2`, … of a chain.
pub fn chain_layers<'a>(name: &str, chain: &'a Mlp) -> Vec<(String, &'a Linear)> {
    chain.layers.iter().enumerate().map(|(i, layer)| (format!("{name}.l{}", i + 1), layer)).collect()
}

/// The gradients of a layer, shaped as in the files: weight, bias.
pub fn layer_gradients(layer: &Linear, gradients: &Gradients) -> [Array; 2] {
    let bias = layer.bias.as_ref().map_or_else(Array::default, |bias| gradient(&bias.val(), gradients));
    [gradient(&layer.weight.val(), gradients).transposed(), bias]
}

/// Compares the gradients of those layers that are stored under `prefix`.
pub fn compare_layers(
    checks: &mut Checklist,
    archive: &Archive,
    prefix: &str,
    layers: &[(String, &Linear)],
    gradients: &Gradients,
    tolerance: Tolerance,
) {
    for (name, layer) in layers {
        let [mut weight, bias] = layer_gradients(layer, gradients);
        if let Some(gradient) = layer.weight.val().grad(gradients).filter(|_| name == "direct.l1") {
            weight = Array::of(direct_in_file_order(gradient).transpose());
        }
        for (part, found) in [("weight", weight), ("bias", bias)] {
            let name = format!("{prefix}{name}.{part}");
            if let Some(expected) = archive.find(&name) {
                checks.close(&name, expected, &found, tolerance);
            }
        }
    }
}

/// All offsets in the order of the files: centre, log-scale, quaternion, opacity, colour, then mask logits dynamic,
/// bright, static. `[N, 62]`, or `[N, 59]` without masks.
pub fn in_file_order(offsets: Offsets) -> Tensor<2> {
    let mut columns = vec![offsets.means(), offsets.log_scales(), offsets.quaternions()];
    columns.extend(offsets.opacity_logits().into_iter().chain(offsets.sh()));
    if let Some(masks) = offsets.mask_logits() {
        let order = [MaskChannel::Dynamic, MaskChannel::Brightness, MaskChannel::Static];
        columns.extend(order.map(|channel| channel.of(&masks)));
    }
    Tensor::cat(columns, 1)
}

/// A file's Gaussians.
fn gaussians(archive: &Archive, device: &Device) -> Result<Gaussians> {
    let shs = archive.array("in.shs")?;
    let (count, coefficients) = (shs.shape[0], shs.shape[1]);
    let made = |values: &Array| {
        let columns = values.values.len() / count;
        Some(tensor(&values.values, [count, columns], device, DType::F32))
    };
    let stored = |name: &str| archive.find(name).and_then(made);
    let gaussians = Gaussians::from_tensors(|attribute| match attribute {
        Attribute::Means => stored("in.xyz"),
        Attribute::ShDc => made(&shs.columns(0, 1)),
        Attribute::ShRest => made(&shs.columns(1, COEFFICIENTS)),
        Attribute::OpacityLogits => stored("in.opacity"),
        Attribute::LogScales => stored("in.scaling"),
        Attribute::Quaternions => stored("in.rotation"),
        Attribute::MaskLogits if coefficients <= MASK_COEFFICIENT => None,
        Attribute::MaskLogits => made(&shs.columns(MASK_COEFFICIENT, MASK_COEFFICIENT + 1)),
        Attribute::TimeCentres | Attribute::LogDurations | Attribute::Velocities => None,
    });
    anyhow::Context::context(gaussians, "the file lacks an attribute of the Gaussians")
}

/// Deformed Gaussians, heads and all gradients.
pub fn check(archive: &Archive, device: &Device) -> Result<()> {
    let device = device.clone().autodiff();
    let network = deformation(archive, &device)?;
    let gaussians = gaussians(archive, &device)?;
    let canonical = gaussians.canonical();
    let times = archive.tensor::<2>("in.t", &device)?;
    let feature = network.feature(canonical.means.clone(), times.clone());
    let offsets = network.decode(feature.clone());

    let mut checks = Checklist::default();
    let mut compare = |name: &str, found: Array| {
        if let Some(expected) = archive.find(name) {
            checks.close(name, expected, &found.reshaped(expected.shape.clone()), TOLERANCE);
        }
    };
    compare("out.feat", Array::of(network.grid.forward(canonical.means.clone(), times)));
    compare("out.hidden", Array::of(feature));
    compare("out.head.pos", Array::of(offsets.means()));
    compare("out.head.scale", Array::of(offsets.log_scales()));
    compare("out.head.rot", Array::of(offsets.quaternions()));
    for (name, offsets) in [("out.head.opacity", offsets.opacity_logits()), ("out.head.sh", offsets.sh())] {
        let offsets = offsets.with_context(|| format!("the network has no head for {name}"))?;
        compare(name, Array::of(offsets));
    }
    if let Some(masks) = &offsets.mask_logits() {
        for (channel, name) in MaskChannel::ALL.into_iter().zip(["static", "bright", "dynamic"]) {
            compare(&format!("out.head.mask_{name}"), Array::of(channel.of(masks)));
        }
    }

    let deformed = canonical.deformed(offsets);
    compare("out.xyz", Array::of(deformed.means.clone()));
    compare("out.scaling", Array::of(deformed.log_scales.clone()));
    compare("out.rotation", Array::of(deformed.quaternions.clone()));
    compare("out.opacity", Array::of(deformed.opacity_logits.clone()));
    if let Some(features) = deformed.mask_features() {
        compare("out.act.mask_colour", Array::of(mask_pictures(features)));
    }
    if let Some(probability) = deformed.foreground_probability() {
        compare("out.act.fg_prob", Array::of(probability));
    }
    let shs = archive.array("out.shs")?;
    checks.close("shs", &shs.columns(0, COEFFICIENTS), &Array::of(deformed.sh.clone()), TOLERANCE);
    if let Some(masks) = &deformed.mask_logits {
        let expected = shs.columns(MASK_COEFFICIENT, MASK_COEFFICIENT + 1).reshaped(masks.dims());
        checks.close("shs of the masks", &expected, &Array::of(masks.clone()), TOLERANCE);
    }

    let cot = |name: &str| archive.tensor::<2>(&format!("in.cot.{name}"), &device);
    let cot_shs = archive.tensor::<3>("in.cot.shs", &device)?;
    let mut loss = (deformed.means * cot("xyz")?).sum()
        + (deformed.log_scales * cot("scaling")?).sum()
        + (deformed.quaternions * cot("rotation")?).sum()
        + (deformed.opacity_logits * cot("opacity")?).sum()
        + (deformed.sh * cot_shs.clone().narrow(1, 0, COEFFICIENTS)).sum();
    if let Some(masks) = deformed.mask_logits {
        loss = loss + (masks * cot_shs.narrow(1, MASK_COEFFICIENT, 1).squeeze_dim(1)).sum();
    }
    let gradients = loss.backward();
    if let Some(expected) = archive.find("out.loss") {
        // The dead coefficients are not ours; in the file's loss they are a constant.
        let (values, cots) = (archive.array("in.shs")?, archive.array("in.cot.shs")?);
        let dead = |array: &Array| array.columns(COEFFICIENTS, MASK_COEFFICIENT).values;
        let constant: f64 = dead(values).iter().zip(dead(cots)).map(|(v, c)| v * c).sum();
        let found = Array::new([], vec![Array::of(loss).values[0] + constant]);
        checks.close("loss", expected, &found, TOLERANCE);
    }
    compare_gradients(&mut checks, archive, &gaussians, &gradients)?;
    compare_layers(&mut checks, archive, "out.grad.w.", &layers(&network), &gradients, TOLERANCE);
    let planes = gradient(&network.grid.planes.val(), &gradients);
    compare_planes(&mut checks, archive, "out.grad.", &planes, network.grid.layout(), TOLERANCE);
    checks.finish()
}

/// Compares the gradients of the Gaussians themselves.
fn compare_gradients(
    checks: &mut Checklist,
    archive: &Archive,
    gaussians: &Gaussians,
    gradients: &Gradients,
) -> Result<()> {
    for (name, parameter) in [
        ("out.grad.xyz", &gaussians.means),
        ("out.grad.scaling", &gaussians.log_scales),
        ("out.grad.rotation", &gaussians.quaternions),
        ("out.grad.opacity", &gaussians.opacity_logits),
    ] {
        checks.close(name, archive.array(name)?, &gradient(&parameter.val(), gradients), TOLERANCE);
    }
    let shs = archive.array("out.grad.shs")?;
    let flat = |begin, end| {
        let part = shs.columns(begin, end);
        let columns = part.values.len() / shs.shape[0];
        part.reshaped([shs.shape[0], columns])
    };
    let found = |parameter: &Param<Tensor<2>>| gradient(&parameter.val(), gradients);
    checks.close("grad.shs, constant", &flat(0, 1), &found(&gaussians.sh_dc), TOLERANCE);
    checks.close("grad.shs, higher", &flat(1, COEFFICIENTS), &found(&gaussians.sh_rest), TOLERANCE);
    if let Some(masks) = &gaussians.mask_logits {
        checks.close("grad.shs, masks", &flat(MASK_COEFFICIENT, MASK_COEFFICIENT + 1), &found(masks), TOLERANCE);
    }
    Ok(())
}
