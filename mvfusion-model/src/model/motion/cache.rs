//! The cached motion descriptors of the dynamic Gaussians.

use std::sync::{Arc, OnceLock};

use burn::tensor::{Int, Tensor};

use super::near::Near;
use super::normaliser::MovingNormaliser;
use super::statistics::{SIGNATURE_WIDTH, TrajectoryStatistics, VELOCITY_WIDTH};
use crate::ModelError;
use crate::config::{Descriptor, MotionConfig, Trajectory};
use crate::model::gaussians::{Attribute, Gaussians, LEAST_LOG_DURATION};
use crate::model::rows::{PerGaussian, RowMap};
use crate::tensors;
use crate::timeline::{Between, between};

/// Variance of times that are uniform in `[0, 1]`.
const VARIANCE_OF_TIME: f64 = 1.0 / 12.0;

/// Normalised descriptors, one row per Gaussian, without gradient (METHOD A10, A25). Rows follow the Gaussians.
/// Gaussians without a parent have none until they are measured.
#[derive(Clone, Debug)]
pub struct MotionCache {
    /// Normalised signatures: `[N, 13]`.
    pub signatures: Tensor<2>,
    /// Normalised local variances at the knots: `[N, knots]`.
    pub local: Tensor<2>,
    /// Normalised velocities at the knots, knot by knot: `[N, 3 knots]`. Only with `motion.descriptor = "momentary"`.
    pub velocities: Option<Tensor<2>>,
    /// The nearest other Gaussians. Only with `motion.temporal = "spatial"`.
    pub near: Option<Near>,
    /// Raw motion intensity, for renders and pruning: `[N, 1]`.
    pub intensity: Tensor<2>,
    /// Times of the knots.
    pub knot_times: Vec<f64>,
    /// Whether new Gaussians inherit their parent's descriptors (`motion.inherit`).
    pub inherits: bool,
    /// Whether the intensity includes the travel of Gaussians with their own velocities.
    pub includes_travel: bool,
    /// The encoding of `signatures`, which MVG reads; other signatures need a new one.
    pub encoding: Encoding,
}

/// What MVG makes of the signatures, computed once until they change. Clones share it; selected rows, those of a moment
/// with lifetimes, are encoded anew.
#[derive(Clone, Debug, Default)]
pub struct Encoding(Arc<OnceLock<Tensor<2>>>);

/// The normalisers of signatures, local variances and velocities.
#[derive(Clone, Debug, Default, PartialEq, serde::Serialize, serde::Deserialize)]
pub struct Normalisers {
    /// Thirteen columns.
    pub signatures: MovingNormaliser,
    /// One column for all knots (A10b).
    pub local: MovingNormaliser,
    /// Three columns, the same for all knots.
    #[serde(default)]
    pub velocities: MovingNormaliser,
}

impl Normalisers {
    /// Updates them with what the modules read of the statistics of all Gaussians.
    fn update(&mut self, statistics: &TrajectoryStatistics, config: &MotionConfig) {
        let TrajectoryStatistics { signatures, local, velocities, knot_times: _ } = statistics;
        self.signatures.update(signatures, SIGNATURE_WIDTH, config);
        if config.normalise_local {
            self.local.update(local, 1, config);
        }
        if config.descriptor == Descriptor::Momentary {
            self.velocities.update(velocities, VELOCITY_WIDTH, config);
        }
    }
}

impl MotionCache {
    /// The cache of new statistics of all canonical centres `[N, 3]`, with which the normalisers are updated.
    ///
    /// # Errors
    /// If the device fails to return values.
    pub fn new(
        statistics: TrajectoryStatistics,
        normalisers: &mut Normalisers,
        config: &MotionConfig,
        means: &Tensor<2>,
    ) -> Result<Self, ModelError> {
        let statistics = read_by_modules(statistics, config);
        normalisers.update(&statistics, config);
        let cache = Self::normalised(statistics, normalisers, config, means);
        Ok(Self {
            near: config.reads_neighbours().then(|| Near::of(means, &cache.local, config.neighbours)).transpose()?,
            ..cache
        })
    }

