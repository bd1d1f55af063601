//! The samples of a `.4dgs` file.

use fourdgs::keyframe_delta_file::{KeyframeDeltaOptions, Sample, write_sequence};
use fourdgs::model::GaussianSet;
use fourdgs::quantization::{Bounds, Profile, Steps};
use glam::DVec3;
use mvfusion_data::GaussianCloud;
use mvfusion_model::ModelError;
use mvfusion_model::model::harmonics::mean_colours;

use super::clock::Clock;
use super::{KEYFRAME_EVERY, Precision};
use crate::export::activated::{opacity, unit_quaternion};

/// Duration of a Gaussian in lengths of the film: so long that it does not fade by itself. The writer of the crate
/// takes no infinite ones.
const LASTING: f64 = 1000.0;

/// Least size of a Gaussian; the crate takes smaller ones for this one.
const LEAST_SCALE: f32 = 1e-30;

/// A scene, sampled in time, ready to be written.
#[derive(Clone, Debug)]
pub struct Samples {
    /// The samples, by their beginnings.
    pub(super) samples: Vec<Sample>,
    clock: Clock,
    precision: Precision,
}

impl Samples {
    /// Takes `count` samples of equal length. `cloud_at` has the Gaussians at a time of the model, always the same
    /// number in the same order. Colours are the means of those that are seen from `eyes`. Gaussians whose opacity is
    /// rounded to zero in every sample are left out.
    ///
    /// # Errors
    /// If the Gaussians cannot be had.
    pub fn take(
        count: usize,
        clock: Clock,
        precision: Precision,
        eyes: &[DVec3],
        mut cloud_at: impl FnMut(f64) -> Result<GaussianCloud, ModelError>,
    ) -> Result<Self, ModelError> {
        // The crate rounds the moments of samples to this grid.
        let step = steps(precision.profile(), 1.0).time;
        let ends = clock.ends(count, step);
        let mut begin = cloud_at(clock.time(ends[0]))?.means;
        let mut samples = Vec::with_capacity(count);
        for pair in ends.windows(2) {
            let (start, end) = (pair[0], pair[1]);
            let middle = cloud_at(clock.time(0.5 * (start + end)))?;
            let next = cloud_at(clock.time(end))?.means;
            let path = Path { start, end, begin, next };
            samples.push(path.sample(&middle, eyes, LASTING * clock.duration()));
            begin = path.next;
        }
        let mut samples = Self { samples, clock, precision };
        samples.drop_unseen();
        Ok(samples)
    }

    /// Number of Gaussians.
    pub fn gaussians(&self) -> usize {
        self.samples.first().map_or(0, |sample| sample.ids.len())
    }

    /// Number of samples.
    pub fn len(&self) -> usize {
        self.samples.len()
    }

    /// Whether there is no sample.
    pub fn is_empty(&self) -> bool {
        self.samples.is_empty()
    }

    /// The bytes of the file.
    ///
    /// # Errors
    /// If the crate refuses the samples.
    pub fn encode(&self) -> anyhow::Result<Vec<u8>> {
        let options = KeyframeDeltaOptions {
            keyframe_every: KEYFRAME_EVERY,
            profile: self.precision.profile(),
            library: concat!("mvfusion ", env!("CARGO_PKG_VERSION")).to_owned(),
            ..KeyframeDeltaOptions::default()
        };
        Ok(write_sequence(&self.samples, self.clock.duration(), &options)?)
    }

    /// Leaves out the Gaussians that no sample shows, as far as its grid resolves.
    fn drop_unseen(&mut self) {
        let least = 0.5 * steps(self.precision.profile(), 1.0).alpha;
        let is_seen =
            |index: usize| self.samples.iter().any(|sample| f64::from(sample.gaussians.colors[4 * index + 3]) > least);
        let seen: Vec<usize> = (0..self.gaussians()).filter(|&index| is_seen(index)).collect();
        for sample in &mut self.samples {
            let old = std::mem::take(&mut sample.gaussians);
            sample.ids = seen.iter().map(|&index| sample.ids[index]).collect();
            sample.gaussians = GaussianSet {
                positions: rows(&old.positions, 3, &seen),
                scales: rows(&old.scales, 3, &seen),
                rotations: rows(&old.rotations, 4, &seen),
                colors: rows(&old.colors, 4, &seen),
                motions: rows(&old.motions, 3, &seen),
                mu_t: rows(&old.mu_t, 1, &seen),
                sigma_t: rows(&old.sigma_t, 1, &seen),
                ..GaussianSet::default()
            };
        }
    }
}

/// The grids of a profile for Gaussians of this median size.
fn steps(profile: Profile, median_scale: f64) -> Steps {
    Steps::of(&Bounds::for_profile(profile, median_scale))
}

fn rows(values: &[f32], width: usize, chosen: &[usize]) -> Vec<f32> {
    chosen.iter().flat_map(|&row| &values[width * row..width * (row + 1)]).copied().collect()
}

/// Where all Gaussians are at the ends of a sample.
struct Path {
    /// First and last second.
    start: f64,
    end: f64,
    /// Centres then.
    begin: Vec<[f32; 3]>,
    next: Vec<[f32; 3]>,
}

impl Path {
    /// The sample in which Gaussians are as in the middle, and move at the mean velocity between the ends.
    fn sample(&self, middle: &GaussianCloud, eyes: &[DVec3], lasting: f64) -> Sample {
        let seconds = (self.end - self.start) as f32;
        let velocities: Vec<[f32; 3]> = self
            .begin
            .iter()
            .zip(&self.next)
            .map(|(begin, next)| [0, 1, 2].map(|axis| (next[axis] - begin[axis]) / seconds))
            .collect();
        // Through the place in the middle, where everything else is right as well; on a bend, the chord would miss it.
        let place = |(middle, velocity): (&[f32; 3], &[f32; 3])| {
            [0, 1, 2].map(|axis| middle[axis] - 0.5 * seconds * velocity[axis])
        };
        let rotation = |&quaternion: &[f32; 4]| {
            let [w, x, y, z] = unit_quaternion(quaternion);
            [x, y, z, w].map(|part| part as f32)
        };
        let opacities = middle.opacity_logits.iter().map(|&logit| opacity(logit) as f32);
        let colours = mean_colours(middle, eyes);
        let colour = |([r, g, b], opacity): ([f32; 3], f32)| [r, g, b, opacity];
        let count = middle.len();
        Sample {
            t0: self.start,
            ids: (0..count as i64).collect(),
            gaussians: GaussianSet {
                positions: middle.means.iter().zip(&velocities).flat_map(place).collect(),
                scales: middle
                    .log_scales
                    .iter()
                    .flat_map(|scales| scales.map(|log| log.exp().max(LEAST_SCALE)))
                    .collect(),
                rotations: middle.quaternions.iter().flat_map(rotation).collect(),
                colors: colours.into_iter().zip(opacities).flat_map(colour).collect(),
                motions: velocities.into_flattened(),
                mu_t: vec![self.start as f32; count],
                sigma_t: vec![lasting as f32; count],
                // Without windows, all Gaussians exist for the whole film.
                ..GaussianSet::default()
            },
        }
    }
}
