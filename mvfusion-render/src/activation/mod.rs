//! Activations of logits, each as one launch on a GPU: the sigmoid, and the foreground's share of a mask (METHOD §1.4).

mod cpu;
pub(crate) mod op;

use burn::tensor::Tensor;

/// Added to the sum of the mask probabilities, so that it is no divisor of 0 (METHOD §1.4).
pub const SHARE_EPSILON: f64 = 1e-6;

/// Distance of a share from 0 and 1 (METHOD §1.4). It keeps shares above 0, and so their logarithms and reciprocals
/// finite. At the other end it changes nothing: [`SHARE_EPSILON`] keeps shares about 1e-6 below 1, and in f32
/// `1 - 1e-9` is 1.
pub const SHARE_MARGIN: f64 = 1e-9;

/// The logistic function `1 / (1 + exp(-x))` of each number, f32, or f64 on a CPU.
///
/// # Panics
/// If the dtype is another one.
// Burn computes it in six operations on a GPU, and its adjoint in four.
pub fn sigmoid<const D: usize>(logits: Tensor<D>) -> Tensor<D> {
    op::logistic(logits)
}

/// Share of the foreground in the mask of each Gaussian: `clamp(u_d / (u_d + u_s + e))`, `[N, 1]`, where `u` are the
/// sigmoids of the mask logits `[N, C]`, `s` and `d` are the `channels` of the static and the dynamic branch, and `e` is
/// [`SHARE_EPSILON`]. It is f32, or f64 on a CPU, and has no gradient.
///
/// # Panics
/// If a channel is not below C, or the dtype is another one.
pub fn foreground_share(mask_logits: Tensor<2>, channels: [usize; 2]) -> Tensor<2> {
    let [_, columns] = mask_logits.dims();
    assert!(channels.iter().all(|&channel| channel < columns), "channels {channels:?} of {columns} columns");
    op::foreground_share(mask_logits, channels)
}

#[cfg(test)]
mod tests {
    use burn::tensor::{DType, Device, TensorData, activation};

    use super::*;
    use crate::test_support::{for_each_device, numbers, random};

    /// More than a task.
    const COUNT: usize = 10_000;

    /// Numbers in -20 to 20 in columns.
    fn logits(columns: usize, device: &Device) -> Tensor<2> {
        let values: Vec<f64> = random(7, columns * COUNT).into_iter().map(|value| 40.0 * value - 20.0).collect();
        Tensor::from_data(TensorData::new(values, [COUNT, columns]), (device, DType::F64))
    }

    #[test]
    fn sigmoid_and_adjoint_are_those_of_burn() {
        for_each_device(|device| {
            let device = device.autodiff();
            let weights = logits(2, &device).flip([0]);
            let of = |sigmoid: fn(Tensor<2>) -> Tensor<2>| {
                let logits = logits(2, &device).require_grad();
                let found = sigmoid(logits.clone());
                let gradients = (found.clone() * weights.clone()).sum().backward();
                (numbers(found.inner()), numbers(logits.grad(&gradients).expect("tracked")))
            };
            let (found, v_found) = of(sigmoid);
            let (wanted, v_wanted) = of(activation::sigmoid);
            // Burn rounds to single precision on the way, and the weights are up to 20.
            let near = |found: &[f64], wanted: &[f64]| found.iter().zip(wanted).all(|(a, b)| (a - b).abs() < 1e-5);
            assert!(near(&found, &wanted) && near(&v_found, &v_wanted));
            assert!(v_wanted.iter().any(|v| v.abs() > 1.0), "gradients reach the logits");
        });
    }

    #[test]
    fn a_sigmoid_saturates_without_overflow() {
        for_each_device(|device| {
            let logits = Tensor::<1>::from_floats([-200.0, -90.0, 0.0, 90.0, 200.0], &device);
            let found = numbers(sigmoid(logits));
            assert!(found[1] < 1e-38, "{found:?}");
            assert_eq!([found[0], found[2], found[3], found[4]], [0.0, 0.5, 1.0, 1.0]);
        });
    }

    #[test]
    fn a_share_is_that_of_tensor_operations() {
        for_each_device(|device| {
            let logits = logits(3, &device);
            let found = numbers(foreground_share(logits.clone(), [0, 2]));
            let probabilities = activation::sigmoid(logits);
            let [static_, dynamic] = [0, 2].map(|channel| probabilities.clone().narrow(1, channel, 1));
            let wanted =
                (dynamic.clone() / (dynamic + static_ + SHARE_EPSILON)).clamp(SHARE_MARGIN, 1.0 - SHARE_MARGIN);
            assert!(found.iter().zip(&numbers(wanted)).all(|(a, b)| (a - b).abs() < 1e-6));
            assert!(found.iter().any(|&share| share < 0.01) && found.iter().any(|&share| share > 0.99));
        });
    }

    #[test]
    fn a_share_is_clamped_and_no_gaussians_have_none() {
        for_each_device(|device| {
            let surely_static = Tensor::<2>::from_floats([[9.0, 0.0, -99.0]], &device);
            assert!((numbers(foreground_share(surely_static, [0, 2]))[0] - SHARE_MARGIN).abs() < 1e-15);
            assert!(numbers(foreground_share(Tensor::zeros([0, 3], &device), [0, 2])).is_empty());
        });
    }
}
