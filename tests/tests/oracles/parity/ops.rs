//! The ops but for the splat: each there and back, as a case.

use anyhow::{Context, Result, ensure};
use burn::tensor::{DType, Device, Tensor};
use mvfusion_render::activation::{foreground_share, sigmoid};
use mvfusion_render::grid::{GridBounds, GridLayout, look_up, regulariser::penalties};
use mvfusion_render::mlp::{Layer, MlpLayout};
use mvfusion_render::optim::{self, AdamMoments, AdamRule, AdamStep};
use mvfusion_render::scales::{self, ScaleRule};
use mvfusion_render::window::{Window, blur, ssim_map, structure_map};
use mvfusion_render::{attention, mlp, offsets};
use mvfusion_tests::{Array, Tolerance, gradient};

use super::photos::{objective_and_back, unpacked};
use super::{normal, uniform, weighed};

/// Sums of some thousand numbers in another order.
const SUMS: Tolerance = Tolerance::of_largest(2e-5);

/// Through SSIM's nearly equal moments.
pub const MOMENTS: Tolerance = Tolerance::of_largest(5e-4);

/// Named numbers that an op gives, and how far they may be off.
pub type Outcome = Vec<(String, Array, Tolerance)>;

/// One op with arguments, on a device that tracks gradients.
pub type Case = fn(&Device) -> Result<Outcome>;

/// All of them, by name.
pub const CASES: [(&str, Case); 14] = [
    ("look_up", look_up_and_back),
    ("penalties", penalties_and_back),
    ("scales", scales_and_back),
    ("activations", activations_and_back),
    ("mlp", mlp_and_back),
    ("attention", attention_and_back),
    ("offsets", offsets_and_back),
    ("blur", blur_and_back),
    ("ssim", ssim_and_back),
    ("structure", structure_and_back),
    ("adam", adam_steps),
    ("unpack", unpacked),
    ("objective", objective_and_back),
    ("nothing", nothing),
];

pub fn layout() -> GridLayout {
    GridLayout { features: 11, resolution: [9, 7, 5, 6], multipliers: vec![1, 2] }
}

fn planes(device: &Device) -> Tensor<2> {
    let layout = layout();
    uniform([layout.cells(), layout.features], [0.1, 1.3], 1, device)
}

