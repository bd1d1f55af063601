//! The op against tensor operations and hostile input, on every CPU backend.

use burn::tensor::{DType, Device, Tensor, TensorData, activation::relu};

use super::*;
use crate::test_support::{assert_parts_close, for_each_device, numbers, random};

/// Sums over dozens of columns and hundreds of rows, in f64 and f32, relative to the largest value.
const EXACT: f64 = 1e-12;
const SINGLE: f64 = 2e-5;

struct Case {
    input: Vec<f64>,
    parameters: Vec<f64>,
    cotangent: Vec<f64>,
    layout: MlpLayout,
}

fn bundle(rectified: bool) -> MlpLayout {
    MlpLayout { inputs: 7, rectified, chains: vec![vec![12, 3], vec![5], vec![9, 8, 1], vec![6, 4]] }
}

impl Case {
    fn random(layout: MlpLayout, rows: usize) -> Self {
        let spread = |seed, count| random(seed, count).iter().map(|x| x - 0.5).collect();
        Self {
            input: spread(1, rows * layout.inputs),
            parameters: spread(2, layout.parameters()),
            cotangent: spread(3, rows * layout.outputs()),
            layout,
        }
    }

    /// Outputs, then the adjoints of input and parameters.
    fn run(&self, device: &Device, dtype: DType, forward: impl Fn(Tensor<2>, Tensor<1>) -> Tensor<2>) -> [Vec<f64>; 3] {
        let device = &device.clone().autodiff();
        let matrix = |values: &[f64], columns: usize| {
            let data = TensorData::new(values.to_vec(), [values.len() / columns, columns]);
            Tensor::<2>::from_data(data, (device, dtype))
        };
        let input = matrix(&self.input, self.layout.inputs).require_grad();
        let parameters = TensorData::new(self.parameters.clone(), [self.parameters.len()]);
        let parameters = Tensor::<1>::from_data(parameters, (device, dtype)).require_grad();
        let outputs = forward(input.clone(), parameters.clone());
        let gradients = (outputs.clone() * matrix(&self.cotangent, self.layout.outputs())).sum().backward();
        [
            numbers(outputs.inner()),
            numbers(input.grad(&gradients).expect("tracked")),
            numbers(parameters.grad(&gradients).expect("tracked")),
        ]
    }

    fn op(&self, device: &Device, dtype: DType) -> [Vec<f64>; 3] {
        self.run(device, dtype, |input, parameters| {
            let layers = Layer::all_of(&parameters, &self.layout);
            forward(input, layers, &self.layout).expect("the arguments fit")
        })
    }

    fn reference(&self, device: &Device) -> [Vec<f64>; 3] {
        self.run(device, DType::F64, |input, parameters| written_out(input, parameters, &self.layout))
    }
}

/// The same computation with tensor operations.
fn written_out(input: Tensor<2>, parameters: Tensor<1>, layout: &MlpLayout) -> Tensor<2> {
    let input = if layout.rectified { relu(input) } else { input };
    let mut at = 0;
    let mut take = |count: usize| {
        at += count;
        parameters.clone().narrow(0, at - count, count)
    };
    let mut columns = Vec::new();
    for widths in &layout.chains {
        let mut rows = input.clone();
        for (index, &outputs) in widths.iter().enumerate() {
            let inputs = rows.dims()[1];
            let rectified = if index > 0 { relu(rows) } else { rows };
            let product = rectified.matmul(take(inputs * outputs).reshape([inputs, outputs]));
            rows = product + take(outputs).reshape([1, outputs]);
        }
        columns.push(rows);
    }
    Tensor::cat(columns, 1)
}

#[test]
fn outputs_and_gradients_are_those_of_tensor_operations() {
    for_each_device(|device| {
        // One row, part of a block, several blocks, several parts.
        for rows in [1, 40, 600, 2500] {
            for rectified in [false, true] {
                let case = Case::random(bundle(rectified), rows);
                let wanted = case.reference(&device);
                let what = format!("{rows} rows, rectified {rectified}");
                assert_parts_close(&case.op(&device, DType::F64), &wanted, EXACT, &what);
                assert_parts_close(&case.op(&device, DType::F32), &wanted, SINGLE, &what);
            }
        }
    });
}

