//! Finds the first tensor of a run with a non-finite value.

use burn::tensor::Tensor;

use super::parameters::{Sink, walk};
use crate::model::Model;
use crate::{ModelError, tensors};

/// Tensors by name, each reduced to one value on the device: 0 if all values are finite, otherwise NaN.
#[derive(Default)]
pub(super) struct Findings {
    names: Vec<String>,
    signs: Vec<Tensor<1>>,
}

impl Findings {
    /// The findings for all learned parameters of a model.
    pub fn of_parameters(model: &Model) -> Self {
        let mut findings = Self::default();
        walk(model, &mut findings);
        findings.names.iter_mut().for_each(|name| name.insert_str(0, "parameter "));
        findings
    }

    /// The first tensor with a non-finite value. Waits for the device once.
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