pub fn look_up_and_back(device: &Device) -> Result<Outcome> {
    let bounds = GridBounds { min: [-1.0, -0.7, -1.1], max: [1.0, 1.2, 0.8] };
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

pub fn scales_and_back(device: &Device) -> Result<Outcome> {
    let rule = ScaleRule { large: 3.0, large_above: 0.5, spiky: 2.0, spiky_above: 4.0 };
    let mut outcome = Vec::new();
    // So many that partial sums of cubes are summed by several cubes.
    for count in [0, 1, 700, 200_001] {
        let log_scales = uniform([count, 3], [-3.0, 1.0], 6, device);
        let found = scales::cost(log_scales.clone(), rule);
        let gradients = weighed(&found, 7).backward();
        outcome.push((format!("cost of {count}"), Array::of(found), SUMS));
        outcome.push((format!("log-scales of {count}"), gradient(&log_scales, &gradients), SUMS));
    }
    Ok(outcome)
}

fn activations_and_back(device: &Device) -> Result<Outcome> {
    let mut outcome = Vec::new();
    for count in [0, 1, 70_003] {
        let logits = normal([count, 3], 4.0, 8, device);
        let found = sigmoid(logits.clone());
        let gradients = weighed(&found, 9).backward();
        outcome.push((format!("sigmoids of {count}"), Array::of(found), SUMS));
        outcome.push((format!("logits of {count}"), gradient(&logits, &gradients), SUMS));
        outcome.push((format!("shares of {count}"), Array::of(foreground_share(logits, [0, 2])), SUMS));
    }
    Ok(outcome)
}

pub fn mlp_and_back(device: &Device) -> Result<Outcome> {
    let mut outcome = Vec::new();
    for rectified in [false, true] {
        let layout = MlpLayout { inputs: 13, rectified, chains: vec![vec![20, 17, 3], vec![4], vec![70, 1]] };
        let input = normal([1003, 13], 1.0, 11, device);
        let parameters = normal([layout.parameters()], 0.3, 12, device);
        let found = mlp::forward(input.clone(), Layer::all_of(&parameters, &layout), &layout)?;
        let gradients = weighed(&found, 13).backward();
        outcome.push((format!("outputs, {rectified}"), Array::of(found), SUMS));
        outcome.push((format!("input, {rectified}"), gradient(&input, &gradients), SUMS));
        outcome.push((format!("parameters, {rectified}"), gradient(&parameters, &gradients), SUMS));
    }
    Ok(outcome)
}

fn attention_and_back(device: &Device) -> Result<Outcome> {
    let mut outcome = Vec::new();
    // One query a row, as cross-attention has, and as many as keys, as self-attention has.
    for count in [1, 3] {
        let queries = normal([1003, count, 24], 1.0, 21, device);
        let memory = normal([1003, 3, 48], 1.0, 22, device);
        let found = attention::forward(queries.clone(), memory.clone(), 4)?;
        let gradients = weighed(&found, 23).backward();
        outcome.push((format!("found, {count} queries"), Array::of(found), SUMS));
        outcome.push((format!("queries, {count} queries"), gradient(&queries, &gradients), SUMS));
        outcome.push((format!("memory, {count} queries"), gradient(&memory, &gradients), SUMS));
    }
    Ok(outcome)
}

fn offsets_and_back(device: &Device) -> Result<Outcome> {
    let (blocks, widths) = ([3, 4, 48, 5], [3, 4, 12, 5]);
    let mut outcome = Vec::new();
    for rows in [[400, 603], [0, 7]] {
        let matrix = normal([rows[0] + rows[1], 60], 1.0, 24, device);
        let set = |rows: usize| widths.map(|width| normal([rows, width], 1.0, (rows + width) as u64, device)).into();
        let attributes: Vec<Vec<Tensor<2>>> = rows.map(set).into();
        let sums = offsets::add(attributes.clone(), matrix.clone(), &blocks).concat();
        // The other sums have no gradient.
        let gradients = [0, 2, 3, 5].map(|index| weighed(&sums[index], 25 + index as u64));
        let gradients = gradients.into_iter().reduce(|sum, term| sum + term).context("a sum")?.backward();
        outcome.push((format!("offsets of {rows:?}"), gradient(&matrix, &gradients), SUMS));
        outcome.push((format!("an attribute of {rows:?}"), gradient(&attributes[1][1], &gradients), SUMS));
        outcome.extend(sums.into_iter().map(|sum| (format!("a sum of {rows:?}"), Array::of(sum), SUMS)));
    }
    Ok(outcome)
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

/// Parameters of different sizes and rules, one of which has nothing in it. A GPU steps three in a launch.
pub fn adam_steps(device: &Device) -> Result<Outcome> {
    let device = &device.clone().inner();
    let sizes = [70_001, 1, 300, 0, 257, 1000];
    let mut values: Vec<Tensor<1>> = (41..).zip(sizes).map(|(seed, size)| normal([size], 1.0, seed, device)).collect();
    let held = values.clone();
    let mut moments: Vec<_> = values.iter().map(AdamMoments::zeros_like).collect();
    for step in 0..3 {
        let parameters = values.into_iter().zip(moments).enumerate().map(|(index, (value, moments))| {
            let gradient = normal(value.dims(), 0.1, 50 + 10 * step + index as u64, device);
            AdamStep { value, gradient, moments, rule: AdamRule::new(0.01 * (1 + index) as f64) }
        });
        let stepped = optim::adam_steps(parameters.collect());
        (values, moments) = stepped.into_iter().map(|stepped| (stepped.value, stepped.moments)).unzip();
    }
    let mut outcome = Outcome::new();
    for ((value, moments), held) in values.into_iter().zip(moments).zip(held).filter(|(_, held)| held.dims()[0] > 0) {
        outcome.push(("value".into(), Array::of(value), SUMS));
        outcome.push(("first moment".into(), Array::of(moments.first), SUMS));
        outcome.push(("second moment".into(), Array::of(moments.second), SUMS));
        outcome.push(("what another holds".into(), Array::of(held), SUMS));
    }
    Ok(outcome)
}

/// Ops on no rows at all, there and back: what they share between rows has no gradient.
fn nothing(device: &Device) -> Result<Outcome> {
    let bounds = GridBounds { min: [-1.0; 3], max: [1.0; 3] };
    let empty = |columns: usize| Tensor::<2>::zeros([0, columns], (device, DType::F32)).require_grad();
    let (planes, times) = (planes(device), uniform([1, 1], [0.0, 1.0], 3, device));
    let found = look_up(planes.clone(), empty(3), times.clone(), &bounds, &layout())?;
    let layout = MlpLayout { inputs: 3, rectified: true, chains: vec![vec![4, 2]] };
    let parameters = normal([layout.parameters()], 0.3, 12, device);
    let outputs = mlp::forward(empty(3), Layer::all_of(&parameters, &layout), &layout)?;
    let nobody = empty(8).reshape([0, 1, 8]);
    let attended = attention::forward(nobody, Tensor::zeros([0, 2, 16], (device, DType::F32)), 2)?;
    let rows = [found.dims()[0], outputs.dims()[0], attended.dims()[0]];
    ensure!(rows == [0; 3], "look-up, perceptrons and attention of nothing have {rows:?} rows");
    let gradients = (found.sum() + outputs.sum() + attended.sum()).backward();
    Ok(vec![
        ("planes".into(), gradient(&planes, &gradients), SUMS),
        ("times".into(), gradient(&times, &gradients), SUMS),
        ("parameters".into(), gradient(&parameters, &gradients), SUMS),
    ])
}
