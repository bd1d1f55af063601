//! A run's state as one file: tensors as safetensors, everything else as JSON in its header.

use std::collections::{BTreeMap, HashMap};
use std::io::Write;
use std::path::Path;

use burn::module::{Module, ModuleMapper, Param};
use burn::tensor::{DType, Device, Tensor, TensorData};
use mvfusion_render::grid::GridBounds;
use mvfusion_render::optim::AdamMoments;
use safetensors::tensor::{Dtype, SafeTensors, TensorView};
use serde::{Deserialize, Serialize};
use sha2::{Digest, Sha256};

use super::parameters::{Sink, walk};
use super::step::Sighting;
use super::{Contribution, Sampler, TrainState};
use crate::ModelError;
use crate::config::{Branches, Config};
use crate::densify::{Branch, Census, DensifyStatistics};
use crate::exposure::Exposures;
use crate::files::hexadecimal;
use crate::gaussians::{Attribute, Gaussians};
use crate::model::Model;
use crate::motion::{MotionCache, MotionRefinement, Normalisers};
use crate::network::{DeformationConfig, LayerInit};
use crate::optim::{GaussianOptimiser, ModuleOptimiser};
use crate::parameter_path::ParameterPath;
use crate::random::{Stream, Streams};

/// Header key under which everything but the tensors is stored.
const HEADER: &str = "mvfusion";

/// Name of the exposures of the training cameras, which alone tell how many those are.
const EXPOSURES: &str = "exposures.departures";

/// Names of what the static branch has yet to learn from, beside its gradients.
const PENDING_SCREEN: &str = "pending.screen";
const PENDING_RADII: &str = "pending.radii";
const PENDING_VISIBLE: &str = "pending.visible";

/// What a checkpoint holds beside tensors.
#[derive(Debug, Serialize, Deserialize)]
struct Header {
    completed: usize,
    /// Of the dynamic branch, then of the static one, if there is one.
    sh_degrees: Vec<usize>,
    grid_max: [f64; 3],
    grid_min: [f64; 3],
    knot_times: Option<Vec<f64>>,
    adam_steps: BTreeMap<String, usize>,
    normalisers: Normalisers,
    streams: Streams,
    sampler: Sampler,
    census: [Census; 2],
    refreshes: usize,
}

/// Tensors by name, on the host.
type Tensors = BTreeMap<String, TensorData>;

impl TrainState {
    /// Writes the state to a file: first beside it, then renamed, so that a crash leaves the old file whole.
    ///
    /// # Errors
    /// If the device cannot hand its numbers back or the file cannot be written.
    pub fn save(&self, path: &Path) -> Result<(), ModelError> {
        let mut tensors = parameters(&self.model)?;
        let mut adam_steps = BTreeMap::new();
        for (name, branch) in self.model.branches() {
            for (attribute, moments) in &branch.optimiser.moments {
                store_moments(&mut tensors, &mut adam_steps, &format!("{name}.{attribute}"), moments)?;
            }
            let statistics = &branch.statistics;
            store(&mut tensors, format!("statistics.{name}.gradients"), statistics.gradients.clone())?;
            store(&mut tensors, format!("statistics.{name}.seen"), statistics.seen.clone())?;
            store(&mut tensors, format!("statistics.{name}.foreground"), statistics.foreground.clone())?;
            store(&mut tensors, format!("statistics.{name}.radii"), statistics.radii.clone())?;
        }
        for (path, moments) in &self.optimiser.moments {
            store_moments(&mut tensors, &mut adam_steps, path, moments)?;
        }
        if let Some(cache) = &self.model.motion {
            store(&mut tensors, "motion.signatures".to_owned(), cache.signatures.clone())?;
            store(&mut tensors, "motion.local".to_owned(), cache.local.clone())?;
            store(&mut tensors, "motion.intensity".to_owned(), cache.intensity.clone())?;
        }
        if let Some(pending) = &self.pending {
            store_pending(&mut tensors, pending)?;
        }
        let bounds = self.model.network.grid.bounds();
        let header = Header {
            completed: self.completed,
            sh_degrees: self.model.branches().map(|(_, branch)| branch.sh_degree).collect(),
            grid_max: bounds.max,
            grid_min: bounds.min,
            knot_times: self.model.motion.as_ref().map(|cache| cache.knot_times.clone()),
            adam_steps,
            normalisers: self.normalisers.clone(),
            streams: self.streams.clone(),
            sampler: self.sampler.clone(),
            census: self.census,
            refreshes: self.refreshes,
        };
        write(path, &tensors, &header)
    }

