//! Adam for the parameters of a Burn module.

use std::collections::BTreeMap;

use burn::module::{Module, ModuleMapper, Param};
use burn::tensor::{Gradients, Tensor};
use mvfusion_render::optim::{AdamMoments, adam_step};

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
        module: M,
        gradients: &mut Gradients,
        learning_rate: f64,
        config: &OptimConfig,
    ) -> M {
        let mut stepper = Stepper { optimiser: self, path: ParameterPath::new(name), gradients, learning_rate, config };
        module.map(&mut stepper)
    }
}

struct Stepper<'a> {
    optimiser: &'a mut ModuleOptimiser,
    path: ParameterPath,
    gradients: &'a mut Gradients,
    learning_rate: f64,
    config: &'a OptimConfig,
}

impl ModuleMapper for Stepper<'_> {
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
        let shape = value.dims();
        let count = shape.iter().product::<usize>();
        let flat = value.inner().reshape([count]);
        let path = self.path.name();
        let moments = self.optimiser.moments.remove(&path).unwrap_or_else(|| fresh(&flat));
        let rule = rule(self.learning_rate, self.config);
        let (flat, moments) = adam_step(flat, gradient.reshape([count]), moments, &rule);
        self.optimiser.moments.insert(path, moments);
        Param::from_mapped_value(id, flat.reshape(shape).autodiff().require_grad(), mapper)
    }
}
