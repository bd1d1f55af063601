//! Adam for the parameters of a Burn module.

use std::collections::BTreeMap;

use burn::module::{Module, ModuleMapper, Param, ParamId};
use burn::tensor::{Gradients, Shape, Tensor};
use mvfusion_render::optim::{AdamMoments, AdamRule, AdamStep, adam_steps};

use super::gaussian::{fresh, rule};
use crate::config::OptimConfig;
use crate::parameter_path::ParameterPath;

/// Moments of a module's parameters by path. They are flat, because Adam is independent of shapes.
#[derive(Clone, Debug, Default)]
pub struct ModuleOptimiser {
    /// First and second moments, without autodiff.
    pub moments: BTreeMap<String, AdamMoments<1>>,
}

impl ModuleOptimiser {
    /// One Adam step for every parameter of `module` with a gradient. `name` is the module's name in the model, which
    /// distinguishes the paths of several modules.
    pub fn step<M: Module>(
        &mut self,
        name: &str,
        mut module: M,
        gradients: &mut Gradients,
        learning_rate: f64,
        config: &OptimConfig,
    ) -> M {
        self.step_in_place(name, &mut module, gradients, learning_rate, config);
        module
    }

    /// The same for a module in its place, which is faster: if nobody else holds its values, they are not copied.
    pub fn step_in_place<M: Module>(
        &mut self,
        name: &str,
        module: &mut M,
        gradients: &mut Gradients,
        learning_rate: f64,
        config: &OptimConfig,
    ) {
        let (path, rule) = (ParameterPath::new(name), rule(learning_rate, config));
        let mut taker = Taker { optimiser: self, path, gradients, rule, taken: Vec::new(), steps: Vec::new() };
        // The old module is dropped here, and its handles of the values with it.
        *module = module.clone().map(&mut taker);
        let Taker { taken, steps, .. } = taker;
        let mut values = BTreeMap::new();
        for (Taken { id, path, shape }, stepped) in taken.into_iter().zip(adam_steps(steps)) {
            self.moments.insert(path, stepped.moments);
            values.insert(id, (stepped.value, shape));
        }
        *module = module.clone().map(&mut Giver { values });
    }
}

/// A parameter whose values were taken.
struct Taken {
    id: ParamId,
    path: String,
    shape: Shape,
}

/// Takes the values of all parameters with a gradient out of a module, together with their moments.
struct Taker<'a> {
    optimiser: &'a mut ModuleOptimiser,
    path: ParameterPath,
    gradients: &'a mut Gradients,
    rule: AdamRule,
    taken: Vec<Taken>,
    steps: Vec<AdamStep<1>>,
}

impl ModuleMapper for Taker<'_> {
    fn enter_module(&mut self, name: &str, container_type: &str) {
        self.path.enter(name, container_type);
    }

    fn exit_module(&mut self, _name: &str, container_type: &str) {
        self.path.exit(container_type);
    }

    fn map_float<const D: usize>(&mut self, param: Param<Tensor<D>>) -> Param<Tensor<D>> {
        let (id, value, mapper) = param.consume();
        let Some(gradient) = value.grad_remove(self.gradients) else {
            return Param::from_mapped_value(id, value, mapper);
        };
        let (path, shape) = (self.path.name(), value.shape());
        let count = shape.num_elements();
        let value = value.inner().reshape([count]);
        let empty = Tensor::empty([0; D], &value.device());
        let moments = self.optimiser.moments.remove(&path).unwrap_or_else(|| fresh(&value));
        self.taken.push(Taken { id, path, shape });
        self.steps.push(AdamStep { value, gradient: gradient.reshape([count]), moments, rule: self.rule });
        Param::from_mapped_value(id, empty, mapper)
    }
}

/// Gives new values, which are flat, back to a module as parameters of the given shapes.
struct Giver {
    values: BTreeMap<ParamId, (Tensor<1>, Shape)>,
}

impl ModuleMapper for Giver {
    fn map_float<const D: usize>(&mut self, param: Param<Tensor<D>>) -> Param<Tensor<D>> {
        let (id, value, mapper) = param.consume();
        let value = match self.values.remove(&id) {
            Some((value, shape)) => value.reshape(shape).autodiff().require_grad(),
            None => value,
        };
        Param::from_mapped_value(id, value, mapper)
    }
}

#[cfg(test)]
mod tests {
    use burn::tensor::DType;
    use mvfusion_render::optim::adam_step;

    use super::*;
    use crate::model::network::{Mlp, ModuleInit};
    use crate::random::Stream;
    use crate::test_support::{for_each_device, values};

    #[test]
    fn every_parameter_with_a_gradient_steps_and_the_others_stay() {
        for_each_device(|device| {
            let device = device.autodiff();
            let mut stream = Stream::new(4, 0);
            let mut module: Mlp =
                ModuleInit { device: &device, dtype: DType::F32, stream: &mut stream }.mlp(&[3, 4, 2]);
            let before = module.clone();
            let mut optimiser = ModuleOptimiser::default();
            let config = OptimConfig::default();
            let of_first = |module: &Mlp| module.layers[0].weight.val().square().sum();
            let mut wanted = module.layers[0].weight.val().inner();
            let mut moments = fresh(&wanted);
            for _ in 0..3 {
                let mut gradients = of_first(&module).backward();
                let gradient = module.layers[0].weight.val().grad(&gradients).expect("tracked");
                (wanted, moments) = adam_step(wanted, gradient, moments, &rule(0.1, &config));
                optimiser.step_in_place("trunk", &mut module, &mut gradients, 0.1, &config);
            }
            assert_eq!(values(module.layers[0].weight.val().inner()), values(wanted));
            assert_eq!(optimiser.moments.keys().collect::<Vec<_>>(), ["trunk.layers.0.weight"]);
            let kept = &optimiser.moments["trunk.layers.0.weight"];
            assert_eq!((kept.steps, values(kept.second.clone())), (3, values(moments.second)));
            let [old, new] = [&before, &module].map(|module| values(module.layers[1].weight.val().inner()));
            assert_eq!(old, new);
            assert!(module.layers[0].weight.val().is_require_grad() && module.layers[1].weight.val().is_require_grad());
        });
    }
}
