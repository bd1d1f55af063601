//! Statistics of simulated trajectories: the 13-dimensional signature, the local variances (METHOD §10.2, A5 to A9) and
//! the velocities.

use burn::tensor::{Tensor, TensorData};
use mvfusion_render::device::is_gpu;
use rayon::prelude::*;

use super::Lifetimes;
use crate::config::{Descriptor, FusionWeights, MotionConfig, Spread};
use crate::model::network::DeformationNetwork;
use crate::timeline::{Timeline, spread, strided};
use crate::{ModelError, tensors};

/// Length of a trajectory signature `V`: mean and variance of position (3 + 3), rotation, isotropic and anisotropic
/// scale (2 each), and the motion intensity.
pub const SIGNATURE_WIDTH: usize = 13;

/// Values of a velocity: one per axis.
pub const VELOCITY_WIDTH: usize = 3;

/// Values recorded per Gaussian and sample: position (3), rotation magnitude, isotropic and anisotropic log-scale.
const RECORD: usize = 6;

/// Largest number of recorded values that a GPU is asked for at once: 64 MiB of floats.
const MOST_RECORDS: usize = 16 << 20;

/// Sampling and statistics of trajectories.
#[derive(Clone, Debug)]
pub struct Trajectories<'a> {
    /// The network whose base deformation is sampled (A21). Without autodiff.
    pub network: &'a DeformationNetwork,
    /// The times of the training views.
    pub timeline: &'a Timeline,
    /// Samples, window, stride, weights, chunk.
    pub config: &'a MotionConfig,
    /// The scene's extent; displacements are divided by it, unless configured otherwise (A9b).
    pub extent: f64,
    /// The lifetimes of the Gaussians, if their trajectories are measured over them.
    pub lifetimes: Option<&'a Lifetimes>,
}

/// The statistics of the trajectories of `N` Gaussians.
#[derive(Clone, Debug, PartialEq)]
pub struct TrajectoryStatistics {
    /// Signatures `V`, row by row: `N * 13`.
    pub signatures: Vec<f64>,
    /// Local variances `e` at the knots, row by row: `N * knots`.
    pub local: Vec<f64>,
    /// Velocities at the knots, row by row and knot by knot, in displacements per video: `N * 3 knots`; empty unless
    /// MVG reads them.
    pub velocities: Vec<f64>,
    /// Times of the knots.
    pub knot_times: Vec<f64>,
}

