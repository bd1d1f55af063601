//! A run's state as one file: tensors as safetensors, everything else as JSON in its header.

use std::collections::{BTreeMap, HashMap};
use std::fs::File;
use std::io::{self, Read, Seek, SeekFrom, Write};
use std::path::Path;

use burn::module::{Module, ModuleMapper, Param};
use burn::tensor::{DType, Device, Tensor, TensorData};
use mvfusion_render::grid::GridBounds;
use mvfusion_render::optim::AdamMoments;
use safetensors::tensor::{Dtype, Metadata, TensorInfo, TensorView};
use serde::{Deserialize, Serialize};
use sha2::{Digest, Sha256};

use super::Visibility;
use super::parameters::{Sink, walk};
use super::{BranchGradients, Sampler, TrainState};
use crate::ModelError;
use crate::config::{Branches, Config};
use crate::files::hexadecimal;
use crate::model::Model;
use crate::model::exposure::Exposures;
use crate::model::gaussians::{Attribute, Gaussians};
use crate::model::motion::{MotionCache, MotionRefinement, Normalisers};
use crate::model::network::{DeformationConfig, ModuleInit};
use crate::parameter_path::ParameterPath;
use crate::random::{Stream, Streams};
use crate::train::densify::{BranchState, DensifyCounts, DensifyStatistics};
use crate::train::optim::{GaussianOptimiser, ModuleOptimiser};

/// Header key of everything except the tensors.
const HEADER: &str = "mvfusion";

/// Name of the exposures, whose shape determines the number of training cameras.
const EXPOSURES: &str = "exposures.departures";

/// Names of the accumulated data of the static branch, besides its gradients.
const PENDING_SCREEN: &str = "pending.screen";
const PENDING_RADII: &str = "pending.radii";
const PENDING_VISIBLE: &str = "pending.visible";

/// The contents of a checkpoint except the tensors.
#[derive(Debug, Serialize, Deserialize)]
struct Header {
    completed: usize,
    /// SH degree of the dynamic branch, then of the static branch, if there is one.
    sh_degrees: Vec<usize>,
    grid_max: [f64; 3],
    grid_min: [f64; 3],
    knot_times: Option<Vec<f64>>,
    adam_steps: BTreeMap<String, usize>,
    normalisers: Normalisers,
    streams: Streams,
    sampler: Sampler,
    /// Counts of the dynamic branch, then of the static branch.
    #[serde(rename = "census")]
    counts: [DensifyCounts; 2],
    refreshes: usize,
}

/// Tensors by name, on the host.
type Tensors = BTreeMap<String, TensorData>;

impl TrainState {
    /// Writes the state to a temporary file and renames it, so that a crash does not damage the old file.
    ///
    /// # Errors
    /// If the device fails to return values or the file cannot be written.
    pub fn save(&self, path: &Path) -> Result<(), ModelError> {
        let mut tensors = parameters(&self.model)?;
        let mut adam_steps = BTreeMap::new();
        let states = std::iter::once(&self.dynamic).chain(&self.static_);
        for ((name, _), state) in self.model.branches().zip(states) {
            // A new field of the state is a compile error here until it is decided whether files need it.
            let BranchState { optimiser, statistics, pending, counts: _ } = state;
            for (attribute, moments) in &optimiser.moments {
                store_moments(&mut tensors, &mut adam_steps, &format!("{name}.{attribute}"), moments)?;
            }
            store(&mut tensors, format!("statistics.{name}.gradients"), statistics.gradients.clone())?;
            store(&mut tensors, format!("statistics.{name}.seen"), statistics.seen.clone())?;
            store(&mut tensors, format!("statistics.{name}.foreground"), statistics.foreground.clone())?;
            store(&mut tensors, format!("statistics.{name}.radii"), statistics.radii.clone())?;
            if let Some(pending) = pending {
                store_pending(&mut tensors, pending)?;
            }
        }
        for (path, moments) in &self.optimiser.moments {
            store_moments(&mut tensors, &mut adam_steps, path, moments)?;
        }
        if let Some(cache) = &self.model.motion {
            store(&mut tensors, "motion.signatures".to_owned(), cache.signatures.clone())?;
            store(&mut tensors, "motion.local".to_owned(), cache.local.clone())?;
            store(&mut tensors, "motion.intensity".to_owned(), cache.intensity.clone())?;
        }
        let bounds = self.model.network.grid.bounds();
        let header = Header {
            completed: self.completed,
            sh_degrees: self.model.branches().map(|(_, gaussians)| gaussians.sh_degree).collect(),
            grid_max: bounds.max,
            grid_min: bounds.min,
            knot_times: self.model.motion.as_ref().map(|cache| cache.knot_times.clone()),
            adam_steps,
            normalisers: self.normalisers.clone(),
            streams: self.streams.clone(),
            sampler: self.sampler.clone(),
            counts: self.counts(),
            refreshes: self.refreshes,
        };
        write(path, &tensors, &header)
    }

