//! `motion_forward`: the refined forward pass, its ablations, and its gradients.

use anyhow::{Context, Result, bail};
use burn::module::Param;
use burn::nn::Linear;
use burn::tensor::{DType, Device, Gradients, Tensor};
use mvfusion_model::config::MotionConfig;
use mvfusion_model::model::motion::{
    Encoding, Guidance, MomentRows, MotionCache, MotionEncoder, MotionRefinement, RefinementConfig, Substitutes,
    TemporalModule, Tokens,
};
use mvfusion_model::model::network::{DeformationNetwork, Mlp, zero_last_layer};
use mvfusion_model::timeline::Timeline;
use mvfusion_tests::{Array, Checklist, Tolerance, gradient, numbers, tensor};

use crate::archive::Archive;
use crate::hexplane::compare_planes;
use crate::network::{compare_layers, deformation, in_file_order, layer_gradients, layers};
use crate::variants::{self, Switch, VARIANTS, compare_taps, refinement};

/// From the README of the oracle.
const TOLERANCE: Tolerance = Tolerance::of_largest(1e-4).plus(1e-6);

/// The loss is a sum with cancellation: times the sum of its terms' magnitudes.
const LOSS: f64 = 1e-6;

/// The gradient of the key's bias is zero but for rounding: times the largest gradient of the key's weight.
const KEY_BIAS: f64 = 1e-5;

/// Outputs that are not compared.
pub const LEFT_OUT: &[(&str, &str)] = &[(".attn", "the weights inside the attention; its output is compared")];

/// A file's modules and settings.
struct Setting {
    network: DeformationNetwork,
    refinement: MotionRefinement,
    cache: MotionCache,
    timeline: Timeline,
    motion: MotionConfig,
    extent: f64,
    means: Param<Tensor<2>>,
    cotangent: Tensor<2>,
}

impl Setting {
    fn read(archive: &Archive, switch: Switch, device: &Device) -> Result<Self> {
        let plain = device;
        let device = device.clone().autodiff();
        let mut motion = MotionConfig {
            window: archive.count("in.w")?,
            heads: archive.count("in.heads")?,
            // A chunk that does not divide the number of Gaussians.
            chunk: 5,
            ..MotionConfig::default()
        };
        switch(&mut motion);
        let signatures = archive.tensor::<2>("in.V_norm", plain)?;
        let intensity = Tensor::zeros([signatures.dims()[0], 1], plain);
        Ok(Self {
            network: deformation(archive, &device)?,
            refinement: refinement(archive, &motion, &device)?,
            cache: MotionCache {
                signatures,
                local: archive.tensor("in.e_norm", plain)?,
                velocities: None,
                near: None,
                intensity,
                knot_times: archive.array("in.knot_times")?.values.clone(),
                inherits: true,
                includes_travel: false,
                encoding: Encoding::default(),
            },
            timeline: Timeline::new(archive.array("in.train_times")?.values.clone()),
            motion,
            extent: archive.number("in.ext")?,
            means: Param::from_tensor(archive.tensor("in.xyz", &device)?),
            cotangent: archive.tensor("in.cot", plain)?,
        })
    }

    /// The refined offsets `[N, 62]` at a time.
    fn delta(&self, time: f64) -> Tensor<2> {
        self.deltas(&[time])
    }

    /// The refined offsets at several times, one after the other, computed together.
    fn deltas(&self, times: &[f64]) -> Tensor<2> {
        let moments: Vec<_> = times.iter().map(|&time| MomentRows { time, cache: &self.cache }).collect();
        let config = RefinementConfig {
            timeline: &self.timeline,
            moments: &moments,
            extent: self.extent,
            substitutes: &Substitutes::default(),
        };
        let means = Tensor::cat(vec![self.means.val(); times.len()], 0);
        in_file_order(self.refinement.offsets(&self.network, means, &config))
    }

    /// The hidden feature at a time.
    fn feature(&self, time: f64) -> Tensor<2> {
        let means = self.means.val();
        let time = tensor(&[time], [1, 1], &means.device().inner(), DType::F32);
        self.network.feature(means, time)
    }

