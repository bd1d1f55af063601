//! Adam for parameters whose rows are added and removed. The moments are plain tensors that the trainer owns.

mod cpu;
pub(crate) mod op;

use burn::tensor::Tensor;

/// Adam's constants (METHOD §4.5).
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct AdamRule {
    /// Learning rate.
    pub learning_rate: f64,
    /// Decay of the first moment.
    pub beta1: f64,
    /// Decay of the second moment.
    pub beta2: f64,
    /// Added to the square root of the second moment.
    pub epsilon: f64,
}

impl AdamRule {
    /// The rule of METHOD §4.5 with the given learning rate.
    pub fn new(learning_rate: f64) -> Self {
        Self { learning_rate, ..Self::default() }
    }
}

impl Default for AdamRule {
    /// The constants of METHOD §4.5, and a learning rate of 1e-3.
    fn default() -> Self {
        Self { learning_rate: 1e-3, beta1: 0.9, beta2: 0.999, epsilon: 1e-15 }
    }
}

/// Adam's state of a parameter.
#[derive(Clone, Debug)]
pub struct AdamMoments<const D: usize> {
    /// Running mean of the gradient, in the parameter's shape.
    pub first: Tensor<D>,
    /// Running mean of the squared gradient, in the parameter's shape.
    pub second: Tensor<D>,
    /// Number of steps so far.
    pub steps: usize,
}

impl<const D: usize> AdamMoments<D> {
    /// The initial state of a parameter like `value`.
    pub fn zeros_like(value: &Tensor<D>) -> Self {
        Self { first: Tensor::zeros_like(value), second: Tensor::zeros_like(value), steps: 0 }
    }
}

/// A parameter before a step of Adam.
#[derive(Clone, Debug)]
pub struct AdamStep<const D: usize> {
    /// The values.
    pub value: Tensor<D>,
    /// Their gradient.
    pub gradient: Tensor<D>,
    /// The moments after the previous step.
    pub moments: AdamMoments<D>,
    /// The rule of this step.
    pub rule: AdamRule,
}

/// A parameter after a step of Adam.
#[derive(Clone, Debug)]
pub struct Stepped<const D: usize> {
    /// The values.
    pub value: Tensor<D>,
    /// The moments.
    pub moments: AdamMoments<D>,
}

/// One step of Adam as in PyTorch for each of some parameters, in the same order: both moments are bias-corrected, and
/// epsilon is added after the correction of the second. Unlike there, a finite gradient counts as
/// [`LARGEST_GRADIENT`](mvfusion_kernels::adam::LARGEST_GRADIENT) at most: the square of a larger one may overflow, and an
/// infinite moment never decays.
///
/// The four tensors of a parameter have the same shape, all tensors have the same dtype (f32, or f64 on a CPU), and they
/// are outside of autodiff. Unshared memory is changed in place, so pass the tensors themselves, not clones. On a CPU,
/// all parameters are stepped in one parallel loop.
///
/// # Panics
/// If the shapes of a parameter's tensors differ, or a dtype is not f32, or f64 on a CPU.
pub fn adam_steps<const D: usize>(parameters: Vec<AdamStep<D>>) -> Vec<Stepped<D>> {
    for AdamStep { value, gradient, moments, rule: _ } in &parameters {
        for other in [gradient, &moments.first, &moments.second] {
            assert_eq!(other.dims(), value.dims(), "a parameter, its gradient and its moments are of one shape");
        }
    }
    if parameters.is_empty() { Vec::new() } else { op::adam_steps(parameters) }
}

/// The same for one parameter.
///
/// # Panics
/// As [`adam_steps`].
pub fn adam_step<const D: usize>(
    value: Tensor<D>,
    gradient: Tensor<D>,
    moments: AdamMoments<D>,
    rule: &AdamRule,
) -> (Tensor<D>, AdamMoments<D>) {
    let mut stepped = adam_steps(vec![AdamStep { value, gradient, moments, rule: *rule }]);
    let Stepped { value, moments } = stepped.remove(0);
    (value, moments)
}

#[cfg(test)]
mod tests {
    use burn::tensor::{DType, Device, TensorData};

    use super::*;
    use crate::test_support::{for_each_device, numbers, random};

    /// A few rounding errors on numbers of size one.
    const EXACT: f64 = 1e-14;
    const SINGLE: f64 = 1e-6;

    fn tensor(values: &[f64], device: &Device, dtype: DType) -> Tensor<2> {
        Tensor::from_data(TensorData::new(values.to_vec(), [values.len() / 3, 3]), (device, dtype))
    }

    /// The textbook rule for one number.
    fn textbook(mut value: f64, gradients: &[f64], rule: &AdamRule) -> f64 {
        let (mut first, mut second) = (0.0, 0.0);
        for (i, gradient) in gradients.iter().enumerate() {
            let step = i as i32 + 1;
            first = rule.beta1 * first + (1.0 - rule.beta1) * gradient;
            second = rule.beta2 * second + (1.0 - rule.beta2) * gradient * gradient;
            let corrected = (second / (1.0 - rule.beta2.powi(step))).sqrt();
            value -= rule.learning_rate * first / (1.0 - rule.beta1.powi(step)) / (corrected + rule.epsilon);
        }
        value
    }

