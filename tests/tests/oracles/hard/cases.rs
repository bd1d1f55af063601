//! Ops on hard inputs: single precision on a backend against double precision on the first CPU backend.

use anyhow::{Result, ensure};
use burn::tensor::{DType, Device, Gradients, Tensor};
use libtest_mimic::Trial;
use mvfusion_model::config::LossConfig;
use mvfusion_model::model::composition::{Blending, BranchRenders};
use mvfusion_model::random::Stream;
use mvfusion_model::train::loss::{LossContext, LossSchedule, Pictures, Windows, light_loss, main_loss};
use mvfusion_render::grid::{GridBounds, GridLayout, look_up, regulariser::penalties};
use mvfusion_render::mlp::{self, Layer, MlpLayout};
use mvfusion_render::optim::{AdamMoments, AdamRule, adam_step};
use mvfusion_render::window::{Window, ssim_map, structure_map};
use mvfusion_render::{attention, window};
use mvfusion_tests::{Array, Backend, Checklist, Tolerance, backends, gradient, tensor};

use super::{splats, trial};

/// Named numbers, and how far single precision may be off.
pub type Outcome = Vec<(String, Array, Tolerance)>;

/// A name, and what takes the gradient of a leaf.
pub type Leaf<'a> = (&'a str, &'a dyn Fn(&Gradients) -> Array);

/// A map of two pictures.
type Map = fn(Tensor<4>, Tensor<4>, &Window) -> Tensor<4>;

/// An op on inputs that single precision holds exactly, in the given precision.
pub type Case = fn(Numbers<'_>) -> Result<Outcome>;

/// A few roundings.
const FEW: Tolerance = Tolerance::of_largest(3e-6).plus(1e-9);

/// Of maps of similarity.
const MAP: Tolerance = Tolerance::absolute(3e-6);

/// Of the gradients of similarities of flat pictures, of which the largest is about one.
const FLAT: Tolerance = Tolerance::of_largest(2e-4).plus(2e-4);

/// Of losses and their gradients, through SSIM.
const LOSS: Tolerance = Tolerance::of_largest(1e-4).plus(1e-6);

const CASES: [(&str, Case); 9] = [
    ("bright_pictures", bright_pictures),
    ("equal_pictures", equal_pictures),
    ("flat_pictures", flat_pictures),
    ("small_pictures", small_pictures),
    ("losses", losses),
    ("grid", grid),
    ("mlp", perceptrons),
    ("attention", attentions),
    ("adam", adam),
];

/// One trial a case.
pub fn trials(backend: Backend) -> Vec<Trial> {
    let cases = CASES.iter().chain(&splats::CASES);
    cases.map(|&(name, case)| trial(backend, name, move || compare(case, backend))).collect()
}

fn compare(case: Case, backend: Backend) -> Result<()> {
    let reference = backends().into_iter().next().expect("a CPU backend is always tested");
    let [found, wanted] = [(backend, DType::F32), (reference, DType::F64)]
        .map(|(backend, dtype)| case(Numbers { device: &(backend.device)().autodiff(), dtype }));
    let (found, wanted) = (found?, wanted?);
    let mut checks = Checklist::default();
    for ((name, found, tolerance), (_, wanted, _)) in found.iter().zip(&wanted) {
        ensure!(wanted.values.iter().all(|value| value.is_finite()), "the reference of `{name}` is not finite");
        checks.close(name, wanted, found, *tolerance);
    }
    checks.finish()
}

/// Makes leaves.
#[derive(Clone, Copy)]
pub struct Numbers<'a> {
    pub device: &'a Device,
    pub dtype: DType,
}

