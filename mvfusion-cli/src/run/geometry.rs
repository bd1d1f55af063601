//! The cameras, times and points of a scene in a few numbers, by which a run notices that they were changed.

use glam::DVec3;
use mvfusion_data::{Camera, Scene, View};
use serde::{Deserialize, Serialize};

/// Largest difference of two numbers of the same scene, relative to their size. Another processor may round a camera's
/// numbers otherwise, so they are compared instead of hashed.
const TOLERANCE: f64 = 1e-6;

/// Means over the training views and the points of a scene. A view's weight grows with its place, from 1 to 2, so that an
/// exchange of views shows as well.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct SceneGeometry {
    /// Centres of the cameras, and their root mean square.
    pub centres: [f64; 4],
    /// Axes of the cameras in the world: right, down, forward.
    pub axes: [f64; 9],
    /// Focal lengths and principal points along both sides, in widths and heights of the image.
    pub lenses: [f64; 4],
    /// Times, and their mean square.
    pub times: [f64; 2],
    /// Initial points, and their root mean square.
    pub points: [f64; 4],
}

impl SceneGeometry {
    /// That of a scene.
    pub fn of(scene: &Scene) -> Self {
        let views = &scene.train;
        let centres = views.iter().map(|view| with_square(view.camera.centre()));
        let points = scene.points.positions.iter().map(|&position| with_square(position.as_dvec3()));
        Self {
            centres: root_of_last(mean(centres)),
            axes: mean(views.iter().map(|view| view.camera.rotation.transpose().to_cols_array())),
            lenses: mean(views.iter().map(lens)),
            times: mean(views.iter().map(|view| [view.time, view.time * view.time])),
            points: root_of_last(mean(points)),
        }
    }

    /// In what another scene differs from this one; `None` if it does not.
    pub fn difference(&self, other: &Self) -> Option<&'static str> {
        // A mean of directions may be zero, and so may a time; lengths have no such scale.
        let parts: [(&'static str, &[f64], &[f64], f64); 5] = [
            ("the camera positions", &self.centres, &other.centres, 0.0),
            ("the camera rotations", &self.axes, &other.axes, 1.0),
            ("the focal lengths or principal points", &self.lenses, &other.lenses, 0.0),
            ("the times", &self.times, &other.times, 1.0),
            ("the initial points", &self.points, &other.points, 0.0),
        ];
        let agrees = |own: &[f64], other: &[f64], least: f64| {
            let norm = |values: &mut dyn Iterator<Item = f64>| values.map(|value| value * value).sum::<f64>().sqrt();
            let apart = norm(&mut own.iter().zip(other).map(|(own, other)| own - other));
            let size = norm(&mut own.iter().copied()).max(norm(&mut other.iter().copied())).max(least);
            // NaN does not agree.
            apart <= TOLERANCE * size
        };
        parts.into_iter().find(|(_, own, other, least)| !agrees(own, other, *least)).map(|(name, ..)| name)
    }
}

fn lens(view: &View) -> [f64; 4] {
    let Camera { width, height, fx, fy, cx, cy, .. } = view.camera;
    let [width, height] = [width as f64, height as f64];
    [fx / width, fy / height, cx / width, cy / height]
}

fn with_square(place: DVec3) -> [f64; 4] {
    [place.x, place.y, place.z, place.length_squared()]
}

fn root_of_last<const N: usize>(mut values: [f64; N]) -> [f64; N] {
    values[N - 1] = values[N - 1].sqrt();
    values
}

/// The weighted mean of each number; zeros without rows.
fn mean<const N: usize>(rows: impl ExactSizeIterator<Item = [f64; N]>) -> [f64; N] {
    let count = rows.len().max(1) as f64;
    let mut sums = [0.0; N];
    let mut total = 0.0;
    for (place, row) in rows.enumerate() {
        let weight = 1.0 + place as f64 / count;
        total += weight;
        for (sum, value) in sums.iter_mut().zip(row) {
            *sum += weight * value;
        }
    }
    sums.map(|sum| if total > 0.0 { sum / total } else { 0.0 })
}

#[cfg(test)]
mod tests {
    use glam::{DMat3, Vec3};
    use mvfusion_data::{BuiltinOptions, builtin};

    use super::*;

    #[test]
    fn a_scene_is_known_again_and_each_change_is_named() {
        let scene = builtin::builtin(&BuiltinOptions { width: 16, height: 16, frames: 2, ..Default::default() });
        let own = SceneGeometry::of(&scene);
        let difference = |change: &dyn Fn(&mut Scene)| {
            let mut other = scene.clone();
            change(&mut other);
            own.difference(&SceneGeometry::of(&other))
        };
        assert_eq!(difference(&|_| ()), None);
        assert_eq!(difference(&|scene| scene.train[0].camera.cx += 1e-9), None, "rounding");
        assert_eq!(difference(&|scene| scene.train.swap(0, 1)), Some("the times"));
        let last = scene.train.len() - 1;
        assert_eq!(difference(&|scene| scene.train.swap(0, last)), Some("the camera positions"));
        let moved = |scene: &mut Scene| scene.train[0].camera.translation += DVec3::splat(0.1);
        assert_eq!(difference(&moved), Some("the camera positions"));
        // About the camera's own centre.
        let turned = |scene: &mut Scene| {
            for view in &mut scene.train {
                let turn = DMat3::from_rotation_z(0.1);
                (view.camera.rotation, view.camera.translation) =
                    (turn * view.camera.rotation, turn * view.camera.translation);
            }
        };
        assert_eq!(difference(&turned), Some("the camera rotations"));
        let shifted = |scene: &mut Scene| scene.train[0].camera.cx += 1.0;
        assert_eq!(difference(&shifted), Some("the focal lengths or principal points"));
        assert_eq!(difference(&|scene| scene.points.positions[0] += Vec3::X), Some("the initial points"));
        // Neither other held-out views nor another size of the images are another training.
        assert_eq!(difference(&|scene| scene.test[0].camera.translation += DVec3::ONE), None);
        let larger = |scene: &mut Scene| {
            for view in &mut scene.train {
                view.camera = view.camera.resized(32, 32);
            }
        };
        assert_eq!(difference(&larger), None);
    }

    #[test]
    fn a_scene_without_points_is_known_again() {
        let mut scene = builtin::builtin(&BuiltinOptions { width: 16, height: 16, frames: 1, ..Default::default() });
        scene.points = Default::default();
        let own = SceneGeometry::of(&scene);
        let text = serde_json::to_string(&own).expect("finite");
        assert_eq!(own.difference(&serde_json::from_str(&text).expect("read")), None);
    }
}