    /// Reads a state that was written under the same `config`, onto `device` (with autodiff).
    ///
    /// # Errors
    /// If the file cannot be read, is no checkpoint, or does not fit the configuration.
    pub fn load(path: &Path, config: &Config, device: &Device) -> Result<Self, ModelError> {
        let (mut reader, header) = Reader::open(path, device)?;
        let mut optimiser = ModuleOptimiser::default();
        for (name, &steps) in &header.adam_steps {
            let in_module = !name.starts_with("dynamic.") && !name.starts_with("static.");
            if in_module {
                optimiser.moments.insert(name.clone(), reader.moments(name, steps)?);
            }
        }
        let bounds = GridBounds { max: header.grid_max, min: header.grid_min };
        let model = reader.model(config, bounds, &header)?;
        let pending = reader.pending()?;
        Ok(Self {
            completed: header.completed,
            model,
            optimiser,
            normalisers: header.normalisers,
            streams: header.streams,
            sampler: header.sampler,
            pending,
            census: header.census,
            refreshes: header.refreshes,
        })
    }
}

/// The model of a checkpoint, without autodiff, ready to be evaluated.
///
/// # Errors
/// As [`TrainState::load`].
pub fn load_model(path: &Path, config: &Config, device: &Device) -> Result<Model, ModelError> {
    Ok(TrainState::load(path, config, &device.clone().autodiff())?.model.plain())
}

/// SHA-256 over all learned parameters: names in order, each followed by its numbers, little endian.
///
/// # Errors
/// If the device cannot hand its numbers back.
pub fn parameter_hash(model: &Model) -> Result<String, ModelError> {
    let mut hash = Sha256::new();
    for (name, data) in parameters(model)? {
        hash.update(name.as_bytes());
        hash.update(&data.bytes()[..]);
    }
    Ok(hexadecimal(hash))
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

fn store_pending(tensors: &mut Tensors, pending: &Contribution) -> Result<(), ModelError> {
    for attribute in Attribute::ALL {
        if let Some(gradient) = pending.gradients.of(attribute) {
            store(tensors, format!("pending.{attribute}"), gradient.clone())?;
        }
    }
    if let Some(screen) = &pending.screen {
        store(tensors, PENDING_SCREEN.to_owned(), screen.clone())?;
    }
    store(tensors, PENDING_RADII.to_owned(), pending.sighting.radii.clone())?;
    store(tensors, PENDING_VISIBLE.to_owned(), pending.sighting.visible.clone())
}

fn store_moments<const D: usize>(
    tensors: &mut Tensors,
    steps: &mut BTreeMap<String, usize>,
    name: &str,
    moments: &AdamMoments<D>,
) -> Result<(), ModelError> {
    steps.insert(name.to_owned(), moments.steps);
    store(tensors, format!("adam.{name}.first"), moments.first.clone())?;
    store(tensors, format!("adam.{name}.second"), moments.second.clone())
}

/// Collects parameters on the host; after a failure it goes on, and the first one is told.
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

fn write(path: &Path, tensors: &Tensors, header: &Header) -> Result<(), ModelError> {
    let failed = |reason: String| ModelError::File { action: "write", path: path.to_owned(), reason };
    let header = serde_json::to_string(header).map_err(|error| failed(error.to_string()))?;
    let views = tensors
        .iter()
        .map(|(name, data)| {
            TensorView::new(Dtype::F32, data.shape().to_vec(), &data.bytes()[..]).map(|view| (name.clone(), view))
        })
        .collect::<Result<Vec<_>, _>>()
        .map_err(|error| failed(error.to_string()))?;
    let metadata = HashMap::from([(HEADER.to_owned(), header)]);
    let bytes = safetensors::serialize(views, Some(metadata)).map_err(|error| failed(error.to_string()))?;

    let mut file = crate::files::beside(path).map_err(|error| failed(error.to_string()))?;
    file.write_all(&bytes).and_then(|()| file.as_file().sync_all()).map_err(|error| failed(error.to_string()))?;
    file.persist(path).map_err(|error| failed(error.to_string()))?;
    Ok(())
}

/// A checkpoint being read.
struct Reader<'a> {
    path: &'a Path,
    tensors: BTreeMap<String, TensorData>,
    device: &'a Device,
}

