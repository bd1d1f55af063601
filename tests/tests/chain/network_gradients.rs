//! The chain HexPlane, trunk, heads, deformed Gaussians, splat against finite differences: every parameter in it.

use burn::module::Param;
use burn::nn::Linear;
use burn::tensor::{DType, Device, Tensor};
use mvfusion_data::Camera;
use mvfusion_model::model::gaussians::{Attribute, BackgroundLevels, Gaussians, RawGaussians};
use mvfusion_model::model::network::{
    AttributeHeads, DeformationConfig, DeformationNetwork, HeadChoice, HexPlane, MaskHeads, Mlp, ModuleInit,
};
use mvfusion_model::random::Stream;
use mvfusion_render::grid::{GridBounds, GridLayout};
use mvfusion_render::splat::{SplatInputs, SplatRules, SplatSettings};
use mvfusion_tests::{Array, backends, gradient, numbers, tensor};

use crate::differences::{Values, compare};
use crate::margins::keep_off_thresholds;
use crate::splat_gradients::{camera, draw, point_before};

/// Gaussians of the scene.
const COUNT: usize = 24;

/// The moment that is rendered, between the rows of the time planes.
const TIME: f64 = 0.37;

/// Channels of the picture: colour, three masks, alpha, depth.
const CHANNELS: usize = 8;

/// The masks among them.
const MASKS: std::ops::Range<usize> = 3..6;

/// Width of the network.
const WIDTH: usize = 8;

fn layout() -> GridLayout {
    GridLayout { features: 2, resolution: [4, 5, 4, 6], multipliers: vec![1, 2] }
}

/// A box around the scene, some of whose points lie outside.
fn bounds() -> GridBounds {
    GridBounds { min: [-1.6, -1.4, 0.2], max: [2.0, 1.5, 4.5] }
}

/// A network and Gaussians made of the same numbers.
struct Parts {
    network: DeformationNetwork,
    gaussians: Gaussians,
}

impl Parts {
    /// The parts made of `values`.
    fn new(values: &Values, device: &Device) -> Self {
        let chain = |name: &str, layers: usize| {
            let layers = (1..=layers).map(|layer| Linear {
                weight: parameter(values, &format!("{name}.{layer}.weight"), device),
                bias: Some(parameter(values, &format!("{name}.{layer}.bias"), device)),
            });
            Mlp::rectified(layers.collect())
        };
        let network = DeformationNetwork {
            grid: HexPlane::from_planes(parameter(values, "planes", device), layout(), bounds()),
            trunk: chain("trunk", 1),
            heads: AttributeHeads {
                means: chain("head means", 2),
                log_scales: chain("head log_scales", 2),
                quaternions: chain("head quaternions", 2),
                opacity_logits: Some(chain("head opacity", 2)),
                sh: Some(chain("head sh", 2)),
            },
            masks: Some(MaskHeads {
                static_: chain("mask static", 3),
                brightness: chain("mask brightness", 3),
                dynamic: chain("mask dynamic", 3),
            }),
        };
        let given = |attribute: Attribute| values.contains_key(attribute.name());
        let gaussians = Gaussians::from_tensors(|attribute| {
            given(attribute).then(|| parameter(values, attribute.name(), device).val())
        })
        .expect("all attributes but lifetimes are given");
        Self { network, gaussians }
    }

    /// The chains of layers by the names used above.
    fn chains(network: &DeformationNetwork) -> Vec<(&'static str, &Mlp)> {
        let heads = &network.heads;
        let masks = network.masks.as_ref().expect("this network has mask heads");
        let opacity = heads.opacity_logits.as_ref().expect("this network has every head");
        let sh = heads.sh.as_ref().expect("this network has every head");
        vec![
            ("trunk", &network.trunk),
            ("head means", &heads.means),
            ("head log_scales", &heads.log_scales),
            ("head quaternions", &heads.quaternions),
            ("head opacity", opacity),
            ("head sh", sh),
            ("mask static", &masks.static_),
            ("mask brightness", &masks.brightness),
            ("mask dynamic", &masks.dynamic),
        ]
    }

    /// The network's parameters by name, each after a function.
    fn of_network(
        network: &DeformationNetwork,
        matrix: impl Fn(Tensor<2>) -> Array,
        vector: impl Fn(Tensor<1>) -> Array,
    ) -> Values {
        let mut values = Values::from([("planes".to_owned(), matrix(network.grid.planes.val()))]);
        for (name, chain) in Self::chains(network) {
            for (number, layer) in chain.layers.iter().enumerate() {
                values.insert(format!("{name}.{}.weight", number + 1), matrix(layer.weight.val()));
                let bias = layer.bias.as_ref().expect("our layers have a bias");
                values.insert(format!("{name}.{}.bias", number + 1), vector(bias.val()));
            }
        }
        values
    }

    /// The Gaussians at the moment.
    fn deformed(&self) -> RawGaussians {
        let canonical = self.gaussians.canonical();
        let means = canonical.means.clone();
        let time = tensor(&[TIME], [1, 1], &means.device().inner(), DType::F64);
        let offsets = self.network.decode(self.network.feature(means, time));
        canonical.deformed(offsets)
    }

    /// The packed picture of both copies, with the masks as features.
    fn render(&self, camera: &Camera, settings: &SplatSettings) -> Tensor<4> {
        let deformed = self.deformed();
        let masks = deformed.mask_features();
        deformed
            .splat(masks, None, camera, settings, BackgroundLevels { grey: 1e-7, masks: [1e-7; 3] })
            .expect("the scene can be rendered")
            .packed
    }
}

