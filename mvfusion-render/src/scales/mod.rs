//! The cost of Gaussians that are large or elongated (METHOD §4.4).

mod cpu;
pub(crate) mod op;

use burn::tensor::Tensor;

/// Weights and thresholds of the two terms.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ScaleRule {
    /// Weight of the largest scale of a Gaussian.
    pub large: f64,
    /// Scale above which it counts, in world units.
    pub large_above: f64,
    /// Weight of the ratio of the largest to the smallest scale.
    pub spiky: f64,
    /// Ratio above which it counts.
    pub spiky_above: f64,
}

/// `mean(large max(s - large_above, 0) + spiky max(r - spiky_above, 0))` over the log-scales `[N, 3]`, f32, or f64 on a
/// CPU: `[1]`. `s` is the largest scale of a Gaussian and `r` its ratio to the smallest. Of equal scales, the first has
/// the gradient. No Gaussians cost nothing.
///
/// # Panics
/// If a Gaussian does not have three scales, or the dtype is not f32, or f64 on a CPU.
pub fn cost(log_scales: Tensor<2>, rule: ScaleRule) -> Tensor<1> {
    let [count, axes] = log_scales.dims();
    assert_eq!(axes, 3, "a Gaussian has three scales");
    let share = 1.0 / count.max(1) as f64;
    let rule = ScaleRule { large: rule.large * share, spiky: rule.spiky * share, ..rule };
    op::cost(log_scales, rule)
}

#[cfg(test)]
mod tests {
    use burn::tensor::{DType, Device, TensorData};

    use super::*;
    use crate::test_support::{for_each_device, numbers, random};

    const RULE: ScaleRule = ScaleRule { large: 3.0, large_above: 0.5, spiky: 2.0, spiky_above: 4.0 };

    /// More than a task, with small, large and elongated Gaussians.
    const COUNT: usize = 10_000;

    fn log_scales(device: &Device) -> Tensor<2> {
        let values: Vec<f64> = random(5, 3 * COUNT).into_iter().map(|value| 4.0 * value - 3.0).collect();
        Tensor::from_data(TensorData::new(values, [COUNT, 3]), (device, DType::F64)).require_grad()
    }

    /// The same by tensor operations.
    fn composed(log_scales: &Tensor<2>) -> Tensor<1> {
        let [most, least] = [log_scales.clone().max_dim(1), log_scales.clone().min_dim(1)];
        let large = (most.clone().exp() - RULE.large_above).clamp_min(0.0).mean();
        let spiky = ((most - least).exp() - RULE.spiky_above).clamp_min(0.0).mean();
        large * RULE.large + spiky * RULE.spiky
    }

    #[test]
    fn cost_and_adjoint_are_those_of_tensor_operations() {
        for_each_device(|device| {
            let log_scales = log_scales(&device.autodiff());
            let of = |cost: Tensor<1>| {
                let gradients = (cost.clone() * 0.5).backward();
                (numbers(cost.inner())[0], numbers(log_scales.grad(&gradients).expect("tracked")))
            };
            let (found, v_found) = of(cost(log_scales.clone(), RULE));
            let (wanted, v_wanted) = of(composed(&log_scales));
            assert!((found - wanted).abs() < 1e-12 * wanted, "{found}, expected {wanted}");
            assert!(v_found.iter().zip(&v_wanted).all(|(a, b)| (a - b).abs() < 1e-15), "gradients differ");
            assert!(v_wanted.iter().any(|v| *v > 0.0) && v_wanted.iter().any(|v| *v < 0.0));
        });
    }

    #[test]
    fn no_gaussians_cost_nothing() {
        for_each_device(|device| assert_eq!(numbers(cost(Tensor::zeros([0, 3], &device), RULE)), [0.0]));
    }

    #[test]
    fn a_term_without_weight_adds_nothing_where_it_is_infinite() {
        for_each_device(|device| {
            let device = device.autodiff();
            let needle = Tensor::<2>::from_floats([[0.0, 90.0, -90.0]], &device).require_grad();
            let cost = cost(needle.clone(), ScaleRule { large: 0.0, spiky: 0.0, ..RULE });
            assert_eq!(numbers(cost.clone().inner()), [0.0]);
            assert_eq!(numbers(needle.grad(&cost.backward()).expect("tracked")), [0.0; 3]);
        });
    }

    #[test]
    fn of_equal_scales_the_first_has_the_gradient() {
        for_each_device(|device| {
            let device = device.autodiff();
            let equal = Tensor::<2>::from_floats([[1.0, 1.0, 1.0]], &device).require_grad();
            let gradients = cost(equal.clone(), ScaleRule { spiky_above: 0.5, ..RULE }).backward();
            let e = 1f64.exp();
            let found = numbers(equal.grad(&gradients).expect("tracked"));
            assert!((found[0] - 3.0 * e).abs() < 1e-5 && found[1..] == [0.0, 0.0], "{found:?}");
        });
    }
}
