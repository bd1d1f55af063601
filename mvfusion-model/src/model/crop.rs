//! The part of a model that lies in a box.

use std::collections::BTreeSet;

use burn::tensor::{Int, Tensor};
use glam::{DQuat, DVec3, Vec3};
use thiserror::Error;

use super::gaussians::{Attribute, Gaussians};
use super::{DeformationLevel, Model, RenderContext};
use crate::timeline::spread;
use crate::{ModelError, tensors};

/// Most times at which the dynamic Gaussians are looked for, spread over the training times.
const MOST_TIMES: usize = 60;

/// Opacity logit of the Gaussian that stands for an empty branch. No offset of the deformation makes it visible.
const INVISIBLE: f32 = -1e3;

/// Share of the Gaussians that lie below the range that an error states, and above it.
const OUTLIERS: f64 = 0.05;

/// A box of any orientation, in world units.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct OrientedBox {
    /// Centre.
    pub centre: DVec3,
    /// Lengths of its edges.
    pub size: DVec3,
    /// Rotation from the box's axes to those of the world.
    pub rotation: DQuat,
}

/// The Gaussians of one branch that a crop keeps.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Kept {
    /// Name of the branch.
    pub branch: &'static str,
    /// Number of Gaussians in the box.
    pub kept: usize,
    /// Number of Gaussians of the branch.
    pub all: usize,
}

/// A model that was cut down to a box.
#[derive(Clone, Debug)]
pub struct Crop {
    /// The model, without autodiff. A branch without Gaussians in the box keeps an invisible one, because ops do not
    /// accept empty tensors.
    pub model: Model,
    /// What was kept of each branch, the dynamic one first.
    pub kept: Vec<Kept>,
}

/// The reason why a model cannot be cropped.
#[derive(Debug, Error)]
pub enum CropError {
    /// The box is empty.
    #[error(
        "no Gaussian lies in the box. On each axis, nine in ten of them lie between {} and {}",
        coordinates(.lower), coordinates(.upper)
    )]
    Empty {
        /// Lower ends of the ranges.
        lower: DVec3,
        /// Upper ends.
        upper: DVec3,
    },
    /// The model cannot be evaluated.
    #[error(transparent)]
    Model(#[from] ModelError),
}

impl OrientedBox {
    /// Whether a point lies in the box or on its surface.
    pub fn contains(&self, point: DVec3) -> bool {
        let from_centre = self.rotation.inverse() * (point - self.centre);
        (2.0 * from_centre.abs()).cmple(self.size).all()
    }
}

impl Model {
    /// The Gaussians whose centres lie in a box: for static ones always, for dynamic ones at a training time at which
    /// they are alive, at the given level of deformation. Each of them looks as in the whole model.
    ///
    /// Of more than 60 training times, 60 are taken, evenly spread.
    ///
    /// # Errors
    /// If no Gaussian lies in the box, or the device fails to return values.
    pub fn crop(
        &self,
        region: &OrientedBox,
        level: DeformationLevel,
        context: &RenderContext,
    ) -> Result<Crop, CropError> {
        let plain = self.plain();
        let dynamic = plain.dynamic_rows_in(region, level, context)?;
        let static_ = plain.static_.as_ref().map(|branch| rows_in(region, branch)).transpose()?;
        let counts = std::iter::once(dynamic.len()).chain(static_.as_ref().map(Vec::len));
        let branches = plain.branches().zip(counts);
        let kept: Vec<Kept> = branches.map(|((branch, all), kept)| Kept { branch, kept, all: all.count() }).collect();
        if kept.iter().all(|branch| branch.kept == 0) {
            let (lower, upper) = plain.range()?;
            return Err(CropError::Empty { lower, upper });
        }
        let static_ = plain.static_.as_ref().zip(static_).map(|(branch, rows)| part(branch, &rows));
        let rows = index(&plain.dynamic, &dynamic);
        let model = Self {
            dynamic: part(&plain.dynamic, &dynamic),
            static_,
            motion: plain.motion.map(|cache| cache.select(&rows)),
            substitutes: plain.substitutes.select(&rows),
            ..plain
        };
        Ok(Crop { model, kept })
    }

