//! Iteration over all learned parameters of a model, with the names that files and messages use.

use burn::module::{Module, ModuleVisitor, Param};
use burn::tensor::Tensor;

use crate::model::Model;
use crate::model::gaussians::Attribute;
use crate::parameter_path::ParameterPath;

/// A receiver of parameters.
pub(super) trait Sink {
    /// Takes a parameter, without autodiff.
    fn take<const D: usize>(&mut self, name: String, values: Tensor<D>);
}

/// Passes every learned parameter to `sink`, in the order of files: `dynamic.means`, …, `static.means`, …,
/// `network.grid.planes`, …, `refinement.…`, and `exposures.departures` if there are any.
pub(super) fn walk(model: &Model, sink: &mut impl Sink) {
    for (name, branch) in model.branches() {
        for attribute in Attribute::ALL {
            if let Some(values) = branch.plain(attribute) {
                sink.take(format!("{name}.{attribute}"), values);
            }
        }
    }
    model.network.visit(&mut Walk { sink, path: ParameterPath::new("network") });
    model.refinement.visit(&mut Walk { sink, path: ParameterPath::new("refinement") });
    model.exposures.visit(&mut Walk { sink, path: ParameterPath::new("exposures") });
}

/// The iteration over the parameters of a module.
struct Walk<'a, S> {
    sink: &'a mut S,
    path: ParameterPath,
}

impl<S: Sink> ModuleVisitor for Walk<'_, S> {
    fn enter_module(&mut self, name: &str, container_type: &str) {
        self.path.enter(name, container_type);
    }

    fn exit_module(&mut self, _name: &str, container_type: &str) {
        self.path.exit(container_type);
    }

    fn visit_float<const D: usize>(&mut self, param: &Param<Tensor<D>>) {
        self.sink.take(self.path.name(), param.val().inner());
    }
}