impl<'a> Reader<'a> {
    fn open(path: &'a Path, device: &'a Device) -> Result<(Self, Header), ModelError> {
        let bytes = std::fs::read(path).map_err(|error| ModelError::File {
            action: "read",
            path: path.to_owned(),
            reason: error.to_string(),
        })?;
        let misfit = |reason: String| ModelError::Checkpoint { path: path.to_owned(), reason };
        let (_, metadata) = SafeTensors::read_metadata(&bytes).map_err(|error| misfit(error.to_string()))?;
        let header = metadata
            .metadata()
            .as_ref()
            .and_then(|entries| entries.get(HEADER))
            .ok_or_else(|| misfit("it has no header of this program".to_owned()))?;
        let header: Header = serde_json::from_str(header).map_err(|error| misfit(error.to_string()))?;
        let file = SafeTensors::deserialize(&bytes).map_err(|error| misfit(error.to_string()))?;
        let tensors = file
            .tensors()
            .into_iter()
            .map(|(name, view)| {
                let values: Vec<f32> = view
                    .data()
                    .chunks_exact(4)
                    .map(|bytes| f32::from_le_bytes([bytes[0], bytes[1], bytes[2], bytes[3]]))
                    .collect();
                (name, TensorData::new(values, view.shape().to_vec()))
            })
            .collect();
        Ok((Self { path, tensors, device }, header))
    }

    fn misfit(&self, reason: String) -> ModelError {
        ModelError::Checkpoint { path: self.path.to_owned(), reason }
    }

    /// A tensor without autodiff.
    fn tensor<const D: usize>(&mut self, name: &str) -> Result<Tensor<D>, ModelError> {
        let data = self.tensors.remove(name).ok_or_else(|| self.misfit(format!("`{name}` is missing")))?;
        if data.shape().len() != D {
            return Err(self.misfit(format!("`{name}` has {} dimensions instead of {D}", data.shape().len())));
        }
        Ok(Tensor::from_data(data, &self.device.clone().inner()))
    }

    fn moments<const D: usize>(&mut self, name: &str, steps: usize) -> Result<AdamMoments<D>, ModelError> {
        let first = self.tensor(&format!("adam.{name}.first"))?;
        let second = self.tensor(&format!("adam.{name}.second"))?;
        Ok(AdamMoments { first, second, steps })
    }

    fn model(&mut self, config: &Config, bounds: GridBounds, header: &Header) -> Result<Model, ModelError> {
        // The weights are overwritten below, so any will do.
        let mut stream = Stream::new(0, 0);
        let mut init = LayerInit { device: self.device, dtype: DType::F32, stream: &mut stream };
        let deformation = DeformationConfig::of(&config.model, bounds);
        let network = deformation.init(&mut init);
        let refinement = MotionRefinement::new(&deformation, &config.motion, &mut init);
        let (degrees, both) = (&header.sh_degrees, config.model.branches == Branches::Both);
        let static_degree = degrees.get(1).filter(|_| both);
        let (Some(&dynamic_degree), true) = (degrees.first(), both == static_degree.is_some()) else {
            return Err(self.misfit(format!("it holds {} branches", degrees.len())));
        };
        Ok(Model {
            dynamic: self.branch("dynamic", dynamic_degree, header)?,
            static_: static_degree.map(|&degree| self.branch("static", degree, header)).transpose()?,
            network: self.fill("network", network)?,
            refinement: self.fill("refinement", refinement)?,
            exposures: self
                .optional(EXPOSURES)?
                .map(|departures: Tensor<3>| Exposures::from_departures(departures.autodiff())),
            motion: match &header.knot_times {
                Some(knot_times) => Some(MotionCache {
                    signatures: self.tensor("motion.signatures")?,
                    local: self.tensor("motion.local")?,
                    intensity: self.tensor("motion.intensity")?,
                    knot_times: knot_times.clone(),
                }),
                None => None,
            },
        })
    }

