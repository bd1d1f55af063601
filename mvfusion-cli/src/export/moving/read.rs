//! A `.4dgs` file, read back by the crate that wrote it.

use std::fmt;
use std::path::Path;

use anyhow::{Context, ensure};
use fourdgs::keyframe_delta::State;
use fourdgs::keyframe_delta_file::{
    IndexedSequence, Sample, compose_chain, open_indexed, read_delta_entry, read_keyframe_entry,
};
use fourdgs::opcode as op;
use fourdgs::quantization::{Steps, dequantize_rotation, life_class, motion_step, rct_inverse, support_k};
use fourdgs::{FileReadable, Readable};
use mvfusion_data::{GaussianCloud, logit, sigmoid};
use mvfusion_model::model::gaussians::SH_C0;

use super::sample::Samples;

/// Factor by which numbers may exceed half the spacing of their grid, because they are stored in single precision.
const ROUNDING: f64 = 1.001;

/// The kind of index entries whose sample is stored in full.
const KEYFRAME: u8 = 0;

/// An open file with an index.
pub struct MovingFile {
    source: FileReadable,
    sequence: IndexedSequence,
    steps: Steps,
}

/// The largest differences between a file and what was to be written.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct MaxErrors {
    /// Of a coordinate of a centre at the beginning and at the end of a sample, in world units.
    pub position: f64,
    /// Of the logarithm of a size.
    pub log_scale: f64,
    /// Of a part of a unit quaternion.
    pub rotation: f64,
    /// Of a colour channel.
    pub colour: f64,
    /// Of an opacity.
    pub opacity: f64,
}

impl MovingFile {
    /// Opens a file and checks its index.
    ///
    /// # Errors
    /// If it cannot be read or is not a whole file of the format.
    pub fn open(path: &Path) -> anyhow::Result<Self> {
        let read = || -> fourdgs::Result<(FileReadable, IndexedSequence)> {
            let mut source = FileReadable::open(path)?;
            let sequence = open_indexed(&mut source)?;
            Ok((source, sequence))
        };
        let (source, sequence) = read().with_context(|| format!("cannot read {}", path.display()))?;
        let steps = sequence.quantization.steps();
        Ok(Self { source, sequence, steps })
    }

    /// Bytes of the file.
    ///
    /// # Errors
    /// If the file is gone.
    pub fn bytes(&mut self) -> anyhow::Result<u64> {
        Ok(self.source.size()?)
    }

    /// The bounds of all errors that the grids promise.
    pub fn bounds(&self) -> MaxErrors {
        let Steps { pos, scale_log, rot, rgb, alpha, motion, .. } = self.steps;
        let [position, log_scale, rotation, colour, opacity] = [pos, scale_log, rot, rgb, alpha].map(|step| 0.5 * step);
        // Centres are stored in single precision before they are rounded to the grid.
        let reach = self.sequence.header.aabb.iter().fold(0.0, |reach: f64, bound| reach.max(bound.abs()));
        // Velocities have a grid, too: the finest one, because all Gaussians last.
        let velocity = 0.5 * motion_step(life_class(0, 0.0, true, f64::INFINITY, 1.0), motion);
        let longest = self.sequence.index.iter().map(|entry| entry.t1 - entry.t0).fold(0.0, f64::max);
        let position = position + velocity * longest + f64::from(f32::EPSILON) * reach;
        // The fourth part follows from the other three; all are normalised afterwards.
        MaxErrors { position, log_scale, rotation: 4.0 * rotation, colour, opacity }
    }

    /// The Gaussians at a second of the film, with constant colours.
    ///
    /// # Errors
    /// If the film is shorter, or the file is damaged.
    pub fn cloud_at(&mut self, second: f64) -> anyhow::Result<GaussianCloud> {
        let last = self.sequence.index.last().context("the file has no sample")?;
        // The end of the film belongs to its last sample.
        let found = self.sequence.index.iter().find(|entry| entry.t0 <= second && second < entry.t1);
        let entry = found.unwrap_or(last).clone();
        let IndexedSequence { index, quantization, windows, .. } = &self.sequence;
        let state = compose_chain(&mut self.source, index, &entry, quantization, windows)?;
        Ok(self.cloud(&state, second - entry.t0))
    }

    /// The Gaussians of a state, some seconds after its beginning.
    fn cloud(&self, state: &State, seconds: f64) -> GaussianCloud {
        let (steps, origin) = (&self.steps, &self.sequence.quantization.pos_origin);
        let bins = |attribute: u8| &state.bins[&attribute].values;
        let (position, scale, motion) = (bins(op::A_POSITION), bins(op::A_SCALE), bins(op::A_MOTION));
        let (largest, rotation) = (bins(op::A_ROTATION_INDEX), bins(op::A_ROTATION));
        let (colour, alpha) = (bins(op::A_COLOR), bins(op::A_OPACITY));
        let mut cloud = GaussianCloud::default();
        for index in 0..state.count() {
            let three = 3 * index..3 * index + 3;
            let velocity = velocity_step(steps, &self.sequence, state, index);
            cloud.means.push([0, 1, 2].map(|axis| {
                let place = position[3 * index + axis] as f64 * steps.pos + origin[axis];
                (place + motion[3 * index + axis] as f64 * velocity * seconds) as f32
            }));
            cloud.log_scales.push([0, 1, 2].map(|axis| (scale[3 * index + axis] as f64 * steps.scale_log) as f32));
            let [x, y, z, w] = dequantize_rotation(largest[index], &rotation[three.clone()], steps.rot);
            cloud.quaternions.push([w, x, y, z]);
            let level = |bin: i64| (bin as f64 * steps.rgb).clamp(0.0, 1.0);
            cloud.sh_dc.push(rct_inverse(&colour[three]).map(|bin| ((level(bin) - 0.5) / SH_C0) as f32));
            cloud.opacity_logits.push(logit((alpha[index] as f64 * steps.alpha).clamp(0.0, 1.0)));
        }
        cloud
    }

