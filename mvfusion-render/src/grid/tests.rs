//! Interpolation against its reference, finite differences and hostile input, on every CPU backend.

use burn::tensor::{DType, Device, Tensor, TensorData};

use super::*;
use crate::test_support::{for_each_device, numbers, random};

/// Products of six samples and sums over dozens of points, in f64 and f32, relative to the largest value.
const EXACT: f64 = 1e-12;
const SINGLE: f64 = 2e-5;

/// Step of the central differences. Their error is about its square times the curvature.
const STEP: f64 = 1e-5;
const DIFFERENCES: f64 = 1e-7;

const BOUNDS: GridBounds = GridBounds { min: [-1.0, -1.0, -0.75], max: [1.0, 2.0, 0.5] };

fn layout(features: usize) -> GridLayout {
    GridLayout { features, resolution: [5, 4, 6, 7], multipliers: vec![1, 2] }
}

struct Case {
    planes: Vec<f64>,
    points: Vec<f64>,
    times: Vec<f64>,
    cotangent: Vec<f64>,
    layout: GridLayout,
    bounds: GridBounds,
}

impl Case {
    /// `count` points in and around the box, with `times` distinct times.
    fn random(layout: GridLayout, count: usize, times: usize) -> Self {
        let spread = |values: Vec<f64>, scale: f64| -> Vec<f64> { values.iter().map(|x| (x - 0.5) * scale).collect() };
        Self {
            planes: random(1, layout.cells() * layout.features).iter().map(|x| x + 0.3).collect(),
            points: spread(random(2, 3 * count), 3.3),
            times: spread(random(3, times), 2.3),
            cotangent: spread(random(4, count * layout.feature_count()), 2.0),
            bounds: BOUNDS,
            layout,
        }
    }

    /// Features, then the adjoints of planes, points and times.
    fn run(&self, device: &Device, dtype: DType, look_up: impl Fn([Tensor<2>; 3]) -> Tensor<2>) -> [Vec<f64>; 4] {
        let device = &device.clone().autodiff();
        let tensor = |values: &[f64], columns: usize| {
            let data = TensorData::new(values.to_vec(), [values.len() / columns, columns]);
            Tensor::<2>::from_data(data, (device, dtype))
        };
        let inputs = [(&self.planes, self.layout.features), (&self.points, 3), (&self.times, 1)];
        let inputs = inputs.map(|(values, columns)| tensor(values, columns).require_grad());
        let features = look_up(inputs.clone());
        let cotangent = tensor(&self.cotangent, self.layout.feature_count());
        let gradients = (features.clone() * cotangent).sum().backward();
        let [planes, points, times] = inputs.map(|input| numbers(input.grad(&gradients).expect("tracked")));
        [numbers(features.inner()), planes, points, times]
    }

    fn op(&self, device: &Device, dtype: DType) -> [Vec<f64>; 4] {
        self.run(device, dtype, |[planes, points, times]| {
            look_up(planes, points, times, &self.bounds, &self.layout).expect("the arguments fit")
        })
    }

    fn assert_matches_reference(&self, device: &Device, dtype: DType, tolerance: f64) {
        let wanted = self.run(device, DType::F64, |[planes, points, times]| {
            reference::look_up(planes, points, times, &self.bounds, &self.layout)
        });
        for (part, (found, wanted)) in self.op(device, dtype).iter().zip(&wanted).enumerate() {
            assert_close(found, wanted, tolerance, &format!("part {part} in {dtype:?} of {:?}", self.layout));
        }
    }
}

fn assert_close(found: &[f64], wanted: &[f64], tolerance: f64, what: &str) {
    assert_eq!(found.len(), wanted.len(), "{what}");
    let largest = wanted.iter().fold(1.0f64, |largest, x| largest.max(x.abs()));
    let worst = found.iter().zip(wanted).map(|(a, b)| (a - b).abs()).fold(0.0, f64::max);
    assert!(worst <= tolerance * largest, "{what}: off by {worst}, the largest is {largest}");
}

#[test]
fn look_up_is_its_reference_for_any_number_of_features() {
    for_each_device(|device| {
        for (features, times) in [(1, 40), (3, 1), (16, 40), (21, 1), (32, 40)] {
            let case = Case::random(layout(features), 40, times);
            case.assert_matches_reference(&device, DType::F64, EXACT);
            case.assert_matches_reference(&device, DType::F32, SINGLE);
        }
    });
}

#[test]
fn on_nodes_the_right_hand_slope_counts_and_on_borders_none() {
    for_each_device(|device| {
        let mut case = Case::random(GridLayout { features: 2, resolution: [5, 5, 5, 5], multipliers: vec![1] }, 5, 5);
        case.bounds = GridBounds { min: [-1.0; 3], max: [1.0; 3] };
        let nodes = [-1.0, -0.5, 0.0, 0.5, 1.0];
        case.points = nodes.into_iter().flat_map(|node| [node, -node, 0.25]).collect();
        case.times = nodes.to_vec();
        case.assert_matches_reference(&device, DType::F64, EXACT);
        let [_, _, points, times] = case.op(&device, DType::F64);
        for border in [0, 4] {
            assert_eq!([points[3 * border], points[3 * border + 1], times[border]], [0.0; 3]);
            assert_ne!(points[3 * border + 2], 0.0);
        }
        assert!((1..4).all(|inside| points[3 * inside] != 0.0 && times[inside] != 0.0));
    });
}