    /// Reads a state that was written with the same `config`, to `device` (with autodiff).
    ///
    /// # Errors
    /// If the file cannot be read, is not a checkpoint, or does not match the configuration.
    pub fn load(path: &Path, config: &Config, device: &Device) -> Result<Self, ModelError> {
        let (mut reader, header) = Reader::open(path, device)?;
        let mut optimiser = ModuleOptimiser::default();
        for (name, &steps) in &header.adam_steps {
            let in_module = !name.starts_with("dynamic.") && !name.starts_with("static.");
            if in_module {
                optimiser.moments.insert(name.clone(), reader.moments(name, steps)?);
            }
        }
        let model = reader.model(config, &header)?;
        Ok(Self {
            completed: header.completed,
            dynamic: reader.state("dynamic", &header)?,
            static_: model.static_.is_some().then(|| reader.state("static", &header)).transpose()?,
            model,
            optimiser,
            normalisers: header.normalisers,
            streams: header.streams,
            sampler: header.sampler,
            refreshes: header.refreshes,
        })
    }
}

/// A trained model without autodiff, for evaluation.
#[derive(Clone, Debug)]
pub struct TrainedModel {
    /// The model.
    pub model: Model,
    /// Number of training steps.
    pub steps: usize,
}

impl TrainedModel {
    /// Reads only the model of a checkpoint.
    ///
    /// # Errors
    /// Same as [`TrainState::load`].
    pub fn load(path: &Path, config: &Config, device: &Device) -> Result<Self, ModelError> {
        let device = device.clone().autodiff();
        let (mut reader, header) = Reader::open(path, &device)?;
        Ok(Self { model: reader.model(config, &header)?.plain(), steps: header.completed })
    }
}