    /// Compares the whole file with what was to be written.
    ///
    /// # Errors
    /// If the file is damaged, has other samples or Gaussians, or deviates by more than its [bounds](Self::bounds).
    pub fn check(&mut self, samples: &Samples) -> anyhow::Result<MaxErrors> {
        let entries = self.sequence.index.clone();
        ensure!(entries.len() == samples.len(), "the file has {} samples, not {}", entries.len(), samples.len());
        let mut worst = MaxErrors::default();
        let mut before = State::default();
        for (entry, sample) in entries.iter().zip(&samples.samples) {
            let IndexedSequence { quantization, windows, .. } = &self.sequence;
            let state = match entry.kind {
                KEYFRAME => read_keyframe_entry(&mut self.source, entry, quantization, windows)?.0,
                _ => read_delta_entry(&mut self.source, entry, &before, windows)?.0,
            };
            ensure!(state.ids == sample.ids, "the file has other Gaussians at {} s", sample.t0);
            for seconds in [0.0, entry.t1 - entry.t0] {
                worst = worst.and(compare(&self.cloud(&state, seconds), sample, seconds));
            }
            before = state;
        }
        let bounds = self.bounds();
        ensure!(worst.is_within(&bounds), "the file deviates by {worst:?}, beyond its bounds {bounds:?}");
        Ok(worst)
    }
}

/// The velocity of one step of a Gaussian's grid, in world units a second. The grid depends on how long it lasts.
fn velocity_step(steps: &Steps, sequence: &IndexedSequence, state: &State, index: usize) -> f64 {
    let sigma = state.bins[&op::A_SIGMA_T].values[index];
    let (start, end) = sequence.windows.first().copied().unwrap_or_default();
    let class = life_class(sigma, steps.sigma_log, false, end - start, support_k(sequence.header.cutoff));
    motion_step(class, steps.motion)
}

/// The largest differences of a decoded sample, some seconds after its beginning.
fn compare(found: &GaussianCloud, wanted: &Sample, seconds: f64) -> MaxErrors {
    let wanted = &wanted.gaussians;
    let moved = |(&place, &velocity): (&f32, &f32)| (f64::from(place) + f64::from(velocity) * seconds) as f32;
    let moved: Vec<f32> = wanted.positions.iter().zip(&wanted.motions).map(moved).collect();
    let largest = |pairs: &mut dyn Iterator<Item = (f64, f64)>| pairs.map(|(a, b)| (a - b).abs()).fold(0.0, f64::max);
    let doubles = |found: &[f32], wanted: &[f32]| -> Vec<(f64, f64)> {
        found.iter().zip(wanted).map(|(&a, &b)| (f64::from(a), f64::from(b))).collect()
    };
    let logs: Vec<f32> = wanted.scales.iter().map(|scale| scale.ln()).collect();
    let rotations = found.quaternions.iter().zip(wanted.rotations.as_chunks::<4>().0).flat_map(|(found, wanted)| {
        let [w, x, y, z] = *found;
        let [found, wanted] = [[x, y, z, w], *wanted].map(|parts| parts.map(f64::from));
        // A quaternion and its negative are one rotation.
        let sign = found.iter().zip(wanted).map(|(a, b)| a * b).sum::<f64>().signum();
        [0, 1, 2, 3].map(|part| (found[part], sign * wanted[part]))
    });
    let opacities = found.opacity_logits.iter().zip(wanted.colors.as_chunks::<4>().0);
    let opacities = opacities.map(|(&logit, colour)| (sigmoid(logit), f64::from(colour[3])));
    let colours = found.sh_dc.iter().zip(wanted.colors.as_chunks::<4>().0).flat_map(|(dc, colour)| {
        [0, 1, 2].map(|channel| (0.5 + SH_C0 * f64::from(dc[channel]), f64::from(colour[channel])))
    });
    MaxErrors {
        position: largest(&mut doubles(found.means.as_flattened(), &moved).into_iter()),
        log_scale: largest(&mut doubles(found.log_scales.as_flattened(), &logs).into_iter()),
        rotation: largest(&mut { rotations }),
        colour: largest(&mut { colours }),
        opacity: largest(&mut { opacities }),
    }
}

impl MaxErrors {
    fn and(self, other: Self) -> Self {
        Self {
            position: self.position.max(other.position),
            log_scale: self.log_scale.max(other.log_scale),
            rotation: self.rotation.max(other.rotation),
            colour: self.colour.max(other.colour),
            opacity: self.opacity.max(other.opacity),
        }
    }

    /// Whether no deviation exceeds its bound, but for rounding.
    fn is_within(&self, bounds: &Self) -> bool {
        let values = |of: &Self| [of.position, of.log_scale, of.rotation, of.colour, of.opacity];
        // Rounding to single precision, relative to values around 1; the logits of opacities keep off 0 and 1 by 1e-6.
        const LEAST: f64 = 2e-6;
        values(self).into_iter().zip(values(bounds)).all(|(found, bound)| found <= bound * ROUNDING + LEAST)
    }
}

impl fmt::Display for MaxErrors {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self { position, log_scale, rotation, colour, opacity } = *self;
        let (percent, degrees) = (100.0 * log_scale.exp_m1(), (2.0 * rotation).to_degrees());
        write!(
            f,
            "{position:.2e} in centres, {percent:.2} % in sizes, {degrees:.2} degrees, {colour:.4} in colours, \
             {opacity:.4} in opacities"
        )
    }
}
