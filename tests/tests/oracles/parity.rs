//! Every op on every backend against the first CPU backend: results and gradients, from nothing to 200,000 rows.

use anyhow::{Context, Result, ensure};
use burn::tensor::{DType, Device, Tensor};
use glam::{DMat3, DVec3};
use libtest_mimic::Trial;
use mvfusion_data::Camera;
use mvfusion_model::random::Stream;
use mvfusion_render::grid::{GridBounds, GridLayout, look_up, regulariser::penalties};
use mvfusion_render::mlp::MlpLayout;
use mvfusion_render::optim::{AdamMoments, AdamRule, adam_step};
use mvfusion_render::splat::{Antialias, SplatInputs, SplatRules, SplatSettings, Statistic, splat};
use mvfusion_render::window::{Window, blur, ssim_map, structure_map};
use mvfusion_render::{attention, mlp};
use mvfusion_tests::{Array, Backend, Checklist, Few, Tolerance, backends, gpu_backends, gradient, numbers, tensor};

/// Sums of some thousand numbers in another order.
const SUMS: Tolerance = Tolerance::of_largest(2e-5);

/// Through SSIM's nearly equal moments.
const MOMENTS: Tolerance = Tolerance::of_largest(5e-4);

/// What a pixel may lose or win if a Gaussian stands on the threshold of alpha, 1/255, for colours and features of size
/// one.
const FLIP: f64 = 2.5 / 255.0;

/// The root of the mean squared difference of two pictures: flips are rare.
const MEAN_DIFFERENCE: f64 = 2e-5;

/// Of the largest gradient, through long sums.
const SPLAT_GRADIENTS: Tolerance = Tolerance::of_largest(1e-4);

/// The background's few gradients are sums over all pixels, so that every flip reaches each of them.
const BACKGROUND_GRADIENTS: Tolerance = Tolerance::of_largest(2e-3);

/// Gradients of a Gaussian that stands on that threshold at one pixel.
const FLIPPED: Few = Few { share: 1e-3, tolerance: Tolerance::of_largest(1e-2) };

/// Named numbers that an op gives.
type Outcome = Vec<(String, Array, Tolerance)>;

/// One op with arguments, on a device that tracks gradients.
type Case = (String, fn(&Device) -> Result<Outcome>);

/// One trial an op, for each backend but the one that all are compared with.
pub fn trials(backend: Backend) -> Vec<Trial> {
    let Some(reference) = backends().into_iter().next().filter(|first| first.name != backend.name) else {
        return Vec::new();
    };
    let plain = |name: &str, body: fn(&Device) -> Result<Outcome>| -> Case { (name.to_owned(), body) };
    let cases = vec![
        plain("look_up", look_up_and_back),
        plain("penalties", penalties_and_back),
        plain("mlp", mlp_and_back),
        plain("attention", attention_and_back),
        plain("blur", blur_and_back),
        plain("ssim", ssim_and_back),
        plain("structure", structure_and_back),
        plain("adam", adam_steps),
        plain("nothing", nothing),
    ];
    let ops = cases.into_iter().map(|(name, body)| {
        Trial::test(format!("parity::{}::{name}", backend.name), move || {
            compare(&body(&device(backend))?, &body(&device(reference))?).map_err(failed)
        })
    });
    let pictures = SCENES.iter().map(|scene| {
        Trial::test(format!("parity::{}::splat::{}", backend.name, scene.name), move || {
            compare_pictures(scene, &device(backend), &device(reference)).map_err(failed)
        })
    });
    ops.chain(pictures).chain(variants(backend, reference)).collect()
}

