//! The samples of a `.4dgs` file.

use anyhow::{Context, ensure};
use fourdgs::keyframe_delta_file::{KeyframeDeltaOptions, Sample, write_sequence};
use fourdgs::model::GaussianSet;
use fourdgs::quantization::{Bounds, Profile, Steps};
use glam::DVec3;
use mvfusion_data::{GaussianCloud, sigmoid, unit_quaternion};
use mvfusion_model::ModelError;
use mvfusion_model::model::harmonics::mean_colours;

use super::clock::Clock;
use super::{KEYFRAME_EVERY, Precision};

/// Duration of a Gaussian in lengths of the film: so long that it does not fade by itself. The writer of the crate
/// takes no infinite ones.
const LASTING: f64 = 1000.0;

/// Maximum number of samples if none is asked for.
const MOST_SAMPLES: usize = 60;
/// Least length of a sample in steps of the grid of times, to which the crate rounds its beginning.
const LEAST_STEPS: f64 = 2.0;

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
    /// The number of samples of a film: the wanted one, or one for each frame, at most 60.
    ///
    /// # Errors
    /// If this many samples would be too short for the grid of times.
    pub fn count(wanted: Option<usize>, clock: Clock, precision: Precision) -> anyhow::Result<usize> {
        let count = wanted.unwrap_or(clock.frames().min(MOST_SAMPLES));
        let (duration, step) = (clock.duration(), steps(precision.profile(), 1.0).time);
        let most = ((duration / (LEAST_STEPS * step)) as usize).max(1);
        ensure!(
            count <= most,
            "--samples: a film of {duration:.2} s has room for {most} samples with this --precision, not for {count}. \
             Use fewer of them, or a finer precision."
        );
        Ok(count)
    }

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
            let segment = Segment { start, end, begin, next };
            samples.push(segment.sample(&middle, eyes, LASTING * clock.duration()));
            begin = segment.next;
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
        write_sequence(&self.samples, self.clock.duration(), &options).context("cannot encode the samples of the film")
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
struct Segment {
    /// First and last second.
    start: f64,
    end: f64,
    /// Centres then.
    begin: Vec<[f32; 3]>,
    next: Vec<[f32; 3]>,
}

impl Segment {
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
        let opacities = middle.opacity_logits.iter().map(|&logit| sigmoid(logit) as f32);
        let colours = mean_colours(middle, eyes);
        let colour = |(colour, opacity): ([f32; 3], f32)| {
            let [r, g, b] = colour.map(|level| level.clamp(0.0, 1.0));
            [r, g, b, opacity]
        };
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

#[cfg(test)]
mod tests {
    use mvfusion_model::timeline::Timeline;

    use super::*;
    use crate::export::moving::MovingFile;

    /// A film of 0.8 s.
    fn clock() -> Clock {
        Clock::of(&Timeline::new((0..24).map(|frame| f64::from(frame) / 24.0).collect()))
    }

    /// A Gaussian that moves along x, brighter than white.
    fn cloud(time: f64) -> GaussianCloud {
        GaussianCloud {
            means: vec![[time as f32, 0.0, 1.0]],
            sh_dc: vec![[3.0, 0.0, -9.0]],
            opacity_logits: vec![2.0],
            log_scales: vec![[-3.0; 3]],
            quaternions: vec![[1.0, 0.0, 0.0, 0.0]],
            ..GaussianCloud::default()
        }
    }

    #[test]
    fn as_many_samples_as_the_grid_of_times_resolves_can_be_written_and_more_are_refused() {
        for (precision, most) in [(Precision::Fine, 400), (Precision::Coarse, 25)] {
            assert_eq!(Samples::count(None, clock(), precision).expect("the default fits"), 24);
            let count = Samples::count(Some(most), clock(), precision).expect("the most that fit");
            let samples = Samples::take(count, clock(), precision, &[], |time| Ok(cloud(time))).expect("taken");
            assert!(!samples.encode().expect("encoded").is_empty());
            let error = Samples::count(Some(most + 1), clock(), precision).expect_err("too many").to_string();
            assert!(error.contains("--samples") && error.contains(&format!("room for {most} ")), "{error}");
        }
    }

    #[test]
    fn a_file_with_other_velocities_is_noticed() {
        let mut samples = Samples::take(2, clock(), Precision::Fine, &[], |time| Ok(cloud(time))).expect("taken");
        let folder = tempfile::tempdir().expect("folder");
        let path = folder.path().join("scene.4dgs");
        std::fs::write(&path, samples.encode().expect("encoded")).expect("written");
        let mut file = MovingFile::open(&path).expect("opened");
        file.check(&samples).expect("the file is what was to be written");
        // The places at the beginning are the same.
        samples.samples[1].gaussians.motions[0] += 0.1;
        let error = file.check(&samples).expect_err("noticed").to_string();
        assert!(error.contains("beyond its bounds"), "{error}");
    }

    #[test]
    fn colours_of_a_sample_are_between_black_and_white() {
        let samples = Samples::take(2, clock(), Precision::Fine, &[], |time| Ok(cloud(time))).expect("taken");
        assert_eq!(samples.samples[0].gaussians.colors[..3], [1.0, 0.5, 0.0]);
    }
}