    /// The token of a time, put together by the definition.
    fn token(&self, time: f64) -> Tensor<2> {
        let feature = self.feature(time);
        let offsets = self.network.decode(feature.clone());
        let local = self.cache.local_at(time);
        let geometry = [offsets.means() / self.extent, offsets.log_scales(), offsets.quaternions()];
        Tensor::cat([vec![feature], geometry.into(), vec![local]].concat(), 1).inner()
    }

    /// Every layer under its name in the files, but for a convolution.
    fn layers(&self) -> Vec<(String, &Linear)> {
        [layers(&self.network), variants::layers(&self.refinement)].concat()
    }
}

/// All variants at all times of a file.
pub fn check(archive: &Archive, device: &Device) -> Result<()> {
    let times = &archive.array("in.query_times")?.values;
    let mut checks = Checklist::default();
    for (variant, switch) in VARIANTS {
        let setting = Setting::read(archive, switch, device)?;
        // As in a step of several views.
        let together = setting.deltas(times).chunk(times.len(), 0);
        for ((query, &time), delta) in times.iter().enumerate().zip(together) {
            let prefix = format!("out.{variant}.q{query}.");
            let Some(expected) = archive.find(&format!("{prefix}delta")) else { continue };
            checks.close(format!("{prefix}delta alone"), expected, &Array::of(setting.delta(time)), TOLERANCE);
            checks.close(format!("{prefix}delta"), expected, &Array::of(delta.clone()), TOLERANCE);
            if archive.has(&format!("{prefix}loss")) {
                check_gradients(&mut checks, archive, &setting, delta, &prefix)?;
            }
            check_parts(&mut checks, archive, &setting, time, &prefix)?;
        }
    }
    let differentiated = (0..times.len()).find(|query| archive.has(&format!("out.cross.q{query}.loss")));
    let query = differentiated.context("the file has no gradients")?;
    check_zero_start(&mut checks, archive, Setting::read(archive, |_| (), device)?, times[query])?;
    checks.finish()
}

/// The loss and all gradients that are stored.
fn check_gradients(
    checks: &mut Checklist,
    archive: &Archive,
    setting: &Setting,
    delta: Tensor<2>,
    prefix: &str,
) -> Result<()> {
    let terms = delta * setting.cotangent.clone();
    let magnitude = numbers(terms.clone().abs().sum())[0];
    let loss = terms.sum();
    let gradients = loss.backward();
    let key = format!("{prefix}loss");
    checks.close_number(&key, archive.number(&key)?, numbers(loss)[0], Tolerance::absolute(LOSS * magnitude));

    let prefix = format!("{prefix}grad.");
    let key = format!("{prefix}xyz");
    checks.close(&key, archive.array(&key)?, &gradient(&setting.means.val(), &gradients), TOLERANCE);
    let (key_layers, others): (Vec<_>, Vec<_>) = setting.layers().into_iter().partition(|(name, _)| name == "mfta.k");
    compare_layers(checks, archive, &prefix, &others, &gradients, TOLERANCE);
    if let [(_, key)] = key_layers[..] {
        compare_key(checks, archive, &prefix, key, &gradients);
    }
    compare_taps(checks, archive, &prefix, &setting.refinement, &gradients, TOLERANCE)?;
    let planes = gradient(&setting.network.grid.planes.val(), &gradients);
    compare_planes(checks, archive, &prefix, &planes, setting.network.grid.layout(), TOLERANCE);
    Ok(())
}

/// The key layer's gradients, whose bias has a tolerance of its own.
fn compare_key(checks: &mut Checklist, archive: &Archive, prefix: &str, layer: &Linear, gradients: &Gradients) {
    let [weight, bias] = layer_gradients(layer, gradients);
    // Not stored for a variant whose own layers are others.
    let Some(expected) = archive.find(&format!("{prefix}mfta.k.weight")) else { return };
    checks.close(format!("{prefix}mfta.k.weight"), expected, &weight, TOLERANCE);
    let tolerance = Tolerance::absolute(KEY_BIAS * expected.largest());
    let key = format!("{prefix}mfta.k.bias");
    let zeros = bias.zeros_like();
    checks.close(&key, archive.find(&key).unwrap_or(&zeros), &bias, tolerance);
}

