//! Whether a checkpoint fits a configuration: branches, shapes and rows.

use std::collections::BTreeMap;

use burn::tensor::Tensor;

use super::Checkpoint;
use super::contents::{PENDING_RADII, PENDING_SCREEN, PENDING_VISIBLE, descriptors, moment_names};
use super::header::GridSize;
use super::read::is_of_branch;
use crate::ModelError;
use crate::config::{Branches, Config};
use crate::model::Model;
use crate::model::gaussians::Attribute;
use crate::train::densify::DensifyStatistics;
use crate::train::parameters::{Sink, walk};

/// Name of the exposures, whose shape determines the number of training cameras.
pub(super) const EXPOSURES: &str = "exposures.departures";

/// Branches in the order of files.
const BRANCHES: [&str; 2] = ["dynamic", "static"];

/// Groups of tensors besides the model's own.
const OF_TRAINING: [&str; 4] = ["adam.", "statistics.", "pending.", "motion."];

/// Number of columns of an attribute; `None` if the branch does not have it.
pub(super) fn columns(attribute: Attribute, branch: &str, config: &Config) -> Option<usize> {
    let is_dynamic = branch == BRANCHES[0];
    let has_lifetime = is_dynamic && config.model.lifetime;
    let coefficients = (config.model.sh_degree + 1).pow(2);
    match attribute {
        Attribute::Means | Attribute::ShDc | Attribute::LogScales => Some(3),
        Attribute::ShRest => Some(3 * (coefficients - 1)),
        Attribute::OpacityLogits => Some(1),
        Attribute::Quaternions => Some(4),
        Attribute::MaskLogits => (is_dynamic && config.model.branches == Branches::Both).then_some(3),
        Attribute::TimeCentres | Attribute::LogDurations => has_lifetime.then_some(1),
        Attribute::Velocities => has_lifetime.then_some(3),
    }
}

/// The shapes of all learned parameters.
#[derive(Default)]
struct Shapes(BTreeMap<String, Vec<usize>>);

impl Sink for Shapes {
    fn take<const D: usize>(&mut self, name: String, values: Tensor<D>) {
        self.0.insert(name, values.dims().to_vec());
    }
}

impl Checkpoint {
    /// Number of Gaussians of a branch.
    pub(super) fn rows(&self, branch: &str) -> Result<usize, ModelError> {
        let name = format!("{branch}.{}", Attribute::Means);
        match self.shape(&name) {
            Some(&[rows, 3]) if rows > 0 => Ok(rows),
            Some(shape) => Err(self.misfit(format!("`{name}` has the shape {shape:?} instead of [N, 3]"))),
            None => Err(self.misfit(format!("`{name}` is missing"))),
        }
    }

    /// Number of training cameras with an exposure.
    pub(super) fn cameras(&self) -> Result<usize, ModelError> {
        match self.shape(EXPOSURES) {
            Some(&[cameras, 3, 4]) if cameras > 0 => Ok(cameras),
            Some(shape) => Err(self.misfit(format!("`{EXPOSURES}` has the shape {shape:?} instead of [N, 3, 4]"))),
            None => Err(self.misfit(format!("`{EXPOSURES}` is missing"))),
        }
    }

    /// Checks the model's part before anything is allocated for it. The shapes of the networks' other layers are
    /// compared while they are filled.
    pub(super) fn check_model(&self, config: &Config) -> Result<(), ModelError> {
        config.check_scaled()?;
        config.check_of_run()?;
        let (header, model) = (&self.header, &config.model);
        let degrees = &header.sh_degrees;
        let branches = if model.branches == Branches::Both { 2 } else { 1 };
        if degrees.len() != branches {
            return Err(
                self.misfit(format!("`sh_degrees` has {} branches, the configuration {branches}", degrees.len()))
            );
        }
        if let Some(degree) = degrees.iter().find(|&&degree| degree > model.sh_degree) {
            let most = model.sh_degree;
            return Err(self.misfit(format!("`sh_degrees` has {degree}, the configuration `model.sh_degree` = {most}")));
        }
        let samples = config.motion.samples;
        if let Some(knots) = header.knot_times.as_ref().map(Vec::len).filter(|&knots| knots > samples) {
            return Err(self.misfit(format!("`knot_times` has {knots} times, more than `motion.samples` = {samples}")));
        }
        for branch in &BRANCHES[..branches] {
            self.check_branch(branch, config)?;
        }
        self.check_attributes(config)?;
        self.check_grid(config)
    }

    /// Checks that all attributes of a branch have its rows.
    fn check_branch(&self, branch: &str, config: &Config) -> Result<(), ModelError> {
        let rows = self.rows(branch)?;
        for attribute in Attribute::ALL {
            if let Some(columns) = columns(attribute, branch, config) {
                self.expect_rows(&format!("{branch}.{attribute}"), branch, [rows, columns])?;
            }
        }
        Ok(())
    }

    /// Like [`Checkpoint::expect`]; the message names the tensor that determines the rows.
    fn expect_rows(&self, name: &str, branch: &str, expected: [usize; 2]) -> Result<(), ModelError> {
        match self.shape(name) {
            Some(shape) if shape.len() == 2 && shape[0] != expected[0] => {
                let [rows, _] = expected;
                Err(self.misfit(format!("`{name}` has {} rows, and `{branch}.means` has {rows}", shape[0])))
            }
            _ => self.expect(name, &expected),
        }
    }

