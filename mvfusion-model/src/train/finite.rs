//! Finds the first number of a run that is not finite.

use burn::tensor::Tensor;

use super::parameters::{Sink, walk};
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
        walk(model, &mut findings);
        findings.names.iter_mut().for_each(|name| name.insert_str(0, "parameter "));
        findings
    }

    /// The first tensor that holds a number that is not finite. Waits for the device, once.
    pub fn first_bad(self) -> Result<Option<String>, ModelError> {
        let signs: Vec<f32> = tensors::read(Tensor::cat(self.signs, 0))?;
        Ok(self.names.into_iter().zip(signs).find(|(_, sign)| sign.is_nan()).map(|(name, _)| name))
    }
}

impl Sink for Findings {
    fn take<const D: usize>(&mut self, name: String, values: Tensor<D>) {
        self.names.push(name);
        self.signs.push((values * 0.0).sum());
    }
}