#[test]
fn points_on_the_border_of_any_box_have_no_slope() {
    for_each_device(|device| {
        let ends = random(7, 60);
        for (max, min) in
            ends.iter().zip(&ends[30..]).map(|(max, min)| (f64::from(*max as f32), f64::from(-*min as f32)))
        {
            let mut case = Case::random(layout(2), 2, 1);
            case.bounds = GridBounds { min: [min; 3], max: [max; 3] };
            case.points = [[max; 3], [min; 3]].concat();
            for dtype in [DType::F32, DType::F64] {
                let [_, _, points, _] = case.op(&device, dtype);
                assert_eq!(points, [0.0; 6], "a box from {min} to {max} in {dtype:?}");
            }
        }
    });
}

#[test]
fn gradients_are_finite_differences() {
    for_each_device(|device| {
        for times in [1, 9] {
            let mut case = Case::random(layout(5), 9, times);
            let [_, planes, points, moments] = case.op(&device, DType::F64);
            let loss = |case: &Case| -> f64 {
                let [features, ..] = case.op(&device, DType::F64);
                features.iter().zip(&case.cotangent).map(|(a, b)| a * b).sum()
            };
            fn field(case: &mut Case, part: usize) -> &mut Vec<f64> {
                match part {
                    0 => &mut case.planes,
                    1 => &mut case.points,
                    _ => &mut case.times,
                }
            }
            for (part, found) in [planes, points, moments].into_iter().enumerate() {
                for i in (0..found.len()).step_by(if part == 0 { 97 } else { 1 }) {
                    let middle = field(&mut case, part)[i];
                    let mut at = |offset: f64| {
                        field(&mut case, part)[i] = middle + offset;
                        loss(&case)
                    };
                    let wanted = (at(STEP) - at(-STEP)) / (2.0 * STEP);
                    field(&mut case, part)[i] = middle;
                    let error = (found[i] - wanted).abs();
                    assert!(error < DIFFERENCES * wanted.abs().max(1.0), "part {part} at {i}: {} {wanted}", found[i]);
                }
            }
        }
    });
}

#[test]
fn results_do_not_depend_on_the_number_of_threads() {
    let case = Case::random(layout(4), 10_000, 1);
    for_each_device(|device| {
        let on = |threads: usize| {
            let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().expect("threads start");
            pool.install(|| case.op(&device, DType::F32))
        };
        assert_eq!(on(1), on(3));
    });
}

#[test]
fn points_that_are_no_numbers_look_up_some_cell() {
    for_each_device(|device| {
        let mut case = Case::random(layout(16), 4, 4);
        case.points[0] = f64::NAN;
        case.points[4] = f64::INFINITY;
        case.points[8] = f64::NEG_INFINITY;
        case.times[3] = f64::NAN;
        for dtype in [DType::F32, DType::F64] {
            assert!(case.op(&device, dtype).iter().flatten().all(|number| number.is_finite()));
        }
    });
}

#[test]
fn axes_of_one_cell_and_flat_boxes_have_no_slope() {
    for_each_device(|device| {
        let mut case =
            Case::random(GridLayout { features: 4, resolution: [1, 3, 1, 1], multipliers: vec![1, 3] }, 6, 6);
        case.assert_matches_reference(&device, DType::F64, EXACT);
        case.bounds.min[1] = case.bounds.max[1];
        let [features, planes, points, times] = case.op(&device, DType::F64);
        assert!(features.iter().chain(&planes).all(|number| number.is_finite()));
        assert!(points.iter().skip(1).step_by(3).chain(&times).all(|&number| number == 0.0));
    });
}

#[test]
fn no_points_give_no_features() {
    for_each_device(|device| {
        let [features, planes, ..] = Case::random(layout(4), 0, 1).op(&device, DType::F32);
        assert!(features.is_empty() && planes.iter().all(|&number| number == 0.0));
    });
}