    /// Rejects attributes and exposures that the configured model does not have.
    fn check_attributes(&self, config: &Config) -> Result<(), ModelError> {
        let has = |name: &str| match name.split_once('.') {
            Some((branch, attribute)) if BRANCHES.contains(&branch) => {
                let attribute = Attribute::ALL.into_iter().find(|other| other.name() == attribute);
                let both = branch == BRANCHES[0] || config.model.branches == Branches::Both;
                both && attribute.is_some_and(|attribute| columns(attribute, branch, config).is_some())
            }
            _ => name != EXPOSURES || config.model.exposure,
        };
        match self.names().find(|name| !has(name)) {
            Some(name) => Err(self.misfit(format!("`{name}` is no part of the configured model"))),
            None => Ok(()),
        }
    }

    /// Checks the size of the grid and the first layer after it, which determine most of the network's memory.
    fn check_grid(&self, config: &Config) -> Result<(), ModelError> {
        let layout = config.model.grid.layout();
        let configured = GridSize::from(&layout);
        if let Some(stored) = self.header.grid_layout.as_ref().filter(|stored| **stored != configured) {
            let differing = |key: &str, stored: &dyn std::fmt::Debug, configured: &dyn std::fmt::Debug| {
                let (stored, configured) = (format!("{stored:?}"), format!("{configured:?}"));
                (stored != configured).then(|| {
                    format!("`grid_layout.{key}` is {stored}, the configuration has `model.grid.{key}` = {configured}")
                })
            };
            let reason = differing("features", &stored.features, &configured.features)
                .or_else(|| differing("resolution", &stored.resolution, &configured.resolution))
                .or_else(|| differing("multipliers", &stored.multipliers, &configured.multipliers));
            return Err(self.misfit(reason.unwrap_or_default()));
        }
        let cells =
            cells(&configured).ok_or_else(|| self.misfit(format!("`model.grid` is too large: {configured:?}")))?;
        self.expect("network.grid.planes", &[cells, configured.features])?;
        self.expect("network.trunk.layers.0.weight", &[layout.feature_count(), config.model.width])
    }

    /// Checks the state of the training around a model that has been read.
    pub(super) fn check_training(&self, model: &Model, config: &Config) -> Result<(), ModelError> {
        let (completed, total) = (self.header.completed, config.train.stages.total());
        if completed > total {
            return Err(self.misfit(format!("`completed` is {completed}, but the training has {total} steps")));
        }
        let mut parameters = Shapes::default();
        walk(model, &mut parameters);
        let mut expected = self.moment_shapes(&parameters)?;
        for (branch, gaussians) in model.branches() {
            for of in DensifyStatistics::NAMES {
                expected.insert(format!("statistics.{branch}.{of}"), vec![gaussians.count(), 1]);
            }
        }
        if let Some(static_) = model.static_.as_ref().filter(|_| self.names().any(|name| name.starts_with("pending.")))
        {
            let rows = static_.count();
            expected.insert(PENDING_VISIBLE.to_owned(), vec![rows, 1]);
            expected.insert(PENDING_RADII.to_owned(), vec![rows, 1]);
            let gradients = Attribute::ALL.into_iter().filter_map(|attribute| {
                Some((format!("pending.{attribute}"), parameters.0.get(&format!("static.{attribute}"))?.clone()))
            });
            let optional = gradients.chain([(PENDING_SCREEN.to_owned(), vec![rows, 2])]);
            expected.extend(optional.filter(|(name, _)| self.shape(name).is_some()));
        }
        expected.iter().try_for_each(|(name, shape)| self.expect(name, shape))?;
        // The model has read those of the motion descriptors.
        let descriptors = model.motion.as_ref().map_or(Vec::new(), descriptors);
        let read = |name: &str| descriptors.contains(&name);
        let is_other = |name: &&str| {
            OF_TRAINING.iter().any(|group| name.starts_with(group)) && !expected.contains_key(*name) && !read(name)
        };
        match self.names().find(is_other) {
            Some(name) => Err(self.misfit(format!("`{name}` is no part of a training state of this model"))),
            None => Ok(()),
        }
    }

    /// The shapes of Adam's moments. The message for another one names the parameter as well.
    fn moment_shapes(&self, parameters: &Shapes) -> Result<BTreeMap<String, Vec<usize>>, ModelError> {
        let mut expected = BTreeMap::new();
        for path in self.header.adam_steps.keys() {
            let is_of_network = ["grid.", "trunk.", "heads.", "masks."].iter().any(|part| path.starts_with(part));
            let name = if is_of_network { format!("network.{path}") } else { path.clone() };
            let Some(shape) = parameters.0.get(&name) else {
                return Err(self.misfit(format!("`adam_steps.{path}` belongs to no parameter of the configured model")));
            };
            let shape = if is_of_branch(path) { shape.clone() } else { vec![shape.iter().product()] };
            for moment in moment_names(path) {
                if let Some(found) = self.shape(&moment).filter(|found| *found != shape) {
                    return Err(
                        self.misfit(format!("`{moment}` has the shape {found:?} instead of {shape:?}, by `{name}`"))
                    );
                }
                expected.insert(moment, shape.clone());
            }
        }
        Ok(expected)
    }
}

/// Number of cells of all planes; `None` if it cannot be counted.
fn cells(size: &GridSize) -> Option<usize> {
    let [x, y, z, t] = size.resolution;
    let mut cells = 0usize;
    for &multiplier in &size.multipliers {
        let [x, y, z] = [x.checked_mul(multiplier)?, y.checked_mul(multiplier)?, z.checked_mul(multiplier)?];
        for (first, second) in [(x, y), (x, z), (x, t), (y, z), (y, t), (z, t)] {
            cells = cells.checked_add(first.checked_mul(second)?)?;
        }
    }
    cells.checked_mul(size.features).and(Some(cells))
}