/// What depends on the device, otherwise than by the device at hand: launches folded as where only four cubes fit along
/// an axis, and work shared out as on hardware, which a driver that computes on the CPU would not do.
#[cfg(any(feature = "wgpu", feature = "cuda"))]
fn variants(backend: Backend, reference: Backend) -> Vec<Trial> {
    use mvfusion_render::device::{fold_launches, imitate_hardware};

    let scenes = move |names: &[&str]| {
        let scenes = SCENES.iter().filter(|scene| names.contains(&scene.name));
        scenes.into_iter().try_for_each(|scene| compare_pictures(scene, &device(backend), &device(reference)))
    };
    let folded = move || {
        fold_launches(4);
        let result = (|| {
            compare(&look_up_and_back(&device(backend))?, &look_up_and_back(&device(reference))?)?;
            compare(&adam_steps(&device(backend))?, &adam_steps(&device(reference))?)?;
            scenes(&["twenty_thousand"])
        })();
        fold_launches(u32::MAX);
        result.map_err(failed)
    };
    let shared = move || {
        imitate_hardware(true);
        let result = (|| {
            compare(&mlp_and_back(&device(backend))?, &mlp_and_back(&device(reference))?)?;
            compare(&look_up_and_back(&device(backend))?, &look_up_and_back(&device(reference))?)?;
            scenes(&["none", "one", "thousand", "four_channels", "eight_channels", "hostile", "twenty_thousand"])
        })();
        imitate_hardware(false);
        result.map_err(failed)
    };
    if gpu_backends().iter().all(|gpu| gpu.name != backend.name) {
        return Vec::new();
    }
    vec![
        Trial::test(format!("parity::{}::folded", backend.name), folded),
        Trial::test(format!("parity::{}::as_on_hardware", backend.name), shared),
    ]
}

#[cfg(not(any(feature = "wgpu", feature = "cuda")))]
fn variants(_: Backend, _: Backend) -> Vec<Trial> {
    Vec::new()
}

fn failed(error: anyhow::Error) -> libtest_mimic::Failed {
    format!("{error:#}").into()
}

fn device(backend: Backend) -> Device {
    (backend.device)().autodiff()
}

fn compare(found: &Outcome, wanted: &Outcome) -> Result<()> {
    ensure!(found.len() == wanted.len(), "{} results, expected {}", found.len(), wanted.len());
    let mut checks = Checklist::default();
    for ((name, found, _), (_, wanted, tolerance)) in found.iter().zip(wanted) {
        checks.close(name, wanted, found, *tolerance);
    }
    checks.finish()
}

/// A leaf of normal numbers.
fn normal<const D: usize>(shape: [usize; D], scale: f64, seed: u64, device: &Device) -> Tensor<D> {
    let mut stream = Stream::new(seed, 7);
    let values: Vec<f64> = (0..shape.iter().product()).map(|_| scale * stream.normal()).collect();
    leaf(tensor(&values, shape, device, DType::F32))
}

/// A tensor that is tracked if its device tracks gradients.
fn leaf<const D: usize>(tensor: Tensor<D>) -> Tensor<D> {
    if tensor.is_autodiff() { tensor.require_grad() } else { tensor }
}

/// A leaf of numbers in `low..high`.
fn uniform<const D: usize>(shape: [usize; D], range: [f64; 2], seed: u64, device: &Device) -> Tensor<D> {
    let mut stream = Stream::new(seed, 8);
    let values: Vec<f64> = (0..shape.iter().product()).map(|_| stream.uniform(range[0], range[1])).collect();
    leaf(tensor(&values, shape, device, DType::F32))
}

/// The loss of a result under random weights.
fn weighed<const D: usize>(result: &Tensor<D>, seed: u64) -> Tensor<1> {
    let weights = normal(result.dims(), 1.0, seed, &result.device()).inner();
    (result.clone() * Tensor::from_inner(weights)).sum()
}

fn layout() -> GridLayout {
    GridLayout { features: 11, resolution: [9, 7, 5, 6], multipliers: vec![1, 2] }
}

fn planes(device: &Device) -> Tensor<2> {
    let layout = layout();
    uniform([layout.cells(), layout.features], [0.1, 1.3], 1, device)
}

fn look_up_and_back(device: &Device) -> Result<Outcome> {
    let bounds = GridBounds { max: [1.0, 1.2, 0.8], min: [-1.0, -0.7, -1.1] };
    let mut outcome = Vec::new();
    for (count, times) in [(1, 1), (700, 1), (20_001, 20_001)] {
        let planes = planes(device);
        // Some lie outside of the box.
        let points = uniform([count, 3], [-1.3, 1.3], 2, device);
        let times = uniform([times, 1], [-1.0, 1.0], 3, device);
        let found = look_up(planes.clone(), points.clone(), times.clone(), &bounds, &layout())?;
        let gradients = weighed(&found, 4).backward();
        outcome.push((format!("features of {count}"), Array::of(found), SUMS));
        outcome.push((format!("planes of {count}"), gradient(&planes, &gradients), SUMS));
        outcome.push((format!("points of {count}"), gradient(&points, &gradients), SUMS));
        outcome.push((format!("times of {count}"), gradient(&times, &gradients), SUMS));
    }
    Ok(outcome)
}

