//! A walk over every learned parameter of a model, under the names that files and messages use.

use burn::module::{Module, ModuleVisitor, Param};
use burn::tensor::Tensor;

use crate::gaussians::Attribute;
use crate::model::Model;

/// What takes the parameters.
pub(super) trait Sink {
    /// Takes a parameter, without autodiff.
    fn take<const D: usize>(&mut self, name: String, values: Tensor<D>);
}

/// Hands every learned parameter over: `dynamic.means`, …, `static.means`, …, `network.grid.planes`, …, `refinement.…`.
pub(super) fn walk(model: &Model, sink: &mut impl Sink) {
    for (name, branch) in model.branches() {
        for attribute in Attribute::ALL {
            if let Some(values) = branch.gaussians.plain(attribute) {
                sink.take(format!("{name}.{attribute}"), values);
            }
        }
    }
    model.network.visit(&mut Walk { sink, path: vec!["network".to_owned()] });
    model.refinement.visit(&mut Walk { sink, path: vec!["refinement".to_owned()] });
}

/// Where in a module the walk is.
struct Walk<'a, S> {
    sink: &'a mut S,
    path: Vec<String>,
}

impl<S: Sink> ModuleVisitor for Walk<'_, S> {
    fn enter_module(&mut self, name: &str, _container_type: &str) {
        self.path.push(name.to_owned());
    }

    fn exit_module(&mut self, _name: &str, _container_type: &str) {
        self.path.pop();
    }

    fn visit_float<const D: usize>(&mut self, param: &Param<Tensor<D>>) {
        self.sink.take(self.path.join("."), param.val().inner());
    }
}
