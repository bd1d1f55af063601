//! The motion modules of a `motion_forward` file, in every variant that it has.

use anyhow::{Result, bail};
use burn::module::Param;
use burn::nn::Linear;
use burn::tensor::{DType, Device, Gradients, Tensor};
use mvfusion_model::config::{Descriptor, MotionConfig, Refinement, Temporal, TokenMode};
use mvfusion_model::model::motion::{
    DirectEncoder, Guidance, MotionEncoder, MotionRefinement, RefinementRules, TemporalAttention, TemporalAverage,
    TemporalConvolution, TemporalModule,
};
use mvfusion_model::model::network::Mlp;
use mvfusion_tests::{Array, Checklist, Tolerance, tensor};

use crate::archive::Archive;
use crate::network::{chain_layers, layer_gradients, linear, mlp};

/// Turns the switches of a variant.
pub type Switch = fn(&mut MotionConfig);

/// The variants by their names in the files.
pub const VARIANTS: [(&str, Switch); 10] = [
    ("cross", |_| ()),
    ("self", |config| config.temporal = Temporal::SelfAttention),
    ("average", |config| config.temporal = Temporal::Average),
    ("conv", |config| config.temporal = Temporal::Convolution),
    ("direct", |config| config.descriptor = Descriptor::Offsets),
    ("cross_include_self", |config| config.include_self = true),
    ("sum", |config| config.refinement = Refinement::Sum),
    ("no_mvg", |config| config.mvg = false),
    ("no_mfta", |config| config.mfta = false),
    ("full_window", |config| config.tokens = TokenMode::FullWindow),
];

/// The modules that the switches ask for, with a file's weights.
pub fn refinement(archive: &Archive, config: &MotionConfig, device: &Device) -> Result<MotionRefinement> {
    let chain = |name: &str| mlp(archive, &[&format!("{name}.l1"), &format!("{name}.l2")], device);
    let layer = |name: &str| linear(archive, name, device);
    let guidance = || -> Result<Guidance> {
        Ok(match config.descriptor {
            Descriptor::Offsets => Guidance::Direct(DirectEncoder { mlp: direct(chain("direct")?) }),
            _ => Guidance::Encoder(MotionEncoder::from_layers(chain("mvg")?, config.octaves)),
        })
    };
    let attention = || -> Result<TemporalAttention> {
        let (query, key, value) = (layer("mfta.q")?, layer("mfta.k")?, layer("mfta.v")?);
        Ok(TemporalAttention::from_layers(query, key, value, chain("mfta")?, config))
    };
    let temporal = || -> Result<TemporalModule> {
        Ok(match config.temporal {
            Temporal::Cross => TemporalModule::Attention(attention()?),
            Temporal::SelfAttention => TemporalModule::SelfAttention(attention()?),
            Temporal::Spatial => bail!("the files have no attention in space"),
            Temporal::Average => TemporalModule::Average(TemporalAverage { mlp: chain("avg")? }),
            Temporal::Convolution => {
                TemporalModule::Convolution(TemporalConvolution { taps: taps(archive, device)?, mlp: chain("mfta")? })
            }
        })
    };
    Ok(MotionRefinement {
        guidance: config.mvg.then(guidance).transpose()?,
        temporal: config.mfta.then(temporal).transpose()?,
        rules: RefinementRules::new(config),
    })
}

/// The perceptron that reads offsets, whose first weight has a row for each. Those of the masks are the last three rows:
/// dynamic, brightness, static in the files, in the order of `MaskChannel` here.
fn direct(mut chain: Mlp) -> Mlp {
    let first = &mut chain.layers[0].weight;
    *first = Param::from_tensor(Tensor::from_inner(with_last_rows(first.val().inner(), [2, 1, 0])));
    chain
}

/// A gradient of that weight, `[inputs, outputs]`, as the files have it.
pub fn direct_in_file_order(gradient: Tensor<2>) -> Tensor<2> {
    with_last_rows(gradient, [2, 1, 0])
}

/// The last three rows in another order.
fn with_last_rows(rows: Tensor<2>, order: [usize; 3]) -> Tensor<2> {
    let first = rows.dims()[0] - order.len();
    let last = order.map(|row| rows.clone().narrow(0, first + row, 1));
    Tensor::cat([vec![rows.narrow(0, 0, first)], last.to_vec()].concat(), 0)
}

/// Every layer under its name in the files, but for the convolution, whose weight has three axes there.
pub fn layers(refinement: &MotionRefinement) -> Vec<(String, &Linear)> {
    let mut all = match &refinement.guidance {
        Some(Guidance::Encoder(encoder)) => chain_layers("mvg", &encoder.mlp),
        Some(Guidance::Direct(encoder)) => chain_layers("direct", &encoder.mlp),
        None => Vec::new(),
    };
    match &refinement.temporal {
        Some(
            TemporalModule::Attention(attention)
            | TemporalModule::SelfAttention(attention)
            | TemporalModule::Spatial(attention),
        ) => {
            let projections = [("q", &attention.query), ("k", &attention.key), ("v", &attention.value)];
            all.extend(projections.map(|(name, layer)| (format!("mfta.{name}"), layer)));
            all.extend(chain_layers("mfta", &attention.mlp));
        }
        Some(TemporalModule::Average(average)) => all.extend(chain_layers("avg", &average.mlp)),
        Some(TemporalModule::Convolution(convolution)) => all.extend(chain_layers("mfta", &convolution.mlp)),
        None => (),
    }
    all
}

/// The convolution as the linear layer of the tokens side by side.
fn taps(archive: &Archive, device: &Device) -> Result<Linear> {
    let weight = by_tap(archive.array("in.w.conv.weight")?);
    let bias = archive.array("in.w.conv.bias")?;
    let shape = [weight.shape[0], weight.shape[1]];
    Ok(Linear {
        weight: Param::from_tensor(tensor(&weight.values, shape, device, DType::F32)),
        bias: Some(Param::from_tensor(tensor(&bias.values, [shape[1]], device, DType::F32))),
    })
}

/// The weight of a convolution, `[out, in, taps]` in the files, as `[taps * in, out]`.
fn by_tap(weight: &Array) -> Array {
    let [outputs, inputs, taps] = weight.shape[..] else { panic!("a convolution's weight has three axes") };
    let at = |tap: usize, input: usize, output: usize| weight.values[(output * inputs + input) * taps + tap];
    let rows = (0..taps).flat_map(|tap| (0..inputs).map(move |input| (tap, input)));
    let values = rows.flat_map(|(tap, input)| (0..outputs).map(move |output| at(tap, input, output))).collect();
    Array::new([taps * inputs, outputs], values)
}

/// Compares the gradients of a convolution.
pub fn compare_taps(
    checks: &mut Checklist,
    archive: &Archive,
    prefix: &str,
    refinement: &MotionRefinement,
    gradients: &Gradients,
    tolerance: Tolerance,
) -> Result<()> {
    let Some(TemporalModule::Convolution(convolution)) = &refinement.temporal else { return Ok(()) };
    let [weight, bias] = layer_gradients(&convolution.taps, gradients);
    let [weight_name, bias_name] = ["weight", "bias"].map(|part| format!("{prefix}conv.{part}"));
    checks.close(&weight_name, &by_tap(archive.array(&weight_name)?), &weight.transposed(), tolerance);
    checks.close(&bias_name, archive.array(&bias_name)?, &bias, tolerance);
    Ok(())
}