impl Trajectories<'_> {
    /// Samples the trajectories of canonical centres `[N, 3]` (without autodiff), one chunk of Gaussians at a time, so
    /// that the memory does not grow with `N`.
    ///
    /// # Errors
    /// If the device fails to return values.
    pub fn measure(&self, means: &Tensor<2>) -> Result<TrajectoryStatistics, ModelError> {
        let times = self.sample_times();
        let knots = match self.config.knots {
            0 => strided(times.len(), self.config.knot_stride),
            count => spread(times.len(), count),
        };
        let summary = Summary { config: self.config, times: &times, knots: &knots };

        let count = means.dims()[0];
        let mut statistics = TrajectoryStatistics {
            signatures: Vec::with_capacity(count * SIGNATURE_WIDTH),
            local: Vec::with_capacity(count * knots.len()),
            velocities: Vec::new(),
            knot_times: knots.iter().map(|&k| times[k]).collect(),
        };
        let step = tensors::rows_at_once(self.config.chunk, means);
        for first in (0..count).step_by(step) {
            let chunk = step.min(count - first);
            let records = self.record(means.clone().narrow(0, first, chunk), &times)?;
            let path = |i| self.path(&records, i, chunk, first + i, &times);
            let rows: Vec<_> = (0..chunk).into_par_iter().map(|i| summary.of(&path(i))).collect();
            for Row { signature, local, velocities } in rows {
                statistics.signatures.extend_from_slice(&signature);
                statistics.local.extend_from_slice(&local);
                statistics.velocities.extend_from_slice(&velocities);
            }
        }
        Ok(statistics)
    }

    /// The path of Gaussian `index` of a chunk of `chunk` Gaussians, which is Gaussian `row` of all.
    fn path(&self, records: &[f32], index: usize, chunk: usize, row: usize, times: &[f64]) -> Path {
        let mut path = Path::of(records, index, chunk);
        if let Some(lifetimes) = self.lifetimes {
            for (axis, positions) in path.columns[..3].iter_mut().enumerate() {
                let travel = times.iter().map(|&time| lifetimes.travel(row, axis, time) / self.unit());
                positions.iter_mut().zip(travel).for_each(|(position, travel)| *position += travel);
            }
            path.weights = lifetimes.weights(row, times);
        }
        path
    }

    /// The unit of displacements.
    fn unit(&self) -> f64 {
        if self.config.in_extents { self.extent } else { 1.0 }
    }

    fn sample_times(&self) -> Vec<f64> {
        let samples = self.timeline.sample_indices(self.config.samples);
        let chosen = strided(samples.len(), self.config.sample_stride);
        chosen.into_iter().map(|k| self.timeline.times()[samples[k]]).collect()
    }

    /// The records of a chunk `[n, 3]` at every time, sample by sample: `[samples * n * 6]`.
    fn record(&self, means: Tensor<2>, times: &[f64]) -> Result<Vec<f32>, ModelError> {
        let record = |&time: &f64| {
            let feature = self.network.feature(means.clone(), tensors::scalar_like(&means, time));
            let geometry = self.network.heads.geometry(feature);
            let displacement = geometry.clone().narrow(1, 0, 3) / self.unit();
            let log_scale = geometry.clone().narrow(1, 3, 3);
            let rotation = geometry.narrow(1, 6, 4);
            let isotropic = log_scale.clone().mean_dim(1);
            Tensor::cat(vec![displacement, length(rotation), isotropic.clone(), length(log_scale - isotropic)], 1)
        };
        // A GPU is waited for once a group, and a CPU needs no group.
        let group = match is_gpu(&means.device()) {
            true => (MOST_RECORDS / (means.dims()[0] * RECORD).max(1)).max(1),
            false => 1,
        };
        let groups = times.chunks(group).map(|times| tensors::read(Tensor::cat(times.iter().map(record).collect(), 0)));
        Ok(groups.collect::<Result<Vec<Vec<f32>>, _>>()?.concat())
    }
}

/// Euclidean norm of each row: `[N, k]` to `[N, 1]`.
fn length(rows: Tensor<2>) -> Tensor<2> {
    rows.powf_scalar(2.0).sum_dim(1).sqrt()
}

/// The spread of a Gaussian's attributes over its trajectory.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct AttributeSpread {
    /// Spread of the position, averaged over the axes; in square extents, unless configured otherwise (A9, A9b).
    pub position: f64,
    /// Spread of the magnitude of the rotation offset.
    pub rotation: f64,
    /// Spread of the scale: the mean of the isotropic and anisotropic part.
    pub scale: f64,
}

impl AttributeSpread {
    /// The spread from a signature.
    pub(super) fn of(signature: &[f64]) -> Self {
        Self {
            position: signature[3..6].iter().sum::<f64>() / 3.0,
            rotation: signature[7],
            scale: 0.5 * (signature[9] + signature[11]),
        }
    }

    /// The motion intensity: weighted sum of position, scale and rotation variance (paper, eq. of the intensity score).
    pub fn fused(self, weights: FusionWeights) -> f64 {
        weights.position * self.position + weights.scale * self.scale + weights.rotation * self.rotation
    }
}

/// What one Gaussian does at every sample.
struct Path {
    columns: [Vec<f64>; RECORD],
    /// How much each sample counts.
    weights: Vec<f64>,
}