#[test]
fn arguments_that_do_not_fit_are_named() {
    for_each_device(|device| {
        let zeros = |shape: [usize; 2]| Tensor::<2>::zeros(shape, (&device, DType::F32));
        let good = layout(4);
        let ask = |planes, points, times, layout: &GridLayout| {
            look_up(planes, points, times, &BOUNDS, layout).map(|_| ()).map_err(|error| error.to_string())
        };
        let planes = || zeros([good.cells(), 4]);
        assert_eq!(ask(planes(), zeros([5, 3]), zeros([5, 1]), &good), Ok(()));
        let message = |result: Result<(), String>| result.expect_err("the argument is wrong");
        assert!(message(ask(zeros([3, 4]), zeros([5, 3]), zeros([5, 1]), &good)).contains("`planes`"));
        assert!(message(ask(planes(), zeros([5, 2]), zeros([5, 1]), &good)).contains("`points`"));
        assert!(message(ask(planes(), zeros([5, 3]), zeros([4, 1]), &good)).contains("`times`"));
        let wide = zeros([5, 3]).cast(DType::F64);
        assert!(message(ask(planes(), wide, zeros([5, 1]), &good)).contains("F64"));
        let empty = GridLayout { multipliers: vec![], ..good.clone() };
        assert!(message(ask(planes(), zeros([5, 3]), zeros([5, 1]), &empty)).contains("empty"));
    });
}

#[cfg(all(feature = "flex", feature = "ndarray"))]
#[test]
fn arguments_on_two_devices_are_named() {
    let [own, other] = crate::test_support::two_devices();
    let layout = layout(4);
    let ask = |of_points: &Device, of_times: &Device| {
        let planes = Tensor::zeros([layout.cells(), 4], &own);
        let (points, times) = (Tensor::zeros([5, 3], of_points), Tensor::zeros([5, 1], of_times));
        look_up(planes, points, times, &BOUNDS, &layout).map(|_| ()).map_err(|error| error.to_string())
    };
    assert_eq!(ask(&own, &own), Ok(()));
    for (argument, of_points, of_times) in [("points", &other, &own), ("times", &own, &other)] {
        let said = ask(of_points, of_times).expect_err("two devices");
        assert!(said.starts_with(&format!("`{argument}` is on another device than `planes`")), "{said}");
    }
}

/// Weights of the penalties.
const WEIGHTS: [f64; 3] = [0.7, 2.0, 1.3];

/// The three terms, and the adjoint of the planes for their sum with unequal weights.
fn run_penalties(
    values: &[f64],
    layout: &GridLayout,
    device: &Device,
    dtype: DType,
    penalties: impl Fn(Tensor<2>) -> regulariser::GridPenalties,
) -> [Vec<f64>; 2] {
    let device = &device.clone().autodiff();
    let data = TensorData::new(values.to_vec(), [layout.cells(), layout.features]);
    let planes = Tensor::<2>::from_data(data, (device, dtype)).require_grad();
    let found = penalties(planes.clone());
    let terms = [found.plane_smooth, found.time_smooth, found.l1_time];
    let total = terms.clone().into_iter().zip(WEIGHTS).map(|(term, weight)| term * weight);
    let gradients = total.reduce(|a, b| a + b).expect("three terms").backward();
    let gradient = numbers(planes.grad(&gradients).expect("tracked"));
    [terms.into_iter().flat_map(|term| numbers(term.inner())).collect(), gradient]
}

#[test]
fn penalties_are_their_reference() {
    for_each_device(|device| {
        let lower = GridLayout { features: 7, resolution: [3, 2, 4, 2], multipliers: vec![1, 3] };
        for layout in [layout(16), layout(3), lower] {
            let mut values = random(1, layout.cells() * layout.features);
            values.iter_mut().for_each(|value| *value += 0.5);
            values.iter_mut().step_by(5).for_each(|value| *value = 1.0);
            let wanted = run_penalties(&values, &layout, &device, DType::F64, |p| reference::penalties(p, &layout));
            for (dtype, tolerance) in [(DType::F64, EXACT), (DType::F32, SINGLE)] {
                let op = |planes| regulariser::penalties(planes, &layout).expect("the planes fit");
                let found = run_penalties(&values, &layout, &device, dtype, op);
                for (found, wanted) in found.iter().zip(&wanted) {
                    assert_close(found, wanted, tolerance, &format!("{dtype:?} {layout:?}"));
                }
            }
        }
    });
}

#[test]
fn a_weighted_penalty_is_the_sum_of_the_weighted_terms() {
    for_each_device(|device| {
        let layout = layout(3);
        let values = random(1, layout.cells() * layout.features);
        let op = |planes| regulariser::penalties(planes, &layout).expect("the planes fit");
        let [terms, gradient] = run_penalties(&values, &layout, &device, DType::F64, op);
        let data = TensorData::new(values, [layout.cells(), layout.features]);
        let planes = Tensor::<2>::from_data(data, (&device.autodiff(), DType::F64)).require_grad();
        let penalty = regulariser::weighted_penalty(planes.clone(), &layout, WEIGHTS).expect("the planes fit");
        let sum: f64 = terms.iter().zip(WEIGHTS).map(|(term, weight)| term * weight).sum();
        assert_close(&numbers(penalty.clone().inner()), &[sum], EXACT, "the sum");
        let found = numbers(planes.grad(&penalty.backward()).expect("tracked"));
        assert_close(&found, &gradient, EXACT, "its adjoint");
    });
}
