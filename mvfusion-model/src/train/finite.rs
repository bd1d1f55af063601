//! Finds the first number of a run that is not finite.

use burn::module::{Module, ModuleVisitor, Param};
use burn::tensor::Tensor;

use crate::gaussians::Attribute;
use crate::model::Model;
use crate::{ModelError, tensors};

/// Tensors by name, each boiled down to one number on the device: 0 if all is well, NaN if any number is not finite.
#[derive(Default)]
pub(super) struct Findings {
    names: Vec<String>,
    signs: Vec<Tensor<1>>,
}

impl Findings {
    /// Of every learned parameter of a model.
    pub fn of_parameters(model: &Model) -> Self {
        let mut findings = Self::default();
        for (name, branch) in model.branches() {
            for attribute in Attribute::ALL {
                if let Some(values) = branch.gaussians.plain(attribute) {
                    findings.add(format!("parameter {name}.{attribute}"), values);
                }
            }
        }
        let mut visitor = Visitor { findings, path: vec!["parameter network".to_owned()] };
        model.network.visit(&mut visitor);
        visitor.path = vec!["parameter refinement".to_owned()];
        model.refinement.visit(&mut visitor);
        visitor.findings
    }

    /// Adds a tensor without autodiff.
    pub fn add<const D: usize>(&mut self, name: String, tensor: Tensor<D>) {
        self.names.push(name);
        self.signs.push((tensor * 0.0).sum());
    }

    /// The first tensor that holds a number that is not finite. Waits for the device, once.
    pub fn first_bad(self) -> Result<Option<String>, ModelError> {
        let signs: Vec<f32> = tensors::read(Tensor::cat(self.signs, 0))?;
        Ok(self.names.into_iter().zip(signs).find(|(_, sign)| sign.is_nan()).map(|(name, _)| name))
    }
}

struct Visitor {
    findings: Findings,
    path: Vec<String>,
}

impl ModuleVisitor for Visitor {
    fn enter_module(&mut self, name: &str, _container_type: &str) {
        self.path.push(name.to_owned());
    }

    fn exit_module(&mut self, _name: &str, _container_type: &str) {
        self.path.pop();
    }

    fn visit_float<const D: usize>(&mut self, param: &Param<Tensor<D>>) {
        self.findings.add(self.path.join("."), param.val().inner());
    }
}
