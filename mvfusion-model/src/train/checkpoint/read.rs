//! Reading a model and a training state from a checkpoint.

use burn::module::{Module, ModuleMapper, Param};
use burn::tensor::{DType, Device, Tensor};
use mvfusion_render::grid::GridBounds;
use mvfusion_render::optim::AdamMoments;

use super::Checkpoint;
use super::contents::{
    INTENSITY, LOCAL, NEAR_LOCAL, NEAR_MEANS, PENDING_RADII, PENDING_SCREEN, PENDING_VISIBLE, SIGNATURES, VELOCITIES,
    moment_names,
};
use super::fit::columns;
use crate::ModelError;
use crate::config::{Config, Descriptor, Trajectory};
use crate::model::Model;
use crate::model::exposure::Exposures;
use crate::model::gaussians::{Attribute, Gaussians};
use crate::model::motion::{
    Encoding, MotionCache, MotionRefinement, Near, SIGNATURE_WIDTH, Substitutes, VELOCITY_WIDTH,
};
use crate::model::network::{DeformationConfig, ModuleInit};
use crate::parameter_path::ParameterPath;
use crate::random::Stream;
use crate::train::densify::{BranchState, DensifyStatistics};
use crate::train::optim::{GaussianOptimiser, ModuleOptimiser};
use crate::train::{BadSteps, BranchGradients, Sampler, TrainState, Visibility};