    /// The cache of further Gaussians, of statistics of their canonical centres `[M, 3]`. The centres `[N, 3]` of the
    /// Gaussians of this cache may be neighbours of theirs. The normalisers have been updated with those alone.
    ///
    /// # Errors
    /// If the device fails to return values.
    pub fn of_further(
        &self,
        statistics: TrajectoryStatistics,
        normalisers: &Normalisers,
        config: &MotionConfig,
        [known, further]: [&Tensor<2>; 2],
    ) -> Result<Self, ModelError> {
        let cache = Self::normalised(read_by_modules(statistics, config), normalisers, config, further);
        let near = config.reads_neighbours().then(|| {
            let [first, count] = [known, further].map(|means| means.dims()[0]);
            let rows: Vec<usize> = (first..first + count).collect();
            let joined = |first: &Tensor<2>, last: &Tensor<2>| Tensor::cat(vec![first.clone(), last.clone()], 0);
            let near = Near::of(&joined(known, further), &joined(&self.local, &cache.local), config.neighbours)?;
            Ok::<_, ModelError>(near.select(&tensors::rows_like(&rows, further)))
        });
        Ok(Self { near: near.transpose()?, ..cache })
    }

    /// The normalised statistics of canonical centres, without neighbours.
    fn normalised(
        statistics: TrajectoryStatistics,
        normalisers: &Normalisers,
        config: &MotionConfig,
        means: &Tensor<2>,
    ) -> Self {
        let knots = statistics.knot_times.len();
        let table = |values, columns| tensors::from_data_like(TrajectoryStatistics::table(values, columns), means);
        let local = match config.normalise_local {
            true => normalisers.local.normalise(&statistics.local, config),
            false => statistics.local.clone(),
        };
        let velocities = (config.descriptor == Descriptor::Momentary)
            .then(|| normalisers.velocities.normalise(&statistics.velocities, config));
        Self {
            signatures: table(normalisers.signatures.normalise(&statistics.signatures, config), SIGNATURE_WIDTH),
            local: table(local, knots),
            velocities: velocities.map(|velocities| table(velocities, VELOCITY_WIDTH * knots)),
            near: None,
            intensity: table(statistics.intensities(), 1),
            knot_times: statistics.knot_times,
            inherits: config.inherit,
            includes_travel: config.trajectory == Trajectory::Lifetime,
            encoding: Encoding::default(),
        }
    }

    /// The signatures as `encode` encodes them, always in the same way: `[N, columns]`.
    pub(super) fn encoded(&self, encode: impl FnOnce(Tensor<2>) -> Tensor<2>) -> Tensor<2> {
        self.encoding.0.get_or_init(|| encode(self.signatures.clone())).clone()
    }

    /// Local motion intensity `e(t)`, `[N, 1]`: linear between knots, constant outside.
    pub fn local_at(&self, time: f64) -> Tensor<2> {
        at_knots(between(&self.knot_times, time), |index| self.local.clone().narrow(1, index, 1))
    }

    /// What MVG reads of a time: the local intensity, `[N, 1]`, and the velocity if there is one, `[N, 4]`.
    pub(super) fn moment_at(&self, time: f64) -> Tensor<2> {
        let local = self.local_at(time);
        let Some(velocities) = &self.velocities else { return local };
        let knot = |index| velocities.clone().narrow(1, VELOCITY_WIDTH * index, VELOCITY_WIDTH);
        Tensor::cat(vec![local, at_knots(between(&self.knot_times, time), knot)], 1)
    }

