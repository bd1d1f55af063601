//! A coloured point cloud: the initial positions of the Gaussians.

use glam::{DVec3, Vec3};

/// Points with colours, as structure from motion produces them.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct PointCloud {
    /// Positions in world units.
    pub positions: Vec<Vec3>,
    /// RGB in `[0, 1]` as in the images (8-bit value / 255, METHOD §3), one for each position.
    pub colours: Vec<Vec3>,
}

impl PointCloud {
    /// Number of points.
    pub fn len(&self) -> usize {
        self.positions.len()
    }

    /// Whether there is no point.
    pub fn is_empty(&self) -> bool {
        self.positions.is_empty()
    }

    /// Smallest and largest coordinate along each axis, or `None` for an empty cloud.
    pub fn bounds(&self) -> Option<(Vec3, Vec3)> {
        let first = *self.positions.first()?;
        Some(self.positions.iter().fold((first, first), |(lo, hi), &p| (lo.min(p), hi.max(p))))
    }

    /// Appends a point.
    pub fn push(&mut self, position: Vec3, colour: Vec3) {
        self.positions.push(position);
        self.colours.push(colour);
    }

    /// Appends all points of `other`.
    pub fn extend(&mut self, other: &PointCloud) {
        self.positions.extend_from_slice(&other.positions);
        self.colours.extend_from_slice(&other.colours);
    }

    /// Largest distance of a point from `centre`.
    pub fn reach(&self, centre: DVec3) -> f64 {
        self.positions.iter().map(|p| p.as_dvec3().distance(centre)).fold(0.0, f64::max)
    }
}