impl Path {
    /// The path of Gaussian `index` in a chunk of `chunk` Gaussians. All samples count alike.
    fn of(records: &[f32], index: usize, chunk: usize) -> Self {
        let samples = records.len() / (chunk * RECORD);
        let column =
            |channel: usize| (0..samples).map(|k| f64::from(records[(k * chunk + index) * RECORD + channel])).collect();
        Self { columns: std::array::from_fn(column), weights: vec![1.0; samples] }
    }
}

/// The statistics of one path.
struct Row {
    signature: [f64; SIGNATURE_WIDTH],
    local: Vec<f64>,
    velocities: Vec<f64>,
}

/// Computes the statistics of paths, in double precision, because `f32` loses the variances of small motions.
struct Summary<'a> {
    config: &'a MotionConfig,
    times: &'a [f64],
    knots: &'a [usize],
}

impl Summary<'_> {
    fn of(&self, path: &Path) -> Row {
        let moments: [Moments; RECORD] =
            std::array::from_fn(|channel| self.moments(&path.columns[channel], &path.weights));
        let mut signature = [0.0; SIGNATURE_WIDTH];
        for axis in 0..3 {
            signature[axis] = moments[axis].mean;
            signature[3 + axis] = moments[axis].spread;
        }
        for (pair, moments) in moments[3..].iter().enumerate() {
            signature[6 + 2 * pair] = moments.mean;
            signature[7 + 2 * pair] = moments.spread;
        }
        signature[12] = AttributeSpread::of(&signature).fused(self.config.weights);

        let local = self.knots.iter().map(|&knot| self.local_variance(path, knot)).collect();
        let velocities = match self.config.descriptor {
            Descriptor::Momentary => self.knots.iter().flat_map(|&knot| self.velocity(path, knot)).collect(),
            _ => Vec::new(),
        };
        Row { signature, local, velocities }
    }

    /// Variance of the displacement over the samples around `knot`, averaged over the axes (A8).
    fn local_variance(&self, path: &Path, knot: usize) -> f64 {
        let first = knot.saturating_sub(self.config.window);
        let end = (knot + self.config.window + 1).min(path.weights.len());
        let spread = |axis: &Vec<f64>| self.moments(&axis[first..end], &path.weights[first..end]).spread;
        path.columns[..3].iter().map(spread).sum::<f64>() / 3.0
    }

    /// Velocity between the samples before and after `knot`, at the ends between the last two; 0 with one sample.
    fn velocity(&self, path: &Path, knot: usize) -> [f64; VELOCITY_WIDTH] {
        let (before, after) = (knot.saturating_sub(1), (knot + 1).min(self.times.len() - 1));
        let duration = self.times[after] - self.times[before];
        std::array::from_fn(|axis| match duration > 0.0 {
            true => (path.columns[axis][after] - path.columns[axis][before]) / duration,
            false => 0.0,
        })
    }

    fn moments(&self, values: &[f64], weights: &[f64]) -> Moments {
        Moments::of(values, weights, self.config.spread)
    }
}

/// Mean and spread.
struct Moments {
    mean: f64,
    spread: f64,
}

impl Moments {
    /// Those of weighted values; of values that all count alike, the population's.
    fn of(values: &[f64], weights: &[f64], spread: Spread) -> Self {
        let total = weights.iter().sum::<f64>().max(f64::MIN_POSITIVE);
        let mean = values.iter().zip(weights).map(|(v, w)| w * v).sum::<f64>() / total;
        let variance = values.iter().zip(weights).map(|(v, w)| w * ((v - mean) * (v - mean))).sum::<f64>() / total;
        Self { mean, spread: spread.of(variance) }
    }
}

impl TrajectoryStatistics {
    /// The motion intensity of every Gaussian.
    pub fn intensities(&self) -> Vec<f64> {
        self.signatures.chunks_exact(SIGNATURE_WIDTH).map(|signature| signature[SIGNATURE_WIDTH - 1]).collect()
    }

    /// The spread of every Gaussian's attributes.
    pub fn spreads(&self) -> Vec<AttributeSpread> {
        self.signatures.chunks_exact(SIGNATURE_WIDTH).map(AttributeSpread::of).collect()
    }