    /// Dynamic Gaussians that are in a box at a training time, ascending.
    fn dynamic_rows_in(
        &self,
        region: &OrientedBox,
        level: DeformationLevel,
        context: &RenderContext,
    ) -> Result<Vec<usize>, ModelError> {
        let times = context.timeline.times();
        let mut found = BTreeSet::new();
        for time in spread(times.len(), MOST_TIMES).into_iter().map(|index| times[index]) {
            let alive = self.dynamic.alive_at(time)?;
            let centres = centres(self.dynamic_at(time, level, context).means)?;
            found.extend((0..centres.len()).filter(|&row| alive[row] && region.contains(centres[row])));
        }
        Ok(found.into_iter().collect())
    }

    /// On each axis, the range of the canonical centres without outliers.
    fn range(&self) -> Result<(DVec3, DVec3), ModelError> {
        let mut all = Vec::new();
        for (_, branch) in self.branches() {
            all.extend(centres(branch.means.val())?);
        }
        let at = |share: f64| {
            let rank = (share * (all.len().max(1) - 1) as f64).round() as usize;
            let on = |axis: usize| {
                let mut values: Vec<f64> = all.iter().map(|centre| centre[axis]).collect();
                values.sort_by(f64::total_cmp);
                values.get(rank).copied().unwrap_or_default()
            };
            DVec3::new(on(0), on(1), on(2))
        };
        Ok((at(OUTLIERS), at(1.0 - OUTLIERS)))
    }
}

/// Static Gaussians in a box, ascending.
fn rows_in(region: &OrientedBox, branch: &Gaussians) -> Result<Vec<usize>, ModelError> {
    let centres = centres(branch.means.val())?;
    Ok((0..centres.len()).filter(|&row| region.contains(centres[row])).collect())
}

/// The given rows of a branch; of no rows, an invisible Gaussian.
fn part(branch: &Gaussians, rows: &[usize]) -> Gaussians {
    let index = index(branch, rows);
    let of = |attribute| {
        let values = branch.plain(attribute)?.select(0, index.clone());
        let is_hidden = rows.is_empty() && attribute == Attribute::OpacityLogits;
        Some(if is_hidden { values.full_like(INVISIBLE) } else { values })
    };
    // Proof: `plain` has each attribute that a branch needs.
    let gaussians = Gaussians::from_tensors(of).expect("all attributes");
    Gaussians { sh_degree: branch.sh_degree, ..gaussians }
}

/// The given rows; of no rows, the first one, which stands for them.
fn index(branch: &Gaussians, rows: &[usize]) -> Tensor<1, Int> {
    let first = [0];
    tensors::rows_like(if rows.is_empty() { &first } else { rows }, &branch.means.val())
}

/// Centres `[N, 3]` on the host.
fn centres(means: Tensor<2>) -> Result<Vec<DVec3>, ModelError> {
    let numbers: Vec<f32> = tensors::read(means)?;
    Ok(numbers.chunks_exact(3).map(|row| Vec3::from_slice(row).as_dvec3()).collect())
}

/// A point as an option takes it.
fn coordinates(point: &DVec3) -> String {
    format!("{:.3},{:.3},{:.3}", point.x, point.y, point.z)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_box_contains_what_lies_within_its_edges() {
        let region = OrientedBox { centre: DVec3::X, size: DVec3::new(2.0, 4.0, 1.0), rotation: DQuat::IDENTITY };
        for inside in [DVec3::X, DVec3::new(0.0, 2.0, -0.5)] {
            assert!(region.contains(inside), "{inside}");
        }
        for outside in [DVec3::new(-0.01, 0.0, 0.0), DVec3::new(1.0, 2.01, 0.0), DVec3::new(1.0, 0.0, f64::NAN)] {
            assert!(!region.contains(outside), "{outside}");
        }
    }

    #[test]
    fn a_rotated_box_is_long_along_its_own_axis() {
        let rotation = DQuat::from_rotation_z(30f64.to_radians());
        let region = OrientedBox { centre: DVec3::ZERO, size: DVec3::new(10.0, 0.1, 0.1), rotation };
        let along = DVec3::new(30f64.to_radians().cos(), 30f64.to_radians().sin(), 0.0);
        assert!(region.contains(4.9 * along) && !region.contains(5.1 * along));
        assert!(!region.contains(4.9 * DVec3::new(along.x, -along.y, 0.0)));
    }
}
