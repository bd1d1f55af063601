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
            forward(input, parameters, &self.layout).expect("the arguments fit")
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
            let outputs = forward(input.clone(), parameters.clone(), &layout).expect("the arguments fit");
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
        let parameters = Tensor::<1>::zeros([layout.parameters()], &device);
        let refusal = |input: &Tensor<2>, parameters: &Tensor<1>, layout: &MlpLayout| {
            forward(input.clone(), parameters.clone(), layout).expect_err("it does not fit").to_string()
        };
        assert_eq!(
            refusal(&Tensor::zeros([2, 6], &device), &parameters, &layout),
            "`input` has shape [2, 6]; expected [N, 7]"
        );
        assert!(refusal(&input, &Tensor::zeros([5], &device), &layout).starts_with("`parameters` has shape [5]"));
        assert!(refusal(&input.clone().cast(DType::F64), &parameters, &layout).contains("has dtype F64"));
        let without = MlpLayout { chains: vec![vec![]], ..layout };
        assert!(refusal(&input, &parameters, &without).contains("is empty"));
    });
}