    /// Number of Gaussians.
    pub fn len(&self) -> usize {
        self.signatures.len() / SIGNATURE_WIDTH
    }

    /// Whether there is no Gaussian.
    pub fn is_empty(&self) -> bool {
        self.signatures.is_empty()
    }

    /// The given row-major values as tensor data with `columns` columns.
    pub(super) fn table(values: Vec<f64>, columns: usize) -> TensorData {
        let rows = values.len() / columns.max(1);
        TensorData::new(values, [rows, columns])
    }
}

#[cfg(test)]
mod tests {
    use burn::module::Module;
    use burn::tensor::{DType, Device};
    use mvfusion_render::grid::{GridBounds, GridLayout};

    use super::*;
    use crate::model::network::{DeformationConfig, HeadChoice, ModuleInit};
    use crate::random::Stream;
    use crate::test_support::for_each_device;

    fn windowed(window: usize) -> MotionConfig {
        MotionConfig { window, ..MotionConfig::default() }
    }

    /// A network; its deformation is not asked for.
    fn still_network(device: &Device) -> DeformationNetwork {
        let deformation = DeformationConfig {
            layout: GridLayout { features: 1, resolution: [2; 4], multipliers: vec![1] },
            bounds: GridBounds { min: [-1.0; 3], max: [1.0; 3] },
            width: 2,
            depth: 1,
            heads: HeadChoice::ALL,
        };
        let mut stream = Stream::new(0, 0);
        let learning = device.clone().autodiff();
        deformation.init(&mut ModuleInit { device: &learning, dtype: DType::F32, stream: &mut stream }).valid()
    }

    /// Of samples a tenth of the video apart.
    fn summary<'a>(config: &'a MotionConfig, knots: &'a [usize]) -> Summary<'a> {
        Summary { config, times: &[0.0, 0.1, 0.2, 0.3, 0.4], knots }
    }

    /// Records of one Gaussian that moves along x by `step` per sample, for `samples` samples.
    fn moving(samples: usize, step: f32) -> Vec<f32> {
        (0..samples).flat_map(|k| [k as f32 * step, 0.0, 0.0, 0.25, 0.0, 0.0]).collect()
    }

    #[test]
    fn a_moving_gaussian_has_mean_and_variance_of_its_path() {
        let config = windowed(5);
        let summary = summary(&config, &[0, 2, 4]);
        let Row { signature, local, .. } = summary.of(&Path::of(&moving(5, 0.5), 0, 1));
        // Positions 0, 0.5, .. 2: mean 1, population variance 0.5.
        assert_eq!((signature[0], signature[3], signature[6], signature[7]), (1.0, 0.5, 0.25, 0.0));
        assert!((signature[12] - 0.7 * 0.5 / 3.0).abs() < 1e-15);
        assert!((local[0] - 0.5 / 3.0).abs() < 1e-15, "the window covers all five samples");
    }

    #[test]
    fn the_intensity_weighs_what_each_attribute_spreads() {
        // Rotation 0, 1; isotropic scale 0, 2; anisotropic scale 0, 4: population variances 0.25, 1 and 4.
        let records = [[0.0; RECORD], [0.0, 0.0, 0.0, 1.0, 2.0, 4.0]].concat();
        let config = windowed(5);
        let Row { signature, local, velocities } = summary(&config, &[0]).of(&Path::of(&records, 0, 1));
        let statistics =
            TrajectoryStatistics { signatures: signature.to_vec(), local, velocities, knot_times: vec![0.0] };
        let spreads = statistics.spreads();
        assert_eq!(spreads, [AttributeSpread { position: 0.0, rotation: 0.25, scale: 2.5 }]);
        let weights = FusionWeights { position: 7.0, scale: 2.0, rotation: 4.0 };
        assert_eq!(spreads[0].fused(weights), 6.0);
        assert_eq!(spreads[0].fused(FusionWeights::default()), statistics.intensities()[0]);
    }