impl From<&TrainState> for TrainedModel {
    fn from(state: &TrainState) -> Self {
        Self { model: state.model.plain(), steps: state.completed }
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

fn store_pending(tensors: &mut Tensors, pending: &BranchGradients) -> Result<(), ModelError> {
    for attribute in Attribute::ALL {
        if let Some(gradient) = pending.attributes.of(attribute) {
            store(tensors, format!("pending.{attribute}"), gradient.clone())?;
        }
    }
    if let Some(screen) = &pending.screen {
        store(tensors, PENDING_SCREEN.to_owned(), screen.clone())?;
    }
    store(tensors, PENDING_RADII.to_owned(), pending.visibility.radii.clone())?;
    store(tensors, PENDING_VISIBLE.to_owned(), pending.visibility.visible.clone())
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

fn unreadable(path: &Path, error: &io::Error) -> ModelError {
    ModelError::File { action: "read", path: path.to_owned(), reason: error.to_string() }
}

/// A checkpoint that is being read. Tensors are read on request, so unused tensors cost nothing.
struct Reader<'a> {
    path: &'a Path,
    file: File,
    /// Start of the tensors in the file.
    start: u64,
    tensors: HashMap<String, TensorInfo>,
    device: &'a Device,
}

impl<'a> Reader<'a> {
    fn open(path: &'a Path, device: &'a Device) -> Result<(Self, Header), ModelError> {
        let misfit = |reason: String| ModelError::Checkpoint { path: path.to_owned(), reason };
        let mut file = File::open(path).map_err(|error| unreadable(path, &error))?;
        let length = file.metadata().map_err(|error| unreadable(path, &error))?.len();
        let mut size = [0; 8];
        let broken = |_| misfit("it ends before its header does".to_owned());
        file.read_exact(&mut size).map_err(broken)?;
        let size = u64::from_le_bytes(size);
        if size > length {
            return Err(misfit("it ends before its header does".to_owned()));
        }
        let mut header = vec![0; usize::try_from(size).map_err(|error| misfit(error.to_string()))?];
        file.read_exact(&mut header).map_err(broken)?;
        let metadata: Metadata = serde_json::from_slice(&header).map_err(|error| misfit(error.to_string()))?;
        let header = metadata.metadata().as_ref().and_then(|entries| entries.get(HEADER));
        let header = header.ok_or_else(|| misfit("it has no header of this program".to_owned()))?;
        let header: Header = serde_json::from_str(header).map_err(|error| misfit(error.to_string()))?;
        let tensors: HashMap<String, TensorInfo> =
            metadata.tensors().into_iter().map(|(name, info)| (name, info.clone())).collect();
        let end = tensors.values().map(|info| info.data_offsets.1 as u64).max().unwrap_or(0);
        let start = 8 + size;
        if start.checked_add(end) != Some(length) {
            return Err(misfit(format!("it has {length} bytes, and its header says {start} and {end}")));
        }
        Ok((Self { path, file, start, tensors, device }, header))
    }

    fn misfit(&self, reason: String) -> ModelError {
        ModelError::Checkpoint { path: self.path.to_owned(), reason }
    }

    /// A tensor without autodiff.
    fn tensor<const D: usize>(&mut self, name: &str) -> Result<Tensor<D>, ModelError> {
        let info = self.tensors.remove(name).ok_or_else(|| self.misfit(format!("`{name}` is missing")))?;
        if info.shape.len() != D {
            return Err(self.misfit(format!("`{name}` has {} dimensions instead of {D}", info.shape.len())));
        }
        let (first, end) = info.data_offsets;
        let numbers = info.shape.iter().try_fold(4usize, |bytes, &side| bytes.checked_mul(side));
        if info.dtype != Dtype::F32 || end.checked_sub(first) != numbers {
            return Err(self.misfit(format!("`{name}` does not hold {:?} numbers of 32 bits", info.shape)));
        }
        let mut bytes = vec![0; end - first];
        let read = self.file.seek(SeekFrom::Start(self.start + first as u64));
        read.and_then(|_| self.file.read_exact(&mut bytes)).map_err(|error| unreadable(self.path, &error))?;
        let values: Vec<f32> = bytes.as_chunks().0.iter().map(|&number| f32::from_le_bytes(number)).collect();
        Ok(Tensor::from_data(TensorData::new(values, info.shape), &self.device.clone().inner()))
    }

    fn moments<const D: usize>(&mut self, name: &str, steps: usize) -> Result<AdamMoments<D>, ModelError> {
        let first = self.tensor(&format!("adam.{name}.first"))?;
        let second = self.tensor(&format!("adam.{name}.second"))?;
        Ok(AdamMoments { first, second, steps })
    }

    fn model(&mut self, config: &Config, header: &Header) -> Result<Model, ModelError> {
        let bounds = GridBounds { max: header.grid_max, min: header.grid_min };
        // The weights are overwritten below, so any stream works.
        let mut stream = Stream::new(0, 0);
        let mut init = ModuleInit { device: self.device, dtype: DType::F32, stream: &mut stream };
        let deformation = DeformationConfig::of(&config.model, bounds);
        let network = deformation.init(&mut init);
        let refinement = MotionRefinement::new(&deformation, &config.motion, &mut init);
        let (degrees, both) = (&header.sh_degrees, config.model.branches == Branches::Both);
        let static_degree = degrees.get(1).filter(|_| both);
        let (Some(&dynamic_degree), true) = (degrees.first(), both == static_degree.is_some()) else {
            return Err(self.misfit(format!("it holds {} branches", degrees.len())));
        };
        Ok(Model {
            dynamic: self.gaussians("dynamic", dynamic_degree)?,
            static_: static_degree.map(|&degree| self.gaussians("static", degree)).transpose()?,
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
                    inherits: config.motion.inherit,
                }),
                None => None,
            },
        })
    }

    fn gaussians(&mut self, name: &str, sh_degree: usize) -> Result<Gaussians, ModelError> {
        let mut tensors = BTreeMap::new();
        for attribute in Attribute::ALL {
            if let Some(values) = self.optional::<2>(&format!("{name}.{attribute}"))? {
                tensors.insert(attribute, values.autodiff());
            }
        }
        let gaussians = Gaussians::from_tensors(|attribute| tensors.get(&attribute).cloned())
            .ok_or_else(|| self.misfit(format!("an attribute of the {name} branch is missing")))?;
        Ok(Gaussians { sh_degree, ..gaussians })
    }

    /// The training state of a branch.
    fn state(&mut self, name: &str, header: &Header) -> Result<BranchState, ModelError> {
        let mut optimiser = GaussianOptimiser::default();
        for attribute in Attribute::ALL {
            let path = format!("{name}.{attribute}");
            if let Some(&steps) = header.adam_steps.get(&path) {
                optimiser.moments.insert(attribute, self.moments(&path, steps)?);
            }
        }
        let mut statistic = |of: &str| self.tensor(&format!("statistics.{name}.{of}"));
        let statistics = DensifyStatistics {
            gradients: statistic("gradients")?,
            seen: statistic("seen")?,
            foreground: statistic("foreground")?,
            radii: statistic("radii")?,
        };
        // Only the static branch accumulates gradients.
        let [dynamic, static_] = header.counts;
        Ok(match name {
            "static" => BranchState { optimiser, statistics, pending: self.pending()?, counts: static_ },
            _ => BranchState { optimiser, statistics, pending: None, counts: dynamic },
        })
    }

    /// A tensor, if it exists.
    fn optional<const D: usize>(&mut self, name: &str) -> Result<Option<Tensor<D>>, ModelError> {
        self.tensors.contains_key(name).then(|| self.tensor(name)).transpose()
    }

    /// The accumulated gradients of the static branch.
    fn pending(&mut self) -> Result<Option<BranchGradients>, ModelError> {
        let Some(visible) = self.optional(PENDING_VISIBLE)? else { return Ok(None) };
        let mut gradients = Vec::new();
        for attribute in Attribute::ALL {
            if let Some(gradient) = self.optional(&format!("pending.{attribute}"))? {
                gradients.push((attribute, gradient));
            }
        }
        Ok(Some(BranchGradients {
            visibility: Visibility { visible, foreground: None, radii: self.tensor(PENDING_RADII)? },
            screen: self.optional(PENDING_SCREEN)?,
            attributes: gradients.into_iter().collect(),
        }))
    }

    /// Fills a module with the stored values.
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