fn penalties_and_back(device: &Device) -> Result<Outcome> {
    let planes = planes(device);
    let terms = penalties(planes.clone(), &layout())?;
    let all = Tensor::cat(vec![terms.plane_smooth, terms.time_smooth, terms.l1_time], 0);
    let gradients = weighed(&all, 5).backward();
    Ok(vec![("terms".into(), Array::of(all), SUMS), ("planes".into(), gradient(&planes, &gradients), SUMS)])
}

fn mlp_and_back(device: &Device) -> Result<Outcome> {
    let mut outcome = Vec::new();
    for rectified in [false, true] {
        let layout = MlpLayout { inputs: 13, rectified, chains: vec![vec![20, 17, 3], vec![4], vec![9, 1]] };
        let input = normal([1003, 13], 1.0, 11, device);
        let parameters = normal([layout.parameters()], 0.3, 12, device);
        let found = mlp::forward(input.clone(), parameters.clone(), &layout)?;
        let gradients = weighed(&found, 13).backward();
        outcome.push((format!("outputs, {rectified}"), Array::of(found), SUMS));
        outcome.push((format!("input, {rectified}"), gradient(&input, &gradients), SUMS));
        outcome.push((format!("parameters, {rectified}"), gradient(&parameters, &gradients), SUMS));
    }
    Ok(outcome)
}

fn attention_and_back(device: &Device) -> Result<Outcome> {
    let queries = normal([1003, 24], 1.0, 21, device);
    let memory = normal([1003, 3, 48], 1.0, 22, device);
    let found = attention::forward(queries.clone(), memory.clone(), 4)?;
    let gradients = weighed(&found, 23).backward();
    Ok(vec![
        ("found".into(), Array::of(found), SUMS),
        ("queries".into(), gradient(&queries, &gradients), SUMS),
        ("memory".into(), gradient(&memory, &gradients), SUMS),
    ])
}

/// An op of two pictures.
fn of_pictures(
    device: &Device,
    tolerance: Tolerance,
    op: impl Fn(Tensor<4>, Tensor<4>) -> Tensor<4>,
) -> Result<Outcome> {
    let mut outcome = Vec::new();
    for shape in [[2, 3, 37, 53], [1, 1, 5, 3], [1, 3, 1, 1]] {
        let (a, b) = (uniform(shape, [0.0, 1.0], 31, device), uniform(shape, [0.0, 1.0], 32, device));
        let map = op(a.clone(), b.clone());
        let gradients = weighed(&map, 33).backward();
        outcome.push((format!("map of {shape:?}"), Array::of(map), tolerance));
        outcome.push((format!("first of {shape:?}"), gradient(&a, &gradients), tolerance));
        outcome.push((format!("second of {shape:?}"), gradient(&b, &gradients), tolerance));
    }
    Ok(outcome)
}

fn blur_and_back(device: &Device) -> Result<Outcome> {
    let window = Window::gaussian(11, 1.5);
    of_pictures(device, SUMS, |a, b| blur(a, &window) + b)
}

fn ssim_and_back(device: &Device) -> Result<Outcome> {
    let window = Window::gaussian(11, 1.5);
    of_pictures(device, MOMENTS, |a, b| ssim_map(a, b, &window))
}

fn structure_and_back(device: &Device) -> Result<Outcome> {
    let window = Window::gaussian(5, 1.5);
    of_pictures(device, MOMENTS, |a, b| structure_map(a, b, &window))
}

fn adam_steps(device: &Device) -> Result<Outcome> {
    let device = &device.clone().inner();
    let mut value = normal([70_001], 1.0, 41, device);
    let held = value.clone();
    let mut moments = AdamMoments::zeros_like(&value);
    for step in 0..3 {
        let gradient = normal([70_001], 0.1, 42 + step, device);
        (value, moments) = adam_step(value, gradient, moments, &AdamRule::new(0.01));
    }
    Ok(vec![
        ("value".into(), Array::of(value), SUMS),
        ("first moment".into(), Array::of(moments.first), SUMS),
        ("second moment".into(), Array::of(moments.second), SUMS),
        ("what another holds".into(), Array::of(held), SUMS),
    ])
}