#[test]
fn a_relu_has_no_slope_at_zero() {
    for_each_device(|device| {
        let layout = MlpLayout { inputs: 1, rectified: true, chains: vec![vec![2, 1]] };
        // Hidden units 0 and 1 of an input of zero: both adjoints stop there.
        let case = Case {
            input: vec![0.0],
            parameters: vec![1.0, 1.0, 0.0, 1.0, 1.0, 1.0, 0.0],
            cotangent: vec![1.0],
            layout,
        };
        let [outputs, input, parameters] = case.op(&device, DType::F64);
        assert_eq!(outputs, [1.0]);
        assert_eq!(input, [0.0]);
        assert_eq!(parameters, [0.0, 0.0, 0.0, 1.0, 0.0, 1.0, 1.0]);
    });
}

#[test]
fn no_row_gives_no_row() {
    for_each_device(|device| {
        let [outputs, input, parameters] = Case::random(bundle(true), 0).op(&device, DType::F32);
        assert!(outputs.is_empty() && input.is_empty());
        assert!(parameters.iter().all(|&v| v == 0.0));
    });
}

#[test]
fn the_number_of_threads_changes_no_bit() {
    for_each_device(|device| {
        let case = Case::random(bundle(true), 2500);
        let with = |threads: usize| {
            let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().expect("a pool");
            pool.install(|| case.op(&device, DType::F32))
        };
        assert_eq!(with(1), with(3));
    });
}

#[test]
fn adjoints_that_nobody_waits_for_are_left_out() {
    for_each_device(|device| {
        let device = device.autodiff();
        let layout = bundle(false);
        let input = Tensor::<2>::ones([3, layout.inputs], &device);
        let parameters = Tensor::<1>::ones([layout.parameters()], &device);
        for tracked in 0..2 {
            let input = if tracked == 0 { input.clone().require_grad() } else { input.clone() };
            let parameters = if tracked == 1 { parameters.clone().require_grad() } else { parameters.clone() };
            let layers = Layer::all_of(&parameters, &layout);
            let outputs = forward(input.clone(), layers, &layout).expect("the arguments fit");
            let gradients = outputs.sum().backward();
            assert_eq!(input.grad(&gradients).is_some(), tracked == 0);
            assert_eq!(parameters.grad(&gradients).is_some(), tracked == 1);
        }
    });
}

#[test]
fn what_does_not_fit_is_refused() {
    for_each_device(|device| {
        let layout = bundle(false);
        let input = Tensor::<2>::zeros([2, layout.inputs], &device);
        let layers = Layer::all_of(&Tensor::zeros([layout.parameters()], &device), &layout);
        let refusal = |input: &Tensor<2>, layers: &[Layer], layout: &MlpLayout| {
            forward(input.clone(), layers.to_vec(), layout).expect_err("it does not fit").to_string()
        };
        let with = |change: &dyn Fn(&mut Layer)| {
            let mut layers = layers.clone();
            change(&mut layers[1]);
            refusal(&input, &layers, &layout)
        };
        assert_eq!(
            refusal(&Tensor::zeros([2, 6], &device), &layers, &layout),
            "`input` has shape [2, 6]; expected [N, 7]"
        );
        assert_eq!(
            with(&|layer| layer.weight = Tensor::zeros([3, 12], &device)),
            "`weight` has shape [3, 12]; expected [12, 3]"
        );
        assert_eq!(with(&|layer| layer.bias = Tensor::zeros([5], &device)), "`bias` has shape [5]; expected [3]");
        assert!(with(&|layer| layer.bias = layer.bias.clone().cast(DType::F64)).contains("has dtype F64"));
        assert!(refusal(&input.clone().cast(DType::F64), &layers, &layout).contains("has dtype F64"));
        assert!(refusal(&input, &layers[1..], &layout).starts_with("`layers` has 7 layers; expected 8"));
        let deep = MlpLayout { inputs: 7, rectified: false, chains: vec![vec![7; MAX_LAYERS + 1]] };
        let layers_of_it = Layer::all_of(&Tensor::zeros([deep.parameters()], &device), &deep);
        assert!(refusal(&input, &layers_of_it, &deep).contains("64 at most"));
        let without = MlpLayout { chains: vec![vec![]], ..layout.clone() };
        assert!(refusal(&input, &layers, &without).contains("is empty"));
    });
}