fn parameter<const D: usize>(values: &Values, name: &str, device: &Device) -> Param<Tensor<D>> {
    let array = &values[name];
    let shape = array.shape.as_slice().try_into().expect("each parameter has its own number of axes");
    Param::from_tensor(tensor(&array.values, shape, device, DType::F64))
}

/// Numbers for every parameter, off the rasteriser's thresholds.
fn scene(camera: &Camera, settings: &SplatSettings) -> Values {
    let device = (backends()[0].device)();
    let stream = &mut Stream::new(21, 0);
    let config =
        DeformationConfig { layout: layout(), bounds: bounds(), width: WIDTH, depth: 1, heads: HeadChoice::ALL };
    let network = config.init(&mut ModuleInit { device: &device, dtype: DType::F64, stream });
    let mut values = Parts::of_network(&network, Array::of, Array::of);
    // Fresh time planes are one everywhere, and time would not matter.
    let planes = values["planes"].shape.clone();
    let cells = draw(planes.iter().product(), stream, |s| s.uniform(0.4, 1.5));
    values.insert("planes".into(), Array::new(planes, cells));

    let means = (0..COUNT)
        .flat_map(|_| {
            let depth = stream.uniform(1.5, 4.5);
            point_before(camera, depth, stream).to_array()
        })
        .collect();
    let mut insert = |attribute: Attribute, columns: usize, numbers: Vec<f64>| {
        values.insert(attribute.name().into(), Array::new([COUNT, columns], numbers));
    };
    insert(Attribute::Means, 3, means);
    insert(Attribute::ShDc, 3, draw(COUNT * 3, stream, |s| s.uniform(-0.5, 1.5)));
    insert(Attribute::ShRest, 45, draw(COUNT * 45, stream, |s| 0.1 * s.normal()));
    insert(Attribute::OpacityLogits, 1, draw(COUNT, stream, |s| s.uniform(-2.0, 2.0)));
    insert(Attribute::LogScales, 3, draw(COUNT * 3, stream, |s| s.uniform(-2.4, -1.2)));
    insert(Attribute::Quaternions, 4, draw(COUNT * 4, stream, |s| 2.0 * s.normal()));
    insert(Attribute::MaskLogits, 3, draw(COUNT * 3, stream, Stream::normal));

    let name = Attribute::OpacityLogits.name();
    let mut logits = values[name].values.clone();
    keep_off_thresholds(&mut logits, camera, settings, |logits| {
        let mut moved = values.clone();
        moved.insert(name.into(), Array::new([COUNT, 1], logits.to_vec()));
        as_inputs(Parts::new(&moved, &device).deformed())
    });
    values.insert(name.into(), Array::new([COUNT, 1], logits));
    values
}

/// Gaussians as the splat op takes them.
fn as_inputs(gaussians: RawGaussians) -> SplatInputs {
    let background = Tensor::zeros([3], (&gaussians.means.device(), DType::F64));
    SplatInputs {
        means: gaussians.means,
        quaternions: gaussians.quaternions,
        log_scales: gaussians.log_scales,
        opacity_logits: gaussians.opacity_logits.reshape([COUNT]),
        sh: gaussians.sh,
        features: None,
        background,
    }
}

#[test]
fn gradients_of_the_whole_chain_are_its_derivatives() {
    let camera = Camera { width: 30, height: 20, cx: 14.2, cy: 10.7, fx: 25.0, fy: 27.0, ..camera() };
    let settings = SplatSettings { rules: SplatRules::inria(), sh_degree: 3, ..SplatSettings::default() };
    let values = scene(&camera, &settings);
    let pixels = camera.height * camera.width;
    let all_weights = draw(2 * CHANNELS * pixels, &mut Stream::new(22, 0), Stream::normal);
    for backend in backends() {
        // Burn's sigmoid on ndarray works in single precision whatever its argument, and differences show no more than
        // its rounding. The masks are its only use in the chain.
        let masks_count = backend.name != "ndarray";
        let counts = |channel: usize| masks_count || !MASKS.contains(&(channel % CHANNELS));
        let weights: Vec<f64> =
            all_weights.iter().enumerate().map(|(i, &w)| if counts(i / pixels) { w } else { 0.0 }).collect();
        let plain = (backend.device)();
        let device = plain.clone().autodiff();
        let parts = Parts::new(&values, &device);
        let picture = parts.render(&camera, &settings);
        let found = (picture.clone() * tensor(&weights, picture.dims(), &device, DType::F64)).sum().backward();
        let mut gradients =
            Parts::of_network(&parts.network, |leaf| gradient(&leaf, &found), |leaf| gradient(&leaf, &found));
        for attribute in Attribute::ALL {
            // Lifetimes, whose gradients are compared with their formulas elsewhere, are absent.
            let Some(leaf) = parts.gaussians.attribute(attribute) else { continue };
            gradients.insert(attribute.name().into(), gradient(&leaf.val(), &found));
        }
        gradients.retain(|name, _| masks_count || !name.starts_with("mask"));
        let loss = |values: &Values| {
            let picture = Parts::new(values, &plain).render(&camera, &settings);
            numbers(picture).iter().zip(&weights).map(|(value, weight)| value * weight).sum()
        };
        compare(&values, &gradients, loss).unwrap_or_else(|error| panic!("{}: {error}", backend.name));
    }
}