impl Checkpoint {
    /// The model alone, with autodiff: what was learned, and the motion descriptors. The configuration is the result of
    /// [`Config::scaled`]. It need not be that of the run, but must describe the same model.
    ///
    /// # Errors
    /// [`ModelError::Config`] if it is invalid or not scaled. [`ModelError::Checkpoint`] if a tensor is missing or has
    /// another shape than in the configured model.
    pub fn model(&self, config: &Config, device: &Device) -> Result<Model, ModelError> {
        self.check_model(config)?;
        let device = &device.clone().autodiff();
        let header = &self.header;
        let bounds = GridBounds { min: header.grid_min, max: header.grid_max };
        // The weights are overwritten below, so any stream works.
        let mut stream = Stream::new(0, 0);
        let mut init = ModuleInit { device, dtype: DType::F32, stream: &mut stream };
        let deformation = DeformationConfig::of(&config.model, bounds);
        let network = deformation.init(&mut init);
        let refinement = MotionRefinement::new(&deformation, &config.motion, &mut init);
        let branch = |(name, &degree): (&'static str, &usize)| self.gaussians(name, degree, config, device);
        let mut branches = ["dynamic", "static"].into_iter().zip(&header.sh_degrees).map(branch);
        let dynamic = branches.next().ok_or_else(|| self.misfit("`sh_degrees` is empty".to_owned()))??;
        let static_ = branches.next().transpose()?;
        Ok(Model {
            motion: self.motion(dynamic.count(), config, device)?,
            dynamic,
            static_,
            network: self.fill("network", network, device)?,
            refinement: self.fill("refinement", refinement, device)?,
            exposures: config.model.exposure.then(|| self.exposures(device)).transpose()?,
            substitutes: Substitutes::default(),
        })
    }

    /// The model with its steps and normalisers, in a state without moments, statistics and gradients, for
    /// [`TrainState::with_weights`]. What the training state in the file would be is not looked at.
    ///
    /// # Errors
    /// As [`Checkpoint::model`].
    pub fn weights(self, config: &Config, device: &Device) -> Result<TrainState, ModelError> {
        let model = self.model(config, device)?;
        let header = self.header;
        Ok(TrainState {
            completed: header.completed,
            dynamic: BranchState::new(&model.dynamic),
            static_: model.static_.as_ref().map(BranchState::new),
            model,
            optimiser: ModuleOptimiser::default(),
            normalisers: header.normalisers,
            streams: header.streams,
            sampler: Sampler::default(),
            refreshes: header.refreshes,
            bad_steps: BadSteps::default(),
        })
    }

    /// The whole state of a training with this configuration.
    ///
    /// # Errors
    /// As [`Checkpoint::model`], and for a part of the training state that does not fit the model.
    pub fn state(self, config: &Config, device: &Device) -> Result<TrainState, ModelError> {
        let model = self.model(config, device)?;
        self.check_training(&model, config)?;
        let mut optimiser = ModuleOptimiser::default();
        for (path, &steps) in self.header.adam_steps.iter().filter(|(path, _)| !is_of_branch(path)) {
            optimiser.moments.insert(path.clone(), self.moments(path, steps, device)?);
        }
        let dynamic = self.branch("dynamic", device)?;
        let static_ = model.static_.is_some().then(|| self.branch("static", device)).transpose()?;
        let header = self.header;
        Ok(TrainState {
            completed: header.completed,
            model,
            dynamic,
            static_,
            optimiser,
            normalisers: header.normalisers,
            streams: header.streams,
            sampler: header.sampler,
            refreshes: header.refreshes,
            bad_steps: header.bad_steps,
        })
    }

    fn gaussians(
        &self,
        branch: &str,
        sh_degree: usize,
        config: &Config,
        device: &Device,
    ) -> Result<Gaussians, ModelError> {
        let rows = self.rows(branch)?;
        let mut tensors = std::collections::BTreeMap::new();
        for attribute in Attribute::ALL {
            if let Some(columns) = columns(attribute, branch, config) {
                let values: Tensor<2> = self.tensor(&format!("{branch}.{attribute}"), [rows, columns], device)?;
                tensors.insert(attribute, values.autodiff());
            }
        }
        let gaussians = Gaussians::from_tensors(|attribute| tensors.get(&attribute).cloned())
            .ok_or_else(|| self.misfit(format!("an attribute of the {branch} branch is missing")))?;
        Ok(Gaussians { sh_degree, ..gaussians })
    }

    fn motion(&self, rows: usize, config: &Config, device: &Device) -> Result<Option<MotionCache>, ModelError> {
        let Some(knot_times) = self.header.knot_times.clone() else { return Ok(None) };
        let (motion, knots) = (&config.motion, knot_times.len());
        let near = || {
            let means = self.tensor(NEAR_MEANS, [rows, 3 * motion.neighbours], device)?;
            let local = self.tensor(NEAR_LOCAL, [rows, motion.neighbours * knots], device)?;
            Ok::<_, ModelError>(Near { means, local })
        };
        let velocities = || self.tensor(VELOCITIES, [rows, VELOCITY_WIDTH * knots], device);
        Ok(Some(MotionCache {
            signatures: self.tensor(SIGNATURES, [rows, SIGNATURE_WIDTH], device)?,
            local: self.tensor(LOCAL, [rows, knots], device)?,
            velocities: (motion.descriptor == Descriptor::Momentary).then(velocities).transpose()?,
            near: motion.reads_neighbours().then(near).transpose()?,
            intensity: self.tensor(INTENSITY, [rows, 1], device)?,
            knot_times,
            inherits: motion.inherit,
            includes_travel: motion.trajectory == Trajectory::Lifetime,
            encoding: Encoding::default(),
        }))
    }

    fn exposures(&self, device: &Device) -> Result<Exposures, ModelError> {
        let departures: Tensor<3> = self.tensor(super::fit::EXPOSURES, [self.cameras()?, 3, 4], device)?;
        Ok(Exposures::from_departures(departures.autodiff()))
    }

    /// Fills a module with the stored values.
    fn fill<M: Module>(&self, name: &str, module: M, device: &Device) -> Result<M, ModelError> {
        let mut filler = Filler { checkpoint: self, device, path: ParameterPath::new(name), failure: None };
        let module = module.map(&mut filler);
        match filler.failure {
            Some(error) => Err(error),
            None => Ok(module),
        }
    }

    fn moments<const D: usize>(&self, path: &str, steps: usize, device: &Device) -> Result<AdamMoments<D>, ModelError> {
        let [first, second] = moment_names(path);
        Ok(AdamMoments { first: self.stored(&first, device)?, second: self.stored(&second, device)?, steps })
    }

    /// The values of a tensor whose shape has been checked.
    fn stored<const D: usize>(&self, name: &str, device: &Device) -> Result<Tensor<D>, ModelError> {
        let shape = self.shape(name).and_then(|shape| shape.try_into().ok());
        self.tensor(name, shape.ok_or_else(|| self.misfit(format!("`{name}` has not {D} dimensions")))?, device)
    }

    /// The training state of a branch.
    fn branch(&self, name: &str, device: &Device) -> Result<BranchState, ModelError> {
        let mut optimiser = GaussianOptimiser::default();
        for attribute in Attribute::ALL {
            let path = format!("{name}.{attribute}");
            if let Some(&steps) = self.header.adam_steps.get(&path) {
                optimiser.moments.insert(attribute, self.moments(&path, steps, device)?);
            }
        }
        let statistics = DensifyStatistics::from_named(|of| self.stored(&format!("statistics.{name}.{of}"), device))?;
        // Only the static branch accumulates gradients.
        let [dynamic, static_] = self.header.counts;
        Ok(match name {
            "static" => BranchState { optimiser, statistics, pending: self.pending(device)?, counts: static_ },
            _ => BranchState { optimiser, statistics, pending: None, counts: dynamic },
        })
    }

    /// The accumulated gradients of the static branch.
    fn pending(&self, device: &Device) -> Result<Option<BranchGradients>, ModelError> {
        if self.shape(PENDING_VISIBLE).is_none() {
            return Ok(None);
        }
        let there = |name: &str| self.shape(name).map(|_| self.stored(name, device)).transpose();
        let mut gradients = Vec::new();
        for attribute in Attribute::ALL {
            if let Some(gradient) = there(&format!("pending.{attribute}"))? {
                gradients.push((attribute, gradient));
            }
        }
        Ok(Some(BranchGradients {
            visibility: Visibility {
                visible: self.stored(PENDING_VISIBLE, device)?,
                foreground: None,
                radii: self.stored(PENDING_RADII, device)?,
            },
            screen: there(PENDING_SCREEN)?,
            attributes: gradients.into_iter().collect(),
        }))
    }
}

/// Whether Adam's moments of this path belong to a branch.
pub(super) fn is_of_branch(path: &str) -> bool {
    path.starts_with("dynamic.") || path.starts_with("static.")
}

struct Filler<'a> {
    checkpoint: &'a Checkpoint,
    device: &'a Device,
    path: ParameterPath,
    failure: Option<ModelError>,
}

impl ModuleMapper for Filler<'_> {
    fn enter_module(&mut self, name: &str, container_type: &str) {
        self.path.enter(name, container_type);
    }

    fn exit_module(&mut self, _name: &str, container_type: &str) {
        self.path.exit(container_type);
    }

    fn map_float<const D: usize>(&mut self, param: Param<Tensor<D>>) -> Param<Tensor<D>> {
        let (id, value, mapper) = param.consume();
        let value = match self.checkpoint.tensor(&self.path.name(), value.dims(), self.device) {
            Ok(stored) => stored.autodiff().require_grad(),
            Err(error) => {
                self.failure.get_or_insert(error);
                value
            }
        };
        Param::from_mapped_value(id, value, mapper)
    }
}