/// Ops on no rows at all, there and back: what they share between rows has no gradient.
fn nothing(device: &Device) -> Result<Outcome> {
    let bounds = GridBounds { max: [1.0; 3], min: [-1.0; 3] };
    let empty = |columns: usize| Tensor::<2>::zeros([0, columns], (device, DType::F32)).require_grad();
    let (planes, times) = (planes(device), uniform([1, 1], [0.0, 1.0], 3, device));
    let found = look_up(planes.clone(), empty(3), times.clone(), &bounds, &layout())?;
    let layout = MlpLayout { inputs: 3, rectified: true, chains: vec![vec![4, 2]] };
    let parameters = normal([layout.parameters()], 0.3, 12, device);
    let outputs = mlp::forward(empty(3), parameters.clone(), &layout)?;
    let attended = attention::forward(empty(8), Tensor::zeros([0, 2, 16], (device, DType::F32)), 2)?;
    for (name, dims) in [("look-up", found.dims()), ("perceptrons", outputs.dims()), ("attention", attended.dims())] {
        ensure!(dims[0] == 0, "the {name} of nothing has shape {dims:?}");
    }
    let gradients = (found.sum() + outputs.sum() + attended.sum()).backward();
    Ok(vec![
        ("planes".into(), gradient(&planes, &gradients), SUMS),
        ("times".into(), gradient(&times, &gradients), SUMS),
        ("parameters".into(), gradient(&parameters, &gradients), SUMS),
    ])
}

/// A picture to render.
struct Scene {
    name: &'static str,
    count: usize,
    size: [usize; 2],
    features: usize,
    degree: usize,
    rules: fn() -> SplatRules,
    statistic: Statistic,
    /// Every n-th Gaussian has a number that is none, lies behind the camera, has no rotation, is huge or has
    /// underflowed.
    hostile: bool,
}

/// One Gaussian to 200,000, odd sizes, 3, 4 and 8 channels beside the depth, all rules.
const SCENES: &[Scene] = &[
    Scene {
        name: "none",
        count: 0,
        size: [33, 17],
        features: 1,
        degree: 0,
        rules: SplatRules::inria,
        statistic: Statistic::ColourAndDepth,
        hostile: false,
    },
    Scene {
        name: "one",
        count: 1,
        size: [17, 33],
        features: 0,
        degree: 3,
        rules: SplatRules::inria,
        statistic: Statistic::ColourAndDepth,
        hostile: false,
    },
    Scene {
        name: "thousand",
        count: 1000,
        size: [67, 45],
        features: 3,
        degree: 3,
        rules: SplatRules::inria,
        statistic: Statistic::ColourAndDepth,
        hostile: false,
    },
    Scene {
        name: "four_channels",
        count: 1000,
        size: [64, 48],
        features: 1,
        degree: 1,
        rules: SplatRules::inria,
        statistic: Statistic::AllChannels,
        hostile: false,
    },
    Scene {
        name: "eight_channels",
        count: 1000,
        size: [50, 41],
        features: 5,
        degree: 2,
        rules: SplatRules::gsplat,
        statistic: Statistic::AllChannels,
        hostile: false,
    },
    Scene {
        name: "antialiased",
        count: 3000,
        size: [131, 77],
        features: 0,
        degree: 3,
        rules: antialiased,
        statistic: Statistic::ColourAndDepth,
        hostile: false,
    },
    Scene {
        name: "hostile",
        count: 2000,
        size: [67, 45],
        features: 3,
        degree: 3,
        rules: SplatRules::inria,
        statistic: Statistic::ColourAndDepth,
        hostile: true,
    },
    Scene {
        name: "twenty_thousand",
        count: 20_000,
        size: [321, 201],
        features: 3,
        degree: 3,
        rules: SplatRules::inria,
        statistic: Statistic::ColourAndDepth,
        hostile: false,
    },
    Scene {
        name: "two_hundred_thousand",
        count: 200_000,
        size: [403, 301],
        features: 3,
        degree: 1,
        rules: SplatRules::inria,
        statistic: Statistic::ColourAndDepth,
        hostile: false,
    },
];

fn antialiased() -> SplatRules {
    SplatRules { antialias: Antialias::Compensated, ..SplatRules::gsplat() }
}

