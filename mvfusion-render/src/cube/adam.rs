//! Adam. CPU twin: `optim/cpu.rs`.

use burn::backend::TensorMetadata;
use burn::backend::tensor::FloatTensor;
use burn_cubecl::CubeBackend;
use burn_cubecl::tensor::CubeTensor;
use mvfusion_kernels::cube::adam::{AdamStepLaunch, adam};

use super::gpu::{CUBE, Gpu, single};
use crate::optim::AdamRule;
use crate::optim::op::{AdamOps, Stepped};

impl AdamOps for CubeBackend {
    fn adam_step(
        value: FloatTensor<Self>,
        gradient: FloatTensor<Self>,
        first: FloatTensor<Self>,
        second: FloatTensor<Self>,
        rule: AdamRule,
        step: usize,
    ) -> Stepped<Self> {
        let gpu = Gpu::of(&value);
        let count = value.shape().num_elements();
        let [value, first, second] = [value, first, second].map(own);
        if count > 0 {
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
                value.clone().into_buffer_arg(),
                first.clone().into_buffer_arg(),
                second.clone().into_buffer_arg(),
                single(gradient).into_buffer_arg(),
                count as u32,
                AdamStepLaunch::new(beta1, rest1, beta2, rest2, rate, root, epsilon),
            );
        }
        Stepped { value, first, second }
    }
}

/// A tensor to modify in place: the tensor itself if it is not shared, otherwise a copy.
fn own(tensor: CubeTensor) -> CubeTensor {
    let tensor = single(tensor);
    if tensor.can_mut() { tensor } else { tensor.copy() }
}