impl Numbers<'_> {
    /// A leaf of numbers, rounded to single precision.
    pub fn leaf<const D: usize>(self, values: impl IntoIterator<Item = f64>, shape: [usize; D]) -> Tensor<D> {
        let values: Vec<f64> = values.into_iter().map(|value| f64::from(value as f32)).collect();
        tensor(&values, shape, self.device, self.dtype).require_grad()
    }

    /// The same number everywhere.
    fn full<const D: usize>(self, value: f64, shape: [usize; D]) -> Tensor<D> {
        self.leaf(std::iter::repeat_n(value, shape.iter().product()), shape)
    }

    /// `middle` plus normal noise.
    pub fn noise<const D: usize>(self, middle: f64, spread: f64, seed: u64, shape: [usize; D]) -> Tensor<D> {
        let mut stream = Stream::new(seed, 3);
        let values: Vec<f64> = (0..shape.iter().product()).map(|_| middle + spread * stream.normal()).collect();
        self.leaf(values, shape)
    }

    /// Goes back from a result under a random cotangent, and names it and the gradients.
    pub fn and_back<const D: usize>(
        self,
        name: &str,
        result: Tensor<D>,
        leaves: &[Leaf<'_>],
        [of_result, of_gradients]: [Tolerance; 2],
    ) -> Outcome {
        let cotangent = self.noise(0.0, 1.0, 99, result.dims());
        let gradients = (result.clone() * cotangent.detach()).sum().backward();
        let mut outcome = vec![(format!("{name}: result"), Array::of(result), of_result)];
        outcome.extend(leaves.iter().map(|(leaf, of)| (format!("{name}: {leaf}"), of(&gradients), of_gradients)));
        outcome
    }
}

