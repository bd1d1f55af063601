//! The Gaussians between two keyframes. The player of exported pages computes the same.

use super::{Keyframes, Quantity, Track};
use crate::{GaussianCloud, rest_width};

/// Logit of an opacity or probability of 0 or 1: it differs by 2e-9.
const FARTHEST_LOGIT: f64 = 20.0;

/// A time between two keyframes.
#[derive(Clone, Copy, Debug, PartialEq)]
struct Moment {
    before: usize,
    after: usize,
    /// Weight of the later one.
    weight: f64,
}

impl Keyframes {
    /// The Gaussians at a time. Before the first keyframe and after the last, they stand still.
    pub fn at(&self, time: f64) -> GaussianCloud {
        let moment = self.moment(time);
        let opacities = self.rows(Quantity::Opacity, moment).unwrap_or_default();
        let masks = self.rows(Quantity::Mask, moment);
        let rest = self.track(Quantity::Rest);
        let width = rest_width(self.sh_degree);
        let coefficient = |index: usize| {
            rest.map_or(0.0, |track| track.grid.value(track.columns[index % width][index / width]) as f32)
        };
        GaussianCloud {
            sh_degree: self.sh_degree,
            means: self.rows(Quantity::Mean, moment).unwrap_or_default(),
            sh_dc: self.rows(Quantity::Base, moment).unwrap_or_default(),
            sh_rest: (0..self.count * width).map(coefficient).collect(),
            opacity_logits: opacities.into_iter().map(|[opacity]| logit(opacity)).collect(),
            log_scales: self.rows(Quantity::LogScale, moment).unwrap_or_default(),
            quaternions: self.rotations(moment),
            mask_logits: masks.map(|masks| masks.into_iter().map(|row| row.map(logit)).collect()),
            lifetimes: None,
        }
    }

    fn moment(&self, time: f64) -> Moment {
        let after = self.times.partition_point(|&t| t <= time);
        let last = self.times.len().saturating_sub(1);
        match (after.checked_sub(1), self.times.get(after)) {
            (Some(before), Some(&next)) => {
                let start = self.times[before];
                Moment { before, after, weight: (time - start) / (next - start) }
            }
            (None, _) => Moment { before: 0, after: 0, weight: 0.0 },
            (Some(_), None) => Moment { before: last, after: last, weight: 0.0 },
        }
    }

    /// The values of a quantity at a moment, if the branch has it.
    fn rows<const N: usize>(&self, quantity: Quantity, moment: Moment) -> Option<Vec<[f32; N]>> {
        let track = self.track(quantity)?;
        let row = |row: usize| std::array::from_fn(|column| self.mixed(track, column, row, moment) as f32);
        Some((0..self.count).map(row).collect())
    }

    fn rotations(&self, moment: Moment) -> Vec<[f32; 4]> {
        let rows: Vec<[f32; 4]> = self.rows(Quantity::Rotation, moment).unwrap_or_default();
        let is_rotation = |row: &[f32; 4]| row.iter().any(|part| part.abs() > 1e-3);
        // The mean of opposite quaternions is no rotation.
        rows.into_iter().map(|row| if is_rotation(&row) { row } else { [1.0, 0.0, 0.0, 0.0] }).collect()
    }

    fn mixed(&self, track: &Track, column: usize, row: usize, moment: Moment) -> f64 {
        let value = |k: usize| track.grid.value(track.columns[column][k * self.count + row]);
        (1.0 - moment.weight) * value(moment.before) + moment.weight * value(moment.after)
    }
}

/// The inverse of the logistic function, bounded.
fn logit(probability: f32) -> f32 {
    let probability = f64::from(probability).clamp(0.0, 1.0);
    (probability / (1.0 - probability)).ln().clamp(-FARTHEST_LOGIT, FARTHEST_LOGIT) as f32
}
