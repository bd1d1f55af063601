//! The Gaussians between two keyframes. The player of exported pages computes the same.

use super::{Keyframes, Quantity, Track};
use crate::{GaussianCloud, logit, rest_width};

/// A time between two keyframes.
#[derive(Clone, Copy, Debug, PartialEq)]
struct Bracket {
    before: usize,
    after: usize,
    /// Weight of the later one.
    weight: f64,
}

impl Keyframes {
    /// The Gaussians at a time. Before the first keyframe and after the last, they stand still.
    pub fn at(&self, time: f64) -> GaussianCloud {
        let bracket = self.bracket(time);
        let opacities = self.rows(Quantity::Opacity, bracket).unwrap_or_default();
        let masks = self.rows(Quantity::Mask, bracket).zip(self.rows(Quantity::Brightness, bracket));
        let logits = |([static_, dynamic], [brightness]): ([f32; 2], [f32; 1])| {
            [static_, brightness, dynamic].map(|share| logit(share.into()))
        };
        let sh_rest = self.track(Quantity::ShRest);
        let width = rest_width(self.sh_degree);
        let coefficient = |index: usize| {
            sh_rest.map_or(0.0, |track| track.quantizer.value(track.columns[index % width][index / width]) as f32)
        };
        GaussianCloud {
            sh_degree: self.sh_degree,
            means: self.rows(Quantity::Mean, bracket).unwrap_or_default(),
            sh_dc: self.rows(Quantity::ShDc, bracket).unwrap_or_default(),
            sh_rest: (0..self.count * width).map(coefficient).collect(),
            opacity_logits: opacities.into_iter().map(|[opacity]: [f32; 1]| logit(opacity.into())).collect(),
            log_scales: self.rows(Quantity::LogScale, bracket).unwrap_or_default(),
            quaternions: self.rotations(bracket),
            mask_logits: masks.map(|(masks, lights)| masks.into_iter().zip(lights).map(logits).collect()),
            lifetimes: None,
        }
    }

    fn bracket(&self, time: f64) -> Bracket {
        let after = self.times.partition_point(|&t| t <= time);
        let last = self.times.len().saturating_sub(1);
        match (after.checked_sub(1), self.times.get(after)) {
            (Some(before), Some(&next)) => {
                let start = self.times[before];
                Bracket { before, after, weight: (time - start) / (next - start) }
            }
            (None, _) => Bracket { before: 0, after: 0, weight: 0.0 },
            (Some(_), None) => Bracket { before: last, after: last, weight: 0.0 },
        }
    }

    /// The values of a quantity at a bracket, if the branch has it.
    fn rows<const N: usize>(&self, quantity: Quantity, bracket: Bracket) -> Option<Vec<[f32; N]>> {
        let track = self.track(quantity)?;
        let row = |row: usize| std::array::from_fn(|column| self.mixed(track, column, row, bracket) as f32);
        Some((0..self.count).map(row).collect())
    }

    fn rotations(&self, bracket: Bracket) -> Vec<[f32; 4]> {
        let rows: Vec<[f32; 4]> = self.rows(Quantity::Rotation, bracket).unwrap_or_default();
        let is_rotation = |row: &[f32; 4]| row.iter().any(|part| part.abs() > 1e-3);
        // The mean of opposite quaternions is no rotation.
        rows.into_iter().map(|row| if is_rotation(&row) { row } else { [1.0, 0.0, 0.0, 0.0] }).collect()
    }

    fn mixed(&self, track: &Track, column: usize, row: usize, bracket: Bracket) -> f64 {
        let value = |k: usize| track.quantizer.value(track.columns[column][k * self.count + row]);
        (1.0 - bracket.weight) * value(bracket.before) + bracket.weight * value(bracket.after)
    }
}