/// SSIM and the structure term of two pictures, with their gradients.
fn similarities(numbers: Numbers<'_>, name: &str, [a, b]: [Tensor<4>; 2], of_gradients: Tolerance) -> Outcome {
    let of_map = |(kind, map, size): (&str, Map, usize)| {
        let map = map(a.clone(), b.clone(), &Window::gaussian(size, 1.5));
        let leaves: [Leaf<'_>; 2] =
            [("first", &|gradients| gradient(&a, gradients)), ("second", &|gradients| gradient(&b, gradients))];
        numbers.and_back(&format!("{kind} of {name}"), map, &leaves, [MAP, of_gradients])
    };
    [("SSIM", ssim_map as Map, 11), ("structure", structure_map as Map, 5)].into_iter().flat_map(of_map).collect()
}

const SHAPE: [usize; 4] = [1, 2, 14, 19];

fn bright_pictures(numbers: Numbers<'_>) -> Result<Outcome> {
    let pair = [1, 2].map(|seed| numbers.noise(0.97, 0.002, seed, SHAPE));
    Ok(similarities(numbers, "bright pictures", pair, FLAT))
}

fn equal_pictures(numbers: Numbers<'_>) -> Result<Outcome> {
    let mut outcome = Vec::new();
    for (name, middle, spread) in [("bright", 0.97, 0.002), ("dark", 0.02, 0.002), ("busy", 0.5, 0.2)] {
        let pair = [3; 2].map(|seed| numbers.noise(middle, spread, seed, SHAPE));
        outcome.extend(similarities(numbers, &format!("equal {name} pictures"), pair, FLAT));
    }
    Ok(outcome)
}

fn flat_pictures(numbers: Numbers<'_>) -> Result<Outcome> {
    let mut outcome = Vec::new();
    for [a, b] in [[0.0, 0.0], [1.0, 1.0], [0.1, 0.1], [0.0, 1.0]] {
        let pair = [a, b].map(|level| numbers.full(level, SHAPE));
        outcome.extend(similarities(numbers, &format!("flat pictures of {a} and {b}"), pair, FLAT));
    }
    Ok(outcome)
}

fn small_pictures(numbers: Numbers<'_>) -> Result<Outcome> {
    let mut outcome = Vec::new();
    for shape in [[1, 1, 1, 1], [1, 2, 1, 9], [2, 1, 7, 1], [1, 3, 3, 2]] {
        let pair = [4, 5].map(|seed| numbers.noise(0.6, 0.1, seed, shape));
        outcome.extend(similarities(numbers, &format!("pictures of {shape:?}"), pair, FLAT));
        let picture = numbers.noise(0.6, 0.1, 6, shape);
        let blurred = window::blur(picture.clone(), &Window::gaussian(11, 1.5));
        let leaves: [Leaf<'_>; 1] = [("picture", &|gradients| gradient(&picture, gradients))];
        outcome.extend(numbers.and_back(&format!("blur of {shape:?}"), blurred, &leaves, [FEW, FEW]));
    }
    Ok(outcome)
}

/// What the losses are asked about: size, whether pixels are valid, value of all channels of the mask.
struct Situation {
    name: &'static str,
    size: [usize; 2],
    valid: f64,
    mask: f64,
}

/// Both losses where renders equal the photos, no pixel is valid, nothing is in front, or there is one pixel.
fn losses(numbers: Numbers<'_>) -> Result<Outcome> {
    let situations = [
        Situation { name: "equal pictures", size: [8, 9], valid: 1.0, mask: 0.5 },
        Situation { name: "no valid pixel", size: [8, 9], valid: 0.0, mask: 0.5 },
        Situation { name: "nothing in front", size: [8, 9], valid: 1.0, mask: 0.0 },
        Situation { name: "all in front", size: [8, 9], valid: 1.0, mask: 1.0 },
        Situation { name: "one pixel", size: [1, 1], valid: 1.0, mask: 0.3 },
        Situation { name: "one row", size: [1, 7], valid: 1.0, mask: 0.3 },
    ];
    let of = |geometry: bool| situations.iter().flat_map(move |situation| losses_of(numbers, situation, geometry));
    Ok(of(true).chain(of(false)).collect())
}

fn losses_of(numbers: Numbers<'_>, situation: &Situation, geometry: bool) -> Outcome {
    let &Situation { name, size: [height, width], valid, mask } = situation;
    let shape = |channels: usize| [2, channels, height, width];
    // Renders equal the photos.
    let picture = || numbers.noise(0.5, 0.1, 7, shape(3));
    let layers = BranchRenders { dynamic: picture(), static_: picture(), mask: numbers.full(mask, shape(3)) };
    let depths = [8, 9].map(|seed| numbers.noise(3.0, 0.5, seed, shape(1)));
    let log_scales = [10, 11].map(|seed| numbers.noise(-2.0, 0.5, seed, [5, 3]));
    let valid = numbers.full(valid, [1, 1, height, width]).inner();
    let photos = picture().inner() * valid.clone();
    let blending = if geometry { Blending::Geometry } else { Blending::Deformation };
    let [dynamic_depth, static_depth] = depths.clone();
    let composition = layers.clone().compose_within(blending, Some(&valid));
    let pictures = Pictures { composition, dynamic_depth, static_depth };
    let config = LossConfig { geometry_mean: false, ..LossConfig::default() };
    let context = LossContext {
        photos: &photos,
        valid: Some(&valid),
        motion: None,
        config: &config,
        schedule: LossSchedule { geometry, step: 20, total: 10, densify_until: 100, brightness_end: 0.5 },
        extent: 2.0,
        windows: &Windows::default(),
    };
    let loss = main_loss(&pictures, &context) + light_loss(&pictures, log_scales.clone(), &context);
    let leaves: [Leaf<'_>; 6] = [
        ("dynamic", &|gradients| gradient(&layers.dynamic, gradients)),
        ("static", &|gradients| gradient(&layers.static_, gradients)),
        ("mask", &|gradients| gradient(&layers.mask, gradients)),
        ("dynamic depth", &|gradients| gradient(&depths[0], gradients)),
        ("static depth", &|gradients| gradient(&depths[1], gradients)),
        ("log-scales", &|gradients| gradient(&log_scales[0], gradients)),
    ];
    numbers.and_back(&format!("{name}, geometry {geometry}"), loss, &leaves, [LOSS, LOSS])
}

/// Axes of one cell, a box without depth, one moment, and points on the corners of the box.
fn grid(numbers: Numbers<'_>) -> Result<Outcome> {
    let mut outcome = Vec::new();
    for (name, resolution, depth) in
        [("one row of time", [4, 3, 5, 1], 1.0), ("one cell", [1, 1, 1, 1], 1.0), ("a flat box", [4, 3, 5, 6], 0.0)]
    {
        let layout = GridLayout { features: 3, resolution, multipliers: vec![1, 2] };
        let [end, start] = [1.3f32, -0.8].map(f64::from);
        let bounds = GridBounds { min: [start, start, 0.0], max: [end, end, depth] };
        let planes = numbers.noise(1.0, 1e-4, 12, [layout.cells(), layout.features]);
        let points = numbers.noise(0.0, 1.5, 13, [30, 3]).inner();
        let points = points.slice_assign([0..2, 0..3], numbers.leaf([bounds.max, bounds.min].concat(), [2, 3]).inner());
        let points = Tensor::from_inner(points).require_grad();
        let times = numbers.noise(0.4, 0.2, 20, [30, 1]);
        let found = look_up(planes.clone(), points.clone(), times.clone(), &bounds, &layout)?;
        let leaves: [Leaf<'_>; 3] = [
            ("planes", &|gradients| gradient(&planes, gradients)),
            ("points", &|gradients| gradient(&points, gradients)),
            ("times", &|gradients| gradient(&times, gradients)),
        ];
        // A slope is a ten-thousandth, times half the cells.
        outcome.extend(numbers.and_back(name, found, &leaves, [FEW, Tolerance::of_largest(2e-5)]));
        let terms = penalties(planes.clone(), &layout)?;
        let terms = Tensor::cat(vec![terms.plane_smooth, terms.time_smooth, terms.l1_time], 0);
        outcome.extend(numbers.and_back(&format!("penalties of {name}"), terms, &leaves[..1], [FEW, FEW]));
    }
    Ok(outcome)
}

/// Rows of zeros, at the kink of every ReLU, and large rows.
fn perceptrons(numbers: Numbers<'_>) -> Result<Outcome> {
    let mut outcome = Vec::new();
    let layout = MlpLayout { inputs: 6, rectified: true, chains: vec![vec![9, 4], vec![1]] };
    for (name, middle, spread, weights) in
        [("zeros", 0.0, 0.0, 0.3), ("no weights", 0.0, 1.0, 0.0), ("large numbers", 0.0, 1e6, 1e3)]
    {
        let input = numbers.noise(middle, spread, 14, [70, 6]);
        let parameters = numbers.noise(0.0, weights, 15, [layout.parameters()]);
        let found = mlp::forward(input.clone(), Layer::all_of(&parameters, &layout), &layout)?;
        let leaves: [Leaf<'_>; 2] = [
            ("input", &|gradients| gradient(&input, gradients)),
            ("parameters", &|gradients| gradient(&parameters, gradients)),
        ];
        outcome.extend(numbers.and_back(name, found, &leaves, [FEW, FEW]));
    }
    Ok(outcome)
}

/// One key, equal keys, and scores whose exponentials overflow.
fn attentions(numbers: Numbers<'_>) -> Result<Outcome> {
    let mut outcome = Vec::new();
    for (name, keys, spread) in [("one key", 1, 1.0), ("no differences", 3, 0.0), ("large scores", 3, 300.0)] {
        let queries = numbers.noise(0.0, spread, 16, [70, 2, 8]);
        let memory = numbers.noise(0.0, spread, 17, [70, keys, 16]);
        let found = attention::forward(queries.clone(), memory.clone(), 2)?;
        let leaves: [Leaf<'_>; 2] = [
            ("queries", &|gradients| gradient(&queries, gradients)),
            ("memory", &|gradients| gradient(&memory, gradients)),
        ];
        // Scores of 1e5 are known to a hundredth in single precision, and so are the exponentials of their differences.
        let tolerance = if spread > 1.0 { Tolerance::of_largest(2e-2) } else { FEW };
        outcome.extend(numbers.and_back(name, found, &leaves, [tolerance; 2]));
    }
    Ok(outcome)
}

/// No gradient at all, gradients whose squares underflow, and large ones.
fn adam(numbers: Numbers<'_>) -> Result<Outcome> {
    let mut outcome = Vec::new();
    for size in [0.0, 1e-12, 1e-30, 1e15] {
        let mut value = numbers.noise(1.0, 0.1, 18, [300]).inner();
        let mut moments = AdamMoments::zeros_like(&value);
        for step in 0..3 {
            let gradient = numbers.noise(0.0, size, 19 + step, [300]).inner();
            (value, moments) = adam_step(value, gradient, moments, &AdamRule::new(0.01));
        }
        // Squares below 1e-38 are 0 in single precision: the parameter stays, or moves by less than a step.
        let tolerance = if size == 1e-30 { Tolerance::absolute(0.03) } else { FEW };
        outcome.push((format!("after gradients of {size}"), Array::of(value), tolerance));
    }
    Ok(outcome)
}