    /// Stillness of each Gaussian in `[0, 1]`: `exp(-variance / mean variance)` times its duration as a fraction of the
    /// video, because short-lived Gaussians show moving objects. The variance is the motion intensity plus, unless that
    /// includes it, the variance of the travel with its velocity through the whole video. `[N, 1]`, without autodiff.
    pub fn stillness(&self, gaussians: &Gaussians, extent: f64) -> Tensor<2> {
        let mut variance = self.intensity.clone();
        if let Some(velocities) = gaussians.plain(Attribute::Velocities).filter(|_| !self.includes_travel) {
            variance = variance + (velocities / extent).powf_scalar(2.0).mean_dim(1) * VARIANCE_OF_TIME;
        }
        let mean = variance.clone().mean().reshape([1, 1]).clamp_min(f32::MIN_POSITIVE);
        let unmoved = (-variance / mean).exp();
        match gaussians.plain(Attribute::LogDurations) {
            // Lifetimes of at least the video's length count as permanent.
            Some(durations) => unmoved * durations.clamp(LEAST_LOG_DURATION, 0.0).exp(),
            None => unmoved,
        }
    }

    /// Gives the last rows, those of Gaussians without a parent, their own descriptors.
    pub fn replace_last(&mut self, further: Self) {
        let replace = |values: &mut Tensor<2>, further: Tensor<2>| {
            // Ops do not accept empty tensors, and there may have been no Gaussian.
            *values = match values.dims()[0] - further.dims()[0] {
                0 => further,
                kept => Tensor::cat(vec![values.clone().narrow(0, 0, kept), further], 0),
            };
        };
        replace(&mut self.signatures, further.signatures);
        replace(&mut self.local, further.local);
        replace(&mut self.intensity, further.intensity);
        if let (Some(values), Some(further)) = (&mut self.velocities, further.velocities) {
            replace(values, further);
        }
        if let (Some(near), Some(further)) = (&mut self.near, further.near) {
            replace(&mut near.means, further.means);
            replace(&mut near.local, further.local);
        }
        self.encoding = Encoding::default();
    }

    /// The rows of the given Gaussians, in that order.
    pub fn select(self, rows: &Tensor<1, Int>) -> Self {
        Self {
            signatures: self.signatures.select(0, rows.clone()),
            local: self.local.select(0, rows.clone()),
            velocities: self.velocities.map(|velocities| velocities.select(0, rows.clone())),
            near: self.near.map(|near| near.select(rows)),
            intensity: self.intensity.select(0, rows.clone()),
            encoding: Encoding::default(),
            ..self
        }
    }
}

/// The part of statistics that the modules read.
fn read_by_modules(statistics: TrajectoryStatistics, config: &MotionConfig) -> TrajectoryStatistics {
    match config.descriptor {
        // Applied before the normaliser, which keeps columns of zeros.
        Descriptor::PositionVariance => statistics.position_only(),
        // Raw offsets are computed when they are needed. Tokens and intensity use the measurement.
        Descriptor::Variances | Descriptor::Offsets | Descriptor::Momentary => statistics,
    }
}

/// Values between two knots, of those at a knot.
pub(super) fn at_knots(place: Between, knot: impl Fn(usize) -> Tensor<2>) -> Tensor<2> {
    if place.lower == place.upper {
        return knot(place.lower);
    }
    knot(place.lower) * (1.0 - place.weight) + knot(place.upper) * place.weight
}

impl PerGaussian for MotionCache {
    fn follow(&mut self, map: &RowMap) {
        let Self {
            signatures,
            local,
            velocities,
            near,
            intensity,
            knot_times: _,
            inherits,
            includes_travel: _,
            encoding,
        } = self;
        *encoding = Encoding::default();
        near.follow(map);
        for values in [signatures, local, intensity].into_iter().chain(velocities) {
            *values = if *inherits { map.inherit(values) } else { map.keep(values) };
        }
    }
}

#[cfg(test)]
mod tests {
    use burn::tensor::{DType, TensorData};
    use glam::Vec3;
    use mvfusion_data::{GaussianCloud, Lifetime, PointCloud};

    use super::*;
    use crate::initial::{Masking, cloud_on, gaussians_of};
    use crate::test_support::{for_each_device, values};

