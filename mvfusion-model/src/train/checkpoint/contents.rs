//! The tensors of a state on the host, by their names in files.

use std::collections::BTreeMap;

use burn::tensor::{DType, Tensor};
use mvfusion_render::optim::AdamMoments;
use sha2::{Digest, Sha256};

use super::file::Tensors;
use crate::ModelError;
use crate::files::hexadecimal;
use crate::model::Model;
use crate::model::gaussians::Attribute;
use crate::model::motion::MotionCache;
use crate::train::densify::BranchState;
use crate::train::parameters::{Sink, walk};
use crate::train::{BranchGradients, TrainState};

/// Names of the motion descriptors.
pub(super) const SIGNATURES: &str = "motion.signatures";
pub(super) const LOCAL: &str = "motion.local";
pub(super) const VELOCITIES: &str = "motion.velocities";
pub(super) const NEAR_MEANS: &str = "motion.near_means";
pub(super) const NEAR_LOCAL: &str = "motion.near_local";
pub(super) const INTENSITY: &str = "motion.intensity";

/// Names of the accumulated data of the static branch, besides its gradients.
pub(super) const PENDING_SCREEN: &str = "pending.screen";
pub(super) const PENDING_RADII: &str = "pending.radii";
pub(super) const PENDING_VISIBLE: &str = "pending.visible";

/// The motion descriptors with their names.
fn descriptors_of(cache: &MotionCache) -> Vec<(&'static str, &Tensor<2>)> {
    let always = [(SIGNATURES, &cache.signatures), (LOCAL, &cache.local), (INTENSITY, &cache.intensity)];
    let velocities = cache.velocities.iter().map(|velocities| (VELOCITIES, velocities));
    let near = cache.near.iter().flat_map(|near| [(NEAR_MEANS, &near.means), (NEAR_LOCAL, &near.local)]);
    always.into_iter().chain(velocities).chain(near).collect()
}

/// The names of a model's motion descriptors.
pub(super) fn descriptors(cache: &MotionCache) -> Vec<&'static str> {
    descriptors_of(cache).into_iter().map(|(name, _)| name).collect()
}

/// Names of both moments of a parameter.
pub(super) fn moment_names(path: &str) -> [String; 2] {
    ["first", "second"].map(|moment| format!("adam.{path}.{moment}"))
}

/// All tensors of a state, and the step counts of Adam.
pub(super) struct Contents {
    pub tensors: Tensors,
    pub adam_steps: BTreeMap<String, usize>,
}

impl Contents {
    /// Reads a state from the device.
    pub fn of(state: &TrainState) -> Result<Self, ModelError> {
        let mut contents = Self { tensors: parameters(&state.model)?, adam_steps: BTreeMap::new() };
        let states = std::iter::once(&state.dynamic).chain(&state.static_);
        for ((name, _), branch) in state.model.branches().zip(states) {
            contents.add_branch(name, branch)?;
        }
        for (path, moments) in &state.optimiser.moments {
            contents.add_moments(path, moments)?;
        }
        if let Some(cache) = &state.model.motion {
            for (name, values) in descriptors_of(cache) {
                contents.add(name, values.clone())?;
            }
        }
        Ok(contents)
    }

    fn add<const D: usize>(&mut self, name: impl Into<String>, tensor: Tensor<D>) -> Result<(), ModelError> {
        store(&mut self.tensors, name.into(), tensor)
    }

    fn add_branch(&mut self, name: &str, branch: &BranchState) -> Result<(), ModelError> {
        // A new field of the state is a compile error here until it is decided whether files need it.
        let BranchState { optimiser, statistics, pending, counts: _ } = branch;
        for (attribute, moments) in &optimiser.moments {
            self.add_moments(&format!("{name}.{attribute}"), moments)?;
        }
        for (of, values) in statistics.named() {
            self.add(format!("statistics.{name}.{of}"), values.clone())?;
        }
        pending.as_ref().map_or(Ok(()), |pending| self.add_pending(pending))
    }

    fn add_pending(&mut self, pending: &BranchGradients) -> Result<(), ModelError> {
        for attribute in Attribute::ALL {
            if let Some(gradient) = pending.attributes.of(attribute) {
                self.add(format!("pending.{attribute}"), gradient.clone())?;
            }
        }
        if let Some(screen) = &pending.screen {
            self.add(PENDING_SCREEN, screen.clone())?;
        }
        self.add(PENDING_RADII, pending.visibility.radii.clone())?;
        self.add(PENDING_VISIBLE, pending.visibility.visible.clone())
    }

    fn add_moments<const D: usize>(&mut self, path: &str, moments: &AdamMoments<D>) -> Result<(), ModelError> {
        self.adam_steps.insert(path.to_owned(), moments.steps);
        let [first, second] = moment_names(path);
        self.add(first, moments.first.clone())?;
        self.add(second, moments.second.clone())
    }
}

/// SHA-256 of all learned parameters: names in order, each followed by its values, little endian.
///
/// # Errors
/// If the device fails to return values.
pub fn parameter_hash(model: &Model) -> Result<String, ModelError> {
    let mut hash = Sha256::new();
    for (name, data) in parameters(model)? {
        hash.update(name.as_bytes());
        hash.update(&data.bytes()[..]);
    }
    Ok(hexadecimal(hash))
}

/// Bytes of all learned parameters in a checkpoint.
pub fn parameter_bytes(model: &Model) -> u64 {
    struct Count(u64);
    impl Sink for Count {
        fn take<const D: usize>(&mut self, _: String, values: Tensor<D>) {
            self.0 += (values.shape().num_elements() * DType::F32.size()) as u64;
        }
    }
    let mut count = Count(0);
    walk(model, &mut count);
    count.0
}

/// Every learned parameter by name.
fn parameters(model: &Model) -> Result<Tensors, ModelError> {
    let mut collector = Collector { tensors: Tensors::new(), failure: None };
    walk(model, &mut collector);
    match collector.failure {
        Some(error) => Err(error),
        None => Ok(collector.tensors),
    }
}

fn store<const D: usize>(tensors: &mut Tensors, name: String, tensor: Tensor<D>) -> Result<(), ModelError> {
    let data = tensor.try_into_data().map_err(|error| ModelError::Device(error.to_string()))?;
    tensors.insert(name, data.convert_dtype(DType::F32));
    Ok(())
}

/// Collects parameters on the host. It continues after a failure and keeps the first one.
struct Collector {
    tensors: Tensors,
    failure: Option<ModelError>,
}

impl Sink for Collector {
    fn take<const D: usize>(&mut self, name: String, values: Tensor<D>) {
        if let Err(error) = store(&mut self.tensors, name, values) {
            self.failure.get_or_insert(error);
        }
    }
}