    #[test]
    fn a_deviation_is_the_root_of_a_variance() {
        let config = MotionConfig { spread: Spread::Deviation, ..windowed(5) };
        let Row { signature, local, .. } = summary(&config, &[0]).of(&Path::of(&moving(5, 0.5), 0, 1));
        assert_eq!(signature[3], 0.5f64.sqrt());
        assert!((local[0] - 0.5f64.sqrt() / 3.0).abs() < 1e-15);
    }

    #[test]
    fn a_resting_gaussian_has_no_variance() {
        let config = windowed(1);
        let summary = summary(&config, &[0, 3]);
        let Row { signature, local, .. } = summary.of(&Path::of(&moving(4, 0.0), 0, 1));
        assert_eq!(signature[12], 0.0);
        assert_eq!(local, [0.0, 0.0]);
    }

    #[test]
    fn the_window_is_cut_at_the_ends() {
        let config = windowed(1);
        let summary = summary(&config, &[0, 2]);
        let Row { local, .. } = summary.of(&Path::of(&moving(5, 1.0), 0, 1));
        // Two samples 0, 1 at the start; three samples 1, 2, 3 in the middle.
        assert!((local[0] - 0.25 / 3.0).abs() < 1e-15);
        assert!((local[1] - (2.0 / 3.0) / 3.0).abs() < 1e-15);
    }

    #[test]
    fn a_velocity_is_that_of_the_moment() {
        let config = MotionConfig { descriptor: Descriptor::Momentary, ..windowed(1) };
        let mut path = Path::of(&moving(5, 0.5), 0, 1);
        let found = summary(&config, &[0, 2, 4]).of(&path).velocities;
        for (knot, velocity) in found.chunks_exact(VELOCITY_WIDTH).enumerate() {
            assert!((velocity[0] - 5.0).abs() < 1e-6 && velocity[1..] == [0.0, 0.0], "{knot}: {velocity:?}");
        }
        path.columns[0][1] = 100.0;
        assert!(summary(&config, &[0]).of(&path).velocities[0] > 100.0);
        assert_eq!(Summary { config: &config, times: &[0.0], knots: &[0] }.of(&path).velocities, [0.0; 3]);
        assert!(summary(&windowed(1), &[0]).of(&path).velocities.is_empty());
    }

    #[test]
    fn a_path_over_a_lifetime_includes_the_travel_and_its_weights() {
        for_each_device(|device| {
            let network = still_network(&device);
            let (timeline, config) = (Timeline::new(vec![0.0, 0.5, 1.0]), windowed(1));
            let lifetimes = Lifetimes::new(vec![0.5], vec![0.5], vec![6.0, 0.0, 0.0]);
            let with = |lifetimes| Trajectories {
                network: &network,
                timeline: &timeline,
                config: &config,
                extent: 2.0,
                lifetimes,
            };
            let records = [0.0; 3 * RECORD];
            let path = with(Some(&lifetimes)).path(&records, 0, 1, 0, timeline.times());
            // Velocity 6 in extents of 2, half a video before and after the centre.
            assert_eq!(path.columns[0], [-1.5, 0.0, 1.5]);
            let faded = (-1f64).exp();
            assert!(path.weights.iter().zip([faded, 1.0, faded]).all(|(a, b)| (a - b).abs() < 1e-12));
            assert_eq!(with(None).path(&records, 0, 1, 0, timeline.times()).columns[0], [0.0; 3]);
        });
    }

    #[test]
    fn what_a_gaussian_does_while_it_is_not_there_does_not_count() {
        let config = windowed(5);
        let mut path = Path::of(&moving(5, 0.5), 0, 1);
        let without = summary(&config, &[2]).of(&Path::of(&moving(3, 0.5), 0, 1));
        path.weights[3..].fill(0.0);
        path.columns[0][4] = 1e9;
        let found = summary(&config, &[2]).of(&path);
        assert_eq!((found.signature, found.local), (without.signature, without.local));
    }
}