    /// A cache whose signatures and local variances have the same single column.
    fn of_columns(signatures: Tensor<2>, intensity: Tensor<2>) -> MotionCache {
        MotionCache {
            local: signatures.clone(),
            signatures,
            velocities: None,
            near: None,
            intensity,
            knot_times: vec![0.5],
            inherits: true,
            includes_travel: false,
            encoding: Encoding::default(),
        }
    }

    #[test]
    fn further_gaussians_get_their_own_descriptors_even_if_there_was_none() {
        for_each_device(|device| {
            let column = |numbers: &[f64]| {
                let data = TensorData::new(numbers.to_vec(), [numbers.len(), 1]);
                Tensor::<2>::from_data(data, (&device, DType::F32))
            };
            for known in [&[][..], &[1.0, 2.0]] {
                let mut cache = of_columns(column(known), column(known));
                cache.follow(&RowMap::appending(known.len(), 2));
                cache.replace_last(of_columns(column(&[7.0, 8.0]), column(&[9.0, 10.0])));
                let with = |further: [f64; 2]| [known, &further].concat();
                assert_eq!(values(cache.signatures), with([7.0, 8.0]));
                assert_eq!(values(cache.local), with([7.0, 8.0]));
                assert_eq!(values(cache.intensity), with([9.0, 10.0]));
            }
        });
    }

    #[test]
    fn what_neither_moves_nor_travels_nor_goes_is_still() {
        for_each_device(|device| {
            let points = PointCloud { positions: vec![Vec3::ZERO; 4], colours: vec![Vec3::ONE; 4] };
            let life =
                |duration: f32, speed| Lifetime { centre: 0.5, log_duration: duration.ln(), velocity: [speed; 3] };
            let lifetimes = Some(vec![life(1e3, 0.0), life(1e3, 0.0), life(1e3, 6.0), life(0.25, 0.0)]);
            let cloud = GaussianCloud { lifetimes, ..cloud_on(&points, &[1.0; 4], 0.1) };
            let gaussians = gaussians_of(&cloud, Masking::Absent, 0, &device.clone().autodiff(), DType::F32);
            let like = gaussians.plain(Attribute::Means).expect("centres are always there");
            let column =
                |column: [f64; 4]| tensors::from_data_like(TrajectoryStatistics::table(column.to_vec(), 1), &like);
            let cache = of_columns(column([0.0; 4]), column([0.0, 3.0, 0.0, 0.0]));
            // Velocity 6, extent 2: a variance of 9 / 12, so the mean is 3.75 / 4.
            let stillness = values(cache.stillness(&gaussians, 2.0));
            let expected = [1.0, (-3.0f64 * 4.0 / 3.75).exp(), (-0.75f64 * 4.0 / 3.75).exp(), 0.25];
            for (found, expected) in stillness.iter().zip(expected) {
                assert!((found - expected).abs() < 1e-5, "{stillness:?}");
            }
        });
    }

    #[test]
    fn an_encoding_is_kept_until_the_signatures_change() {
        for_each_device(|device| {
            let column = Tensor::<2>::from_data([[1.0f32], [2.0], [3.0]], &device);
            let mut cache = of_columns(column.clone(), column);
            let encoded = |cache: &MotionCache, offset: f32| values(cache.encoded(|signatures| signatures + offset));
            let clone = cache.clone();
            assert_eq!(encoded(&clone, 10.0), [11.0, 12.0, 13.0]);
            assert_eq!(encoded(&cache, 20.0), [11.0, 12.0, 13.0]);
            cache.follow(&RowMap::keeping(vec![2, 0]));
            assert_eq!(encoded(&cache, 20.0), [23.0, 21.0]);
            let rows = Tensor::from_data([1i32], &device);
            assert_eq!(encoded(&cache.select(&rows), 30.0), [31.0]);
            assert_eq!(encoded(&clone, 40.0), [11.0, 12.0, 13.0]);
        });
    }
}