    #[test]
    fn steps_follow_the_textbook() {
        const NUMBERS: usize = 3 * 7001;
        let rule = AdamRule { learning_rate: 0.05, epsilon: 1e-3, ..AdamRule::default() };
        let start = random(1, NUMBERS);
        let gradients: Vec<Vec<f64>> =
            (2..5).map(|seed| random(seed, NUMBERS).iter().map(|x| x - 0.5).collect()).collect();
        for_each_device(|device| {
            for (dtype, tolerance) in [(DType::F64, EXACT), (DType::F32, SINGLE)] {
                let mut value = tensor(&start, &device, dtype);
                let mut moments = AdamMoments::zeros_like(&value);
                for gradient in &gradients {
                    (value, moments) = adam_step(value, tensor(gradient, &device, dtype), moments, &rule);
                }
                assert_eq!(moments.steps, 3);
                for (i, found) in numbers(value).into_iter().enumerate() {
                    let own: Vec<f64> = gradients.iter().map(|gradient| gradient[i]).collect();
                    let wanted = textbook(start[i], &own, &rule);
                    assert!((found - wanted).abs() < tolerance, "{dtype:?} {i}: {found} for {wanted}");
                }
            }
        });
    }

    #[test]
    fn a_gradient_whose_square_overflows_moves_by_the_rate_and_one_that_is_not_finite_shows() {
        for_each_device(|device| {
            let value = tensor(&[1.0, 2.0, 3.0, 4.0, 5.0, 6.0], &device, DType::F32);
            let gradient = tensor(&[1e30, -1e30, 0.1, f64::NAN, f64::INFINITY, 0.0], &device, DType::F32);
            let rule = AdamRule::new(0.1);
            let (value, moments) = adam_step(value.clone(), gradient, AdamMoments::zeros_like(&value), &rule);
            let (values, seconds) = (numbers(value), numbers(moments.second));
            assert!(seconds[..3].iter().all(|second| second.is_finite()), "{seconds:?}");
            for (found, wanted) in values[..3].iter().zip([0.9, 2.1, 2.9]) {
                assert!((found - wanted).abs() < SINGLE, "{values:?}");
            }
            assert!(!values[3].is_finite() && !values[4].is_finite() && values[5] == 6.0, "{values:?}");
        });
    }

    #[test]
    fn a_number_without_gradient_stays() {
        for_each_device(|device| {
            let value = tensor(&[1.0, 2.0, 3.0], &device, DType::F32);
            let moments = AdamMoments::zeros_like(&value);
            let (value, _) = adam_step(value.clone(), value.zeros_like(), moments, &AdamRule::default());
            assert_eq!(numbers(value), [1.0, 2.0, 3.0]);
        });
    }

    #[test]
    fn a_step_leaves_other_holders_of_the_value_alone() {
        for_each_device(|device| {
            let value = tensor(&[1.0, 2.0, 3.0], &device, DType::F32);
            let held = value.clone();
            let moments = AdamMoments::zeros_like(&value);
            let (moved, _) = adam_step(value, held.clone(), moments, &AdamRule::default());
            assert_eq!(numbers(held), [1.0, 2.0, 3.0]);
            assert_ne!(numbers(moved), [1.0, 2.0, 3.0]);
        });
    }

    #[test]
    fn an_empty_parameter_can_step() {
        for_each_device(|device| {
            let value = tensor(&[], &device, DType::F32);
            let moments = AdamMoments::zeros_like(&value);
            let (value, moments) = adam_step(value.clone(), value, moments, &AdamRule::default());
            assert_eq!((value.dims(), moments.steps), ([0, 3], 1));
        });
    }
    #[test]
    fn parameters_that_step_together_step_as_if_alone() {
        let sizes = [0, 3, 3 * 7001, 3, 3 * 20];
        for_each_device(|device| {
            let parameters: Vec<AdamStep<2>> = sizes
                .iter()
                .enumerate()
                .map(|(index, &size)| {
                    let of = |seed| tensor(&random(10 * index as u64 + seed, size), &device, DType::F32);
                    let moments = AdamMoments { first: of(1), second: of(2), steps: index };
                    let rule = AdamRule::new(0.01 * index as f64);
                    AdamStep { value: of(3), gradient: of(4), moments, rule }
                })
                .collect();
            let together = adam_steps(parameters.clone());
            assert_eq!(together.len(), sizes.len());
            for (parameter, stepped) in parameters.into_iter().zip(together) {
                let AdamStep { value, gradient, moments, rule } = parameter;
                let (value, moments) = adam_step(value, gradient, moments, &rule);
                assert_eq!(stepped.moments.steps, moments.steps);
                assert_eq!(numbers(stepped.value), numbers(value));
                assert_eq!(numbers(stepped.moments.first), numbers(moments.first));
                assert_eq!(numbers(stepped.moments.second), numbers(moments.second));
            }
            assert!(adam_steps::<2>(Vec::new()).is_empty());
        });
    }
}
