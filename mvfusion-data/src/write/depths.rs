//! Depth bounds of cameras, which some layouts store.

use crate::scene::{Camera, PointCloud, Scene, View};

/// Fractions of the visible points nearer, and farther, than the bounds (LLFF's percentiles 0.1 and 99.9).
const STRAYS: f64 = 0.001;

/// The far bound if nothing is known: DeGauss' far plane (METHOD §5.0).
const FAR: f64 = 100.0;

/// Depths along the camera's axis, world units.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Depths {
    /// Lower bound; 0 if unknown.
    pub(super) near: f64,
    pub(super) far: f64,
}

impl Depths {
    /// The bounds of views: from their ground-truth depths if there are any, else from the visible points, as in LLFF.
    /// The near bound of the scene wins.
    pub(super) fn of(scene: &Scene, views: &[&View]) -> Self {
        let known = Self::true_of(views).or_else(|| Self::of_points(&scene.points, &views.first()?.camera));
        let known = known.unwrap_or(Self { near: 0.0, far: FAR });
        let near = scene.near.unwrap_or(known.near);
        // Bounds must not cross. A scene's near bound may come from another capture than its points.
        Self { near, far: known.far.max(2.0 * near) }
    }

    /// The bounds that contain all of these.
    pub(super) fn around(all: impl IntoIterator<Item = Self>) -> Option<Self> {
        all.into_iter().reduce(|a, b| Self { near: a.near.min(b.near), far: a.far.max(b.far) })
    }

    fn true_of(views: &[&View]) -> Option<Self> {
        let depths = views.iter().filter_map(|view| view.truth.depth.as_deref()).flatten();
        let seen = depths.map(|&d| f64::from(d)).filter(|d| d.is_finite() && *d > 0.0);
        Self::around(seen.map(|depth| Self { near: depth, far: depth }))
    }

    fn of_points(points: &PointCloud, camera: &Camera) -> Option<Self> {
        let (width, height) = (camera.width as f64, camera.height as f64);
        let depth = |point: glam::DVec3| {
            let pixel = camera.project(point)?;
            let seen = (0.0..width).contains(&pixel.x) && (0.0..height).contains(&pixel.y);
            seen.then(|| camera.to_camera(point).z)
        };
        let mut depths: Vec<f64> = points.positions.iter().filter_map(|p| depth(p.as_dvec3())).collect();
        depths.sort_by(f64::total_cmp);
        let strays = (STRAYS * depths.len() as f64) as usize;
        Some(Self { near: *depths.get(strays)?, far: *depths.get(depths.len() - 1 - strays)? })
    }
}