impl Scene {
    fn inputs(&self, device: &Device) -> SplatInputs {
        let count = self.count;
        let mut stream = Stream::new(51, count as u64);
        let mut means: Vec<f64> = (0..count)
            .flat_map(|_| [stream.uniform(-3.0, 3.0), stream.uniform(-2.2, 2.2), stream.uniform(1.0, 9.0)])
            .collect();
        // Of a size that each covers some pixels, however many there are.
        let spread = -2.2 - 0.25 * (count.max(1) as f64).log10();
        let mut scales: Vec<f64> = (0..3 * count).map(|_| spread + 0.5 * stream.normal()).collect();
        let mut quaternions: Vec<f64> = (0..4 * count).map(|_| stream.normal()).collect();
        let mut logits: Vec<f64> = (0..count).map(|_| 1.5 * stream.normal()).collect();
        if self.hostile {
            for index in (0..count).step_by(3) {
                match index / 3 % 7 {
                    0 => means[3 * index] = f64::NAN,
                    1 => means[3 * index + 2] = -4.0,
                    2 => quaternions[4 * index..4 * index + 4].fill(0.0),
                    3 => scales[3 * index] = 60.0,
                    4 => logits[index] = f64::INFINITY,
                    5 => logits[index] = -200.0,
                    _ => means[3 * index + 1] = 1e30,
                }
            }
        }
        let leaf = |values: &[f64], columns: usize| tensor(values, [count, columns], device, DType::F32).require_grad();
        SplatInputs {
            means: leaf(&means, 3),
            quaternions: leaf(&quaternions, 4),
            log_scales: leaf(&scales, 3),
            opacity_logits: tensor(&logits, [count], device, DType::F32).require_grad(),
            sh: normal([count, 16, 3], 0.4, 52, device),
            features: (self.features > 0).then(|| normal([count, self.features], 0.5, 53, device)),
            background: uniform([3 + self.features], [0.0, 1.0], 54, device),
        }
    }

    fn camera(&self) -> Camera {
        let [width, height] = self.size;
        let rotation = DMat3::from_euler(glam::EulerRot::XYZ, 0.1, -0.15, 0.2);
        Camera::centred(width, height, 0.9 * width as f64, rotation, DVec3::new(0.1, -0.2, 0.4))
    }
}

/// A picture and the gradients of all arguments.
struct Rendered {
    picture: Array,
    radii: Array,
    gradients: Vec<(&'static str, Array)>,
}

fn render(scene: &Scene, device: &Device) -> Result<Rendered> {
    let inputs = scene.inputs(device);
    let settings = SplatSettings { rules: (scene.rules)(), sh_degree: scene.degree, statistic: scene.statistic };
    let probe = Tensor::<2>::zeros([1, 2], (device, DType::F32)).require_grad();
    let picture = splat(inputs.clone(), Some(probe.clone()), &scene.camera(), &settings)?;
    let gradients = weighed(&picture.packed, 55).backward();
    let statistic = probe.grad(&gradients).context("the probe has a gradient")?;
    let mut all = vec![
        ("means", gradient(&inputs.means, &gradients)),
        ("quaternions", gradient(&inputs.quaternions, &gradients)),
        ("log_scales", gradient(&inputs.log_scales, &gradients)),
        ("opacity_logits", gradient(&inputs.opacity_logits, &gradients)),
        ("sh", gradient(&inputs.sh, &gradients)),
        ("background", gradient(&inputs.background, &gradients)),
        ("statistic", Array::of(statistic)),
    ];
    if let Some(features) = &inputs.features {
        all.push(("features", gradient(features, &gradients)));
    }
    let radii = Array::list(numbers(picture.radii.float()));
    Ok(Rendered { picture: Array::of(picture.packed), radii, gradients: all })
}

fn compare_pictures(scene: &Scene, device: &Device, reference: &Device) -> Result<()> {
    let (found, wanted) = (render(scene, device)?, render(scene, reference)?);
    let mut checks = Checklist::default();
    // A radius is rounded up to whole pixels, the last bit decides.
    checks.close("radii", &wanted.radii, &found.radii, Tolerance::absolute(1.0));
    // The depth is larger than one.
    let largest = wanted.picture.largest().max(1.0);
    checks.close("picture", &wanted.picture, &found.picture, Tolerance::absolute(FLIP * largest));
    let squares = found.picture.values.iter().zip(&wanted.picture.values).map(|(a, b)| (a - b).powi(2)).sum::<f64>();
    let mean = (squares / found.picture.values.len() as f64).sqrt();
    ensure!(
        mean <= MEAN_DIFFERENCE * largest,
        "pictures differ by {mean:e} in the mean, the largest number is {largest}"
    );
    for ((name, found), (_, wanted)) in found.gradients.iter().zip(&wanted.gradients) {
        if *name == "background" {
            checks.close(name, wanted, found, BACKGROUND_GRADIENTS);
        } else {
            checks.close_but_few(name, wanted, found, SPLAT_GRADIENTS, FLIPPED);
        }
    }
    checks.finish()
}