    fn branch(&mut self, name: &str, sh_degree: usize, header: &Header) -> Result<Branch, ModelError> {
        let mut tensors = BTreeMap::new();
        let mut optimiser = GaussianOptimiser::default();
        for attribute in Attribute::ALL {
            let path = format!("{name}.{attribute}");
            if let Some(values) = self.optional::<2>(&path)? {
                tensors.insert(attribute, values);
            }
            if let Some(&steps) = header.adam_steps.get(&path) {
                optimiser.moments.insert(attribute, self.moments(&path, steps)?);
            }
        }
        let gaussians = Gaussians::from_tensors(|attribute| tensors.get(&attribute).map(|t| t.clone().autodiff()))
            .ok_or_else(|| self.misfit(format!("an attribute of the {name} branch is missing")))?;
        let statistics = DensifyStatistics {
            gradients: self.tensor(&format!("statistics.{name}.gradients"))?,
            seen: self.tensor(&format!("statistics.{name}.seen"))?,
            foreground: self.tensor(&format!("statistics.{name}.foreground"))?,
            radii: self.tensor(&format!("statistics.{name}.radii"))?,
        };
        Ok(Branch { gaussians, optimiser, statistics, sh_degree })
    }

    /// A tensor, if it is there.
    fn optional<const D: usize>(&mut self, name: &str) -> Result<Option<Tensor<D>>, ModelError> {
        self.tensors.contains_key(name).then(|| self.tensor(name)).transpose()
    }

    /// What the static branch had yet to learn from.
    fn pending(&mut self) -> Result<Option<Contribution>, ModelError> {
        let Some(visible) = self.optional(PENDING_VISIBLE)? else { return Ok(None) };
        let mut gradients = Vec::new();
        for attribute in Attribute::ALL {
            if let Some(gradient) = self.optional(&format!("pending.{attribute}"))? {
                gradients.push((attribute, gradient));
            }
        }
        Ok(Some(Contribution {
            sighting: Sighting { visible, foreground: None, radii: self.tensor(PENDING_RADII)? },
            screen: self.optional(PENDING_SCREEN)?,
            gradients: gradients.into_iter().collect(),
        }))
    }

    /// Puts the stored numbers into a module.
    fn fill<M: Module>(&mut self, name: &str, module: M) -> Result<M, ModelError> {
        let mut filler = Filler { reader: self, path: ParameterPath::new(name), failure: None };
        let module = module.map(&mut filler);
        match filler.failure {
            Some(error) => Err(error),
            None => Ok(module),
        }
    }
}

struct Filler<'r, 'a> {
    reader: &'r mut Reader<'a>,
    path: ParameterPath,
    failure: Option<ModelError>,
}

impl ModuleMapper for Filler<'_, '_> {
    fn enter_module(&mut self, name: &str, container_type: &str) {
        self.path.enter(name, container_type);
    }

    fn exit_module(&mut self, _name: &str, container_type: &str) {
        self.path.exit(container_type);
    }

    fn map_float<const D: usize>(&mut self, param: Param<Tensor<D>>) -> Param<Tensor<D>> {
        let name = self.path.name();
        let (id, value, mapper) = param.consume();
        let stored = self.reader.tensor::<D>(&name).and_then(|stored| match stored.dims() == value.dims() {
            true => Ok(stored),
            false => Err(self.reader.misfit(format!("`{name}` is {:?} instead of {:?}", stored.dims(), value.dims()))),
        });
        let value = match stored {
            Ok(stored) => stored.autodiff().require_grad(),
            Err(error) => {
                self.failure.get_or_insert(error);
                value
            }
        };
        Param::from_mapped_value(id, value, mapper)
    }
}
