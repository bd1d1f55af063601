//! Fewer keyframes, colour coefficients and Gaussians, and larger steps.

use super::order::morton_order;
use super::quantity::BRIGHTNESS_KNEE;
use super::{Keyframes, Quantity, Track, UniformQuantizer};

/// What is left of keyframes.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Reduction {
    /// Steps are this many times as large, except those of opacities and masks. At least 1.
    pub step_factor: u32,
    /// Every how many-th keyframe is kept. At least 1. The last one always is.
    pub stride: usize,
    /// Degree of the spherical harmonics.
    pub sh_degree: usize,
}

impl Keyframes {
    /// These Gaussians alone, after a reduction. Neighbours in space become neighbours in the lists.
    ///
    /// Where a Gaussian cannot be seen, because it is transparent at a keyframe and at both neighbours, its other
    /// values repeat the ones before (or the first ones after). They cost next to nothing then.
    pub fn reduced(&self, rows: &[usize], reduction: Reduction) -> Self {
        let Reduction { step_factor, stride, sh_degree } = reduction;
        let last = self.times.len().saturating_sub(1);
        let chosen: Vec<usize> = (0..self.times.len()).filter(|k| k % stride.max(1) == 0 || *k == last).collect();
        let sh_degree = sh_degree.min(self.sh_degree);
        let rows = self.in_space(rows);
        let track = |track: &Track| {
            let keyframes: &[usize] = if track.quantity.moves() { &chosen } else { &[0] };
            let levels = |column: &Vec<i32>| -> Vec<i32> {
                let at = |k: &usize| &column[k * self.count..(k + 1) * self.count];
                keyframes.iter().flat_map(|k| rows.iter().map(|&row| at(k)[row])).collect()
            };
            let width = track.quantity.columns(sh_degree);
            let columns: Vec<Vec<i32>> = track.columns[..width].iter().map(levels).collect();
            let quantizer = track.coarser(step_factor, columns.iter().flatten().copied());
            let requantised = |level: i32| quantizer.quantise(track.quantizer.value(level));
            let columns = columns.into_iter().map(|column| column.into_iter().map(requantised).collect()).collect();
            Track { quantity: track.quantity, quantizer, columns }
        };
        let mut reduced = Self {
            count: rows.len(),
            sh_degree,
            times: chosen.iter().map(|&k| self.times[k]).collect(),
            tracks: self.tracks.iter().map(track).collect(),
        };
        reduced.hold_unseen();
        reduced
    }

    /// Rows along a curve through space, by their centres at the first keyframe.
    fn in_space(&self, rows: &[usize]) -> Vec<usize> {
        let Some(means) = self.track(Quantity::Mean) else { return rows.to_vec() };
        let centres: Vec<[i32; 3]> = rows.iter().map(|&row| [0, 1, 2].map(|axis| means.columns[axis][row])).collect();
        morton_order(&centres).into_iter().map(|place| rows[place]).collect()
    }

    /// Repeats values where they do not matter.
    fn hold_unseen(&mut self) {
        let (count, keyframes) = (self.count, self.times.len());
        let least = self.transparent();
        let opacities = self.column(Quantity::Opacity).to_vec();
        let is_opaque = |k: usize, row: usize| opacities[k * count + row] > least;
        let is_seen =
            |k: usize, row: usize| (k.saturating_sub(1)..=(k + 1).min(keyframes - 1)).any(|k| is_opaque(k, row));
        let held = |track: &&mut Track| track.quantity.moves() && track.quantity != Quantity::Opacity;
        for row in 0..count {
            let seen: Vec<bool> = (0..keyframes).map(|k| is_seen(k, row)).collect();
            let Some(first) = seen.iter().position(|&seen| seen) else { continue };
            for track in self.tracks.iter_mut().filter(held) {
                for column in &mut track.columns {
                    let mut value = column[first * count + row];
                    for (k, &seen) in seen.iter().enumerate() {
                        let own = &mut column[k * count + row];
                        if seen {
                            value = *own;
                        }
                        *own = value;
                    }
                }
            }
        }
    }
}

impl Track {
    /// The quantizer of these of its numbers with steps that are this many times as large, as far as they do little harm.
    /// A brightness that is nowhere above the knee has the steps of the other masks.
    fn coarser(&self, step_factor: u32, mut levels: impl Iterator<Item = i32>) -> UniformQuantizer {
        let coarser = self.quantizer.coarser(step_factor);
        let below_knee = UniformQuantizer::brightness_below_knee();
        match self.quantity {
            Quantity::Brightness if levels.all(|level| self.quantizer.value(level) <= BRIGHTNESS_KNEE) => below_knee,
            Quantity::Brightness => UniformQuantizer { step: coarser.step.min(below_knee.step), ..coarser },
            quantity if quantity.may_be_coarse() => coarser,
            _ => self.quantizer,
        }
    }
}

impl Keyframes {
    /// Adds to the constant colour coefficients of each Gaussian at a keyframe.
    pub fn shift_sh_dc(&mut self, keyframe: usize, shifts: &[[f32; 3]]) {
        let first = keyframe * self.count;
        for track in self.tracks.iter_mut().filter(|track| track.quantity == Quantity::ShDc) {
            let quantizer = track.quantizer;
            for (channel, column) in track.columns.iter_mut().enumerate() {
                for (level, shift) in column.iter_mut().skip(first).zip(shifts) {
                    *level = quantizer.quantise(quantizer.value(*level) + f64::from(shift[channel]));
                }
            }
        }
    }
}
