//! Adam. CPU twin: `optim/cpu.rs`.

use burn::backend::TensorMetadata;
use burn_cubecl::CubeBackend;
use burn_cubecl::tensor::CubeTensor;
use mvfusion_kernels::cube::adam::{AdamStepLaunch, adam};

use super::gpu::{CUBE, Flat, Gpu, single};
use crate::list::Floats;
use crate::optim::AdamRule;
use crate::optim::op::{AdamOps, AdamState};

impl AdamOps for CubeBackend {
    fn adam_steps(state: AdamState<Self>, gradients: Floats<Self>, rules: Vec<(AdamRule, usize)>) -> AdamState<Self> {
        let AdamState { values, firsts, seconds } = state;
        let [values, firsts, seconds] =
            [values, firsts, seconds].map(|list| Floats(list.0.into_iter().map(own).collect()));
        let moments = firsts.0.iter().zip(&seconds.0);
        let parameters = values.0.iter().zip(gradients.0).zip(moments).zip(rules);
        for (((value, gradient), (first, second)), (rule, step)) in parameters {
            learn([value, first, second], gradient, &rule, step);
        }
        AdamState { values, firsts, seconds }
    }
}

/// Step number `step` of a parameter's value and moments, in place.
fn learn(state: [&CubeTensor; 3], gradient: CubeTensor, rule: &AdamRule, step: usize) {
    let [value, first, second] = state.map(Clone::clone);
    let gpu = Gpu::of(&value);
    let count = value.shape().num_elements();
    if count == 0 {
        return;
    }
    let correction = |beta: f64| 1.0 - beta.powf(step as f64);
    let numbers = [
        rule.beta1,
        1.0 - rule.beta1,
        rule.beta2,
        1.0 - rule.beta2,
        rule.learning_rate / correction(rule.beta1),
        1.0 / correction(rule.beta2).sqrt(),
        rule.epsilon,
    ];
    let [beta1, rest1, beta2, rest2, rate, root, epsilon] = numbers.map(|number| number as f32);
    adam::launch(
        &gpu.client,
        gpu.units(count),
        CUBE,
        value.flat(),
        first.flat(),
        second.flat(),
        single(gradient).flat(),
        count as u32,
        AdamStepLaunch::new(beta1, rest1, beta2, rest2, rate, root, epsilon),
    );
}

/// A tensor to modify in place: the tensor itself if it is not shared, otherwise a copy.
fn own(tensor: CubeTensor) -> CubeTensor {
    let tensor = single(tensor);
    // A runtime may pad the rows of a copy.
    if tensor.can_mut() { tensor } else { single(tensor.copy()) }
}