/// What the refined feature is made of, as far as it is stored.
fn check_parts(checks: &mut Checklist, archive: &Archive, setting: &Setting, time: f64, prefix: &str) -> Result<()> {
    let index = setting.timeline.nearest(time);
    let window = setting.motion.window as isize;
    let neighbours = [-window, window].map(|offset| setting.timeline.neighbour(index, offset));
    if archive.has(&format!("{prefix}index")) {
        checks.same(format!("{prefix}index"), &[archive.count(&format!("{prefix}index"))?], &[index]);
        let expected = archive.counts(&format!("{prefix}neighbour_index"))?;
        let expected: Vec<f64> = expected.into_iter().map(|index| setting.timeline.times()[index]).collect();
        checks.same(format!("{prefix}neighbour_index"), &expected, &neighbours);
    }

    let mut compare = |name: &str, found: Tensor<2>| {
        let key = format!("{prefix}{name}");
        if let Some(expected) = archive.find(&key) {
            checks.close(&key, expected, &Array::of(found), TOLERANCE);
        }
    };
    let (signatures, local) = (setting.cache.signatures.clone(), setting.cache.local_at(time));
    compare("e", local.clone());
    // An encoder without layers shows the encoding itself.
    let encoding = MotionEncoder::from_layers(Mlp::rectified(Vec::new()), setting.motion.octaves);
    compare("posenc", encoding.forward(signatures, local));

    let feature = setting.feature(time);
    compare("h", feature.clone());
    compare("base", in_file_order(setting.network.decode(feature.clone())));
    if let Some(guidance) = &setting.refinement.guidance {
        compare("h_mvg", guidance.forward(&setting.network, &feature, &[MomentRows { time, cache: &setting.cache }]));
    }
    let centre = setting.token(time);
    let around = neighbours.map(|time| setting.token(time));
    compare("z_center", centre.clone());
    compare("z_prev", around[0].clone());
    compare("z_next", around[1].clone());
    if let Some(temporal) = &setting.refinement.temporal {
        let tokens = Tokens::new(centre, Tensor::stack(around.to_vec(), 1));
        compare("attn_out", temporal.mix(tokens.clone()));
        compare("h_mfta", temporal.forward(tokens));
    }
    Ok(())
}

/// With zeros in the last layers the refined offsets are the base offsets, bit for bit, and only those layers learn.
fn check_zero_start(checks: &mut Checklist, archive: &Archive, mut setting: Setting, time: f64) -> Result<()> {
    let MotionRefinement { guidance, temporal, .. } = &mut setting.refinement;
    let (Some(Guidance::Encoder(encoder)), Some(TemporalModule::Attention(attention))) = (guidance, temporal) else {
        bail!("the default is not the paper's model");
    };
    for mlp in [&mut encoder.mlp, &mut attention.mlp] {
        *mlp = zero_last_layer(mlp.clone());
    }
    let delta = setting.delta(time);
    let base = in_file_order(setting.network.decode(setting.feature(time)));
    let found = Array::of(delta.clone());
    checks.same("zeroinit, against the base", &Array::of(base).values, &found.values);
    checks.close("zeroinit.delta", archive.array("out.zeroinit.delta")?, &found, TOLERANCE);

    let gradients = (delta * setting.cotangent.clone()).sum().backward();
    let prefix = "out.zeroinit.grad.";
    let key = format!("{prefix}xyz");
    checks.close(&key, archive.array(&key)?, &gradient(&setting.means.val(), &gradients), TOLERANCE);
    let layers = setting.layers();
    compare_layers(checks, archive, prefix, &layers, &gradients, TOLERANCE);
    let is_last = |name: &str| ["mvg.l2", "mfta.l2"].contains(&name);
    let is_new = |name: &str| name.starts_with("mvg.") || name.starts_with("mfta.");
    for (name, layer) in layers.iter().filter(|(name, _)| is_new(name) && !is_last(name)) {
        for found in layer_gradients(layer, &gradients) {
            checks.close(format!("zeroinit, {name}"), &found.zeros_like(), &found, Tolerance::absolute(0.0));
        }
    }
    Ok(())
}