#[cfg(all(feature = "flex", feature = "ndarray"))]
#[test]
fn arguments_on_two_devices_are_refused() {
    let [own, other] = crate::test_support::two_devices();
    let layout = bundle(false);
    let input = Tensor::<2>::zeros([2, layout.inputs], &own);
    let layers = Layer::all_of(&Tensor::zeros([layout.parameters()], &own), &layout);
    let elsewhere = Layer::all_of(&Tensor::zeros([layout.parameters()], &other), &layout);
    let refusal = |layers: Vec<Layer>| forward(input.clone(), layers, &layout).expect_err("two devices").to_string();
    let mut mixed = layers.clone();
    mixed[1].weight = elsewhere[1].weight.clone();
    assert!(refusal(mixed).starts_with("`weight` is on another device than `input`"));
    let mut mixed = layers;
    mixed[1].bias = elsewhere[1].bias.clone();
    assert!(refusal(mixed).starts_with("`bias` is on another device than `input`"));
}

#[test]
fn nan_passes_the_relu_of_its_row() {
    for_each_device(|device| {
        let layout = bundle(true);
        let mut values = vec![1.0; 2 * layout.inputs];
        values[0] = f64::NAN;
        let input = Tensor::<2>::from_data(TensorData::new(values, [2, layout.inputs]), (&device, DType::F64));
        let parameters = Tensor::<1>::ones([layout.parameters()], (&device, DType::F64));
        let outputs = forward(input, Layer::all_of(&parameters, &layout), &layout).expect("the arguments fit");
        let outputs = numbers(outputs);
        let (first, second) = outputs.split_at(outputs.len() / 2);
        assert!(first.iter().all(|x| x.is_nan()) && second.iter().all(|x| x.is_finite()), "{outputs:?}");
    });
}

#[test]
fn every_layer_has_its_own_gradient() {
    for_each_device(|device| {
        let device = device.autodiff();
        let layout = MlpLayout { inputs: 2, rectified: false, chains: vec![vec![3; MAX_LAYERS - 1], vec![1]] };
        let flat = Tensor::<1>::from_data(
            TensorData::new(random(5, layout.parameters()), [layout.parameters()]),
            (&device, DType::F64),
        );
        let layers: Vec<Layer> = Layer::all_of(&flat, &layout)
            .into_iter()
            .map(|Layer { weight, bias }| Layer { weight: weight.require_grad(), bias: bias.require_grad() })
            .collect();
        let flat = flat.require_grad();
        let input = Tensor::<2>::from_data(TensorData::new(random(6, 10), [5, 2]), (&device, DType::F64));
        let wanted = written_out(input.clone(), flat.clone(), &layout).sum().backward();
        let wanted = numbers(flat.grad(&wanted).expect("tracked"));
        let found = forward(input, layers.clone(), &layout).expect("the arguments fit").sum().backward();
        let found: Vec<f64> = layers
            .iter()
            .flat_map(|Layer { weight, bias }| {
                let weight = numbers(weight.grad(&found).expect("tracked"));
                [weight, numbers(bias.grad(&found).expect("tracked"))].concat()
            })
            .collect();
        assert_eq!(found.len(), wanted.len());
        let largest = wanted.iter().fold(0.0f64, |largest, x| largest.max(x.abs()));
        assert!(found.iter().zip(&wanted).all(|(a, b)| (a - b).abs() <= EXACT * largest));
    });
}
