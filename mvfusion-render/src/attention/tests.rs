//! The op against tensor operations and hostile input, on every CPU backend.

use burn::tensor::{DType, Device, Tensor, TensorData, activation::softmax};

use super::*;
use crate::test_support::{assert_parts_close, for_each_device, numbers, random};

/// Sums over a few dozen columns, in f64 and f32, relative to the largest value.
const EXACT: f64 = 1e-13;
const SINGLE: f64 = 5e-6;

/// Rows, queries, keys, heads, columns of a head.
#[derive(Clone, Copy, Debug)]
struct Case([usize; 5]);

impl Case {
    /// The result, then the adjoints of queries and memory.
    fn run(
        self,
        device: &Device,
        dtype: DType,
        forward: impl Fn(Tensor<3>, Tensor<3>, usize) -> Tensor<3>,
    ) -> [Vec<f64>; 3] {
        let Self([rows, count, keys, heads, depth]) = self;
        let width = heads * depth;
        let device = &device.clone().autodiff();
        // Values in -3 to 3, so that some weights are close to 0 and 1.
        let spread = |seed, count| random(seed, count).iter().map(|x| 6.0 * x - 3.0).collect::<Vec<f64>>();
        let queries = TensorData::new(spread(1, rows * count * width), [rows, count, width]);
        let memory = TensorData::new(spread(2, rows * keys * 2 * width), [rows, keys, 2 * width]);
        let cotangent = TensorData::new(spread(3, rows * count * width), [rows, count, width]);
        let queries = Tensor::<3>::from_data(queries, (device, dtype)).require_grad();
        let memory = Tensor::<3>::from_data(memory, (device, dtype)).require_grad();
        let found = forward(queries.clone(), memory.clone(), heads);
        let gradients = (found.clone() * Tensor::<3>::from_data(cotangent, (device, dtype))).sum().backward();
        [
            numbers(found.inner()),
            numbers(queries.grad(&gradients).expect("tracked")),
            numbers(memory.grad(&gradients).expect("tracked")),
        ]
    }

    fn op(self, device: &Device, dtype: DType) -> [Vec<f64>; 3] {
        self.run(device, dtype, |queries, memory, heads| forward(queries, memory, heads).expect("the arguments fit"))
    }
}

/// The same computation with tensor operations.
fn written_out(queries: Tensor<3>, memory: Tensor<3>, heads: usize) -> Tensor<3> {
    let ([rows, keys, both], count) = (memory.dims(), queries.dims()[1]);
    let (width, depth) = (both / 2, both / 2 / heads);
    let part = |first| memory.clone().narrow(2, first, width).reshape([rows, 1, keys, heads, depth]);
    // No division by the root: Burn's adjoint of a division by a scalar rounds the scalar to f32.
    let scale = 1.0 / (depth as f64).sqrt();
    let scores = (queries.reshape([rows, count, 1, heads, depth]) * part(0)).sum_dim(4) * scale;
    (softmax(scores, 2) * part(width)).sum_dim(2).reshape([rows, count, width])
}

#[test]
fn results_and_gradients_are_those_of_tensor_operations() {
    for_each_device(|device| {
        // One key, which gets all the weight; heads narrower and wider than the partial sums; several blocks; one query
        // and several.
        let cases = [[3, 1, 1, 1, 5], [70, 1, 2, 4, 16], [65, 1, 3, 2, 11], [200, 1, 10, 1, 8], [70, 3, 3, 2, 9]];
        for case in cases.map(Case) {
            let wanted = case.run(&device, DType::F64, written_out);
            let what = format!("{case:?}");
            assert_parts_close(&case.op(&device, DType::F64), &wanted, EXACT, &what);
            assert_parts_close(&case.op(&device, DType::F32), &wanted, SINGLE, &what);
        }
    });
}

#[test]
fn scores_beyond_the_range_of_the_exponential_do_no_harm() {
    for_each_device(|device| {
        let queries = Tensor::<3>::from_data([[[1e4f32]]], &device);
        let memory = Tensor::<3>::from_data([[[1.0f32, 2.0], [-1.0, 5.0]]], &device);
        assert_eq!(numbers(forward(queries, memory, 1).expect("the arguments fit")), [2.0]);
    });
}

#[test]
fn no_row_gives_no_row() {
    for_each_device(|device| {
        let [found, queries, memory] = Case([0, 1, 2, 2, 4]).op(&device, DType::F32);
        assert!(found.is_empty() && queries.is_empty() && memory.is_empty());
    });
}

#[test]
fn the_number_of_threads_changes_no_bit() {
    for_each_device(|device| {
        let with = |threads: usize| {
            let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().expect("a pool");
            pool.install(|| Case([500, 3, 2, 4, 8]).op(&device, DType::F32))
        };
        assert_eq!(with(1), with(3));
    });
}

#[test]
fn what_does_not_fit_is_refused() {
    for_each_device(|device| {
        let queries = Tensor::<3>::zeros([5, 1, 8], &device);
        let refusal = |queries: &Tensor<3>, memory: [usize; 3], heads| {
            let memory = Tensor::zeros(memory, &device);
            forward(queries.clone(), memory, heads).expect_err("it does not fit").to_string()
        };
        assert_eq!(
            refusal(&queries, [5, 2, 8], 2),
            "`memory` has shape [5, 2, 8]; expected [5, keys, 16] with at least one key"
        );
        let none = Tensor::<3>::zeros([5, 0, 8], &device);
        assert_eq!(
            refusal(&none, [5, 2, 16], 2),
            "`queries` has shape [5, 0, 8]; expected [rows, queries, width] with at least one query"
        );
        assert!(refusal(&queries, [5, 0, 16], 2).starts_with("`memory` has shape [5, 0, 16]"));
        assert!(refusal(&queries, [4, 2, 16], 2).starts_with("`memory` has shape [4, 2, 16]"));
        assert!(refusal(&queries, [5, 2, 16], 3).starts_with("3 heads cannot divide 8 columns"));
        assert!(refusal(&queries, [5, 2, 16], 0).starts_with("0 heads"));
        assert!(refusal(&queries.clone().cast(DType::F64), [5, 2, 16], 2).contains("has dtype F64"));
    });
}

#[cfg(all(feature = "flex", feature = "ndarray"))]
#[test]
fn arguments_on_two_devices_are_refused() {
    let [own, other] = crate::test_support::two_devices();
    let queries = Tensor::<3>::zeros([5, 1, 8], &own);
    let memory = Tensor::<3>::zeros([5, 2, 16], &other);
    let said = forward(queries, memory, 2).expect_err("two devices").to_string();
    assert_eq!(said, "`memory` is on another device than `queries`: move both to one device");
}
