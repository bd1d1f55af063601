//! Adam. CPU twin: `optim/cpu.rs`.

use burn::backend::TensorMetadata;
use burn_cubecl::CubeBackend;
use burn_cubecl::tensor::CubeTensor;
use cubecl::prelude::BufferArg;
use mvfusion_kernels::cube::adam::{AdamStepLaunch, adam, adam_of_three};

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
        let parameters = parameters.map(|(((value, gradient), (first, second)), (rule, step))| Parameter {
            state: [value, first, second].map(Clone::clone),
            gradient: single(gradient),
            rule,
            step,
        });
        let parameters: Vec<Parameter> = parameters.filter(|parameter| parameter.count() > 0).collect();
        let (threes, rest) = parameters.as_chunks::<3>();
        threes.iter().for_each(learn_three);
        rest.iter().for_each(learn);
        AdamState { values, firsts, seconds }
    }
}

/// A parameter to step in place.
struct Parameter {
    /// Values, first and second moments.
    state: [CubeTensor; 3],
    gradient: CubeTensor,
    rule: AdamRule,
    /// Number of the step.
    step: usize,
}

impl Parameter {
    fn count(&self) -> usize {
        self.gradient.shape().num_elements()
    }

    /// Values, first moments, second moments, gradients.
    fn buffers(&self) -> [BufferArg; 4] {
        let [value, first, second] = &self.state;
        [value, first, second, &self.gradient].map(|tensor| tensor.clone().flat())
    }

    fn constants(&self) -> AdamStepLaunch {
        let rule = &self.rule;
        let correction = |beta: f64| 1.0 - beta.powf(self.step as f64);
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
        AdamStepLaunch::new(beta1, rest1, beta2, rest2, rate, root, epsilon)
    }
}

fn learn(parameter: &Parameter) {
    let gpu = Gpu::of(&parameter.gradient);
    let count = parameter.count();
    let [value, first, second, gradient] = parameter.buffers();
    let (client, units) = (&gpu.client, gpu.units(count));
    adam::launch(client, units, CUBE, value, first, second, gradient, count as u32, parameter.constants());
}

fn learn_three(parameters: &[Parameter; 3]) {
    let gpu = Gpu::of(&parameters[0].gradient);
    let counts = parameters.each_ref().map(|parameter| parameter.count());
    let [a, b, c] = parameters.each_ref().map(Parameter::buffers);
    let ([value_a, first_a, second_a, gradient_a], [value_b, first_b, second_b, gradient_b]) = (a, b);
    let [value_c, first_c, second_c, gradient_c] = c;
    let [count_a, count_b, count_c] = counts.map(|count| count as u32);
    let [step_a, step_b, step_c] = parameters.each_ref().map(Parameter::constants);
    adam_of_three::launch(
        &gpu.client,
        gpu.units(counts.iter().sum()),
        CUBE,
        value_a,
        first_a,
        second_a,
        gradient_a,
        value_b,
        first_b,
        second_b,
        gradient_b,
        value_c,
        first_c,
        second_c,
        gradient_c,
        count_a,
        count_b,
        count_c,
        step_a,
        step_b,
        step_c,
    );
}

/// A tensor to modify in place: the tensor itself if it is not shared, otherwise a copy.
fn own(tensor: CubeTensor) -> CubeTensor {
    let tensor = single(tensor);
    // A runtime may pad the rows of a copy.
    if tensor.can_mut() { tensor } else { single(tensor.copy()) }
}
