//! Poses in one world compared with the same poses in another: a similarity aligns them.

use std::collections::BTreeMap;

use glam::{DMat3, DQuat, DVec3};
use mvfusion_data::Camera;

/// A map from one world to another that keeps angles.
#[derive(Clone, Copy, Debug)]
pub struct Similarity {
    scale: f64,
    rotation: DMat3,
    translation: DVec3,
}

/// Steps of the power iteration. A step costs nothing.
const STEPS: usize = 20_000;

impl Similarity {
    /// The similarity with the least sum of squared distances between the images of `from` and `to` (Umeyama 1991). The
    /// rotation is Horn's (1987): the quaternion that is the eigenvector of a symmetric 4x4 matrix.
    pub fn between(from: &[DVec3], to: &[DVec3]) -> Self {
        assert_eq!(from.len(), to.len(), "points in pairs");
        let mean = |points: &[DVec3]| points.iter().sum::<DVec3>() / points.len().max(1) as f64;
        let (start, end) = (mean(from), mean(to));
        let pairs = || from.iter().zip(to).map(|(a, b)| (*a - start, *b - end));
        // The sum of outer products: entry (i, j) is that of component i of the first and j of the second.
        let sum = |i: usize, j: usize| pairs().map(|(a, b)| a[i] * b[j]).sum::<f64>();
        let s = |i: usize, j: usize| sum(i, j);
        let matrix = [
            [s(0, 0) + s(1, 1) + s(2, 2), s(1, 2) - s(2, 1), s(2, 0) - s(0, 2), s(0, 1) - s(1, 0)],
            [s(1, 2) - s(2, 1), s(0, 0) - s(1, 1) - s(2, 2), s(0, 1) + s(1, 0), s(2, 0) + s(0, 2)],
            [s(2, 0) - s(0, 2), s(0, 1) + s(1, 0), s(1, 1) - s(0, 0) - s(2, 2), s(1, 2) + s(2, 1)],
            [s(0, 1) - s(1, 0), s(2, 0) + s(0, 2), s(1, 2) + s(2, 1), s(2, 2) - s(0, 0) - s(1, 1)],
        ];
        let [w, x, y, z] = largest_eigenvector(matrix);
        let rotation = DMat3::from_quat(DQuat::from_xyzw(x, y, z, w).normalize());
        let along: f64 = pairs().map(|(a, b)| (rotation * a).dot(b)).sum();
        let scale = along / pairs().map(|(a, _)| a.length_squared()).sum::<f64>();
        Self { scale, rotation, translation: end - scale * (rotation * start) }
    }

    /// The image of a point.
    pub fn apply(&self, point: DVec3) -> DVec3 {
        self.scale * (self.rotation * point) + self.translation
    }
}

/// The eigenvector of the largest eigenvalue of a symmetric matrix, by power iteration.
fn largest_eigenvector(matrix: [[f64; 4]; 4]) -> [f64; 4] {
    // Shifted by its norm, the matrix has no negative eigenvalue, and the largest one stays the largest.
    let shift = matrix.iter().flatten().map(|v| v * v).sum::<f64>().sqrt();
    // No axis: it would stay in its own space.
    let mut vector = [0.5, 0.4, 0.6, 0.3];
    for _ in 0..STEPS {
        let image: [f64; 4] =
            std::array::from_fn(|i| shift * vector[i] + (0..4).map(|j| matrix[i][j] * vector[j]).sum::<f64>());
        let norm = image.iter().map(|v| v * v).sum::<f64>().sqrt();
        vector = image.map(|v| v / norm);
    }
    vector
}

/// How far poses are from known ones after an alignment of both.
///
/// Centres alone would leave open how a rig that stands on a line is turned around that line: what is aligned is each
/// centre and the tips of its camera's axes.
#[derive(Clone, Debug)]
pub struct PoseErrors {
    /// The errors of each camera, by name.
    pub cameras: BTreeMap<String, PoseError>,
}

/// How far a camera is from where it is known to be.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct PoseError {
    /// Angle between found and known rotation, in degrees.
    pub degrees: f64,
    /// Distance between found and known centre, as a share of the largest distance of two known centres.
    pub share: f64,
}

impl PoseErrors {
    /// Compares cameras by name. Names that only one side has do not count. `axis` is the length of a camera's axes, in
    /// quadratic means of the distances of the centres from their mean. The longer it is, the more the alignment takes
    /// over of what centres and rotations are turned against each other: 0.1 takes over a hundredth for a ring.
    pub fn of(found: &BTreeMap<String, Camera>, known: &BTreeMap<String, Camera>, axis: f64) -> Self {
        let pairs: BTreeMap<&String, (&Camera, &Camera)> =
            found.iter().filter_map(|(name, camera)| Some((name, (camera, known.get(name)?)))).collect();
        let (found, known): (Vec<&Camera>, Vec<&Camera>) = pairs.values().copied().unzip();
        let alignment = Similarity::between(&tripods(&found, axis), &tripods(&known, axis));
        let centres: Vec<DVec3> = known.iter().map(|camera| camera.centre()).collect();
        let extent = centres.iter().flat_map(|a| centres.iter().map(move |b| a.distance(*b))).fold(0.0, f64::max);
        let error = |found: &Camera, known: &Camera| {
            let turn = found.rotation * alignment.rotation.transpose() * known.rotation.transpose();
            let turn = DQuat::from_mat3(&turn);
            PoseError {
                degrees: 2.0 * turn.xyz().length().atan2(turn.w.abs()).to_degrees(),
                share: alignment.apply(found.centre()).distance(known.centre()) / extent,
            }
        };
        Self { cameras: pairs.into_iter().map(|(name, (found, known))| (name.clone(), error(found, known))).collect() }
    }

    /// Number of cameras whose errors are both below these.
    pub fn below(&self, limit: PoseError) -> usize {
        self.cameras.values().filter(|error| error.degrees < limit.degrees && error.share < limit.share).count()
    }

    /// Median and largest errors, for people.
    pub fn describe(&self) -> String {
        let of = |value: fn(&PoseError) -> f64| {
            let mut values: Vec<f64> = self.cameras.values().map(value).collect();
            values.sort_by(f64::total_cmp);
            [values.get(values.len() / 2), values.last()].map(|value| value.copied().unwrap_or(f64::NAN))
        };
        let ([degree, degrees], [share, shares]) = (of(|error| error.degrees), of(|error| error.share));
        format!(
            "{} cameras: rotations {degree:.3}° in the median, {degrees:.3}° at most; centres {:.3} % of the extent, \
             {:.3} % at most",
            self.cameras.len(),
            100.0 * share,
            100.0 * shares
        )
    }
}

/// Each camera's centre and the tips of its axes.
fn tripods(cameras: &[&Camera], axis: f64) -> Vec<DVec3> {
    let count = cameras.len().max(1) as f64;
    let mean = cameras.iter().map(|camera| camera.centre()).sum::<DVec3>() / count;
    let length = axis * (cameras.iter().map(|c| c.centre().distance_squared(mean)).sum::<f64>() / count).sqrt();
    let points = |camera: &&Camera| {
        let (centre, axes) = (camera.centre(), camera.rotation.transpose());
        [centre, centre + length * axes.x_axis, centre + length * axes.y_axis, centre + length * axes.z_axis]
    };
    cameras.iter().flat_map(points).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn cameras() -> BTreeMap<String, Camera> {
        let camera = |i: usize| {
            let i = i as f64;
            let turn = DMat3::from_axis_angle(DVec3::new(0.1, 0.9, 0.2).normalize(), 0.3 * i);
            Camera::centred(64, 48, 60.0, turn, DVec3::new(i.sin(), 0.3 * i, (2.0 * i).cos()))
        };
        (0..7).map(|i| (format!("cam{i}"), camera(i))).collect()
    }

    #[test]
    fn poses_in_another_world_are_the_same_after_alignment_and_a_turned_camera_shows() {
        let known = cameras();
        let world = DMat3::from_axis_angle(DVec3::new(-0.7, 0.2, 0.5).normalize(), 2.4);
        let moved = |camera: &Camera| {
            let centre = 3.0 * (world * camera.centre()) + DVec3::new(5.0, -2.0, 1.0);
            Camera::centred(64, 48, 60.0, world * camera.rotation.transpose(), centre)
        };
        let mut found: BTreeMap<String, Camera> = known.iter().map(|(name, c)| (name.clone(), moved(c))).collect();
        let errors = PoseErrors::of(&found, &known, 0.1);
        assert_eq!(errors.below(PoseError { degrees: 1e-6, share: 1e-9 }), 7, "{}", errors.describe());
        if let Some(camera) = found.get_mut("cam3") {
            let centre = camera.centre();
            camera.rotation = DMat3::from_rotation_x(2f64.to_radians()) * camera.rotation;
            camera.translation = -(camera.rotation * centre);
        }
        let errors = PoseErrors::of(&found, &known, 0.1);
        // The alignment hardly follows it.
        assert!((1.9..2.0).contains(&errors.cameras["cam3"].degrees), "{}", errors.describe());
        assert_eq!(errors.below(PoseError { degrees: 0.1, share: 0.01 }), 6, "{}", errors.describe());
    }

    #[test]
    fn a_rig_on_a_line_is_not_turned_around_that_line_by_the_noise_of_its_centres() {
        let rig = |noise: f64| -> BTreeMap<String, Camera> {
            let camera = |i: usize| {
                let side = if i.is_multiple_of(2) { noise } else { -noise };
                let centre = DVec3::new(i as f64, side, -side);
                (format!("cam{i}"), Camera::centred(64, 48, 60.0, DMat3::IDENTITY, centre))
            };
            (0..5).map(camera).collect()
        };
        let errors = PoseErrors::of(&rig(0.004), &rig(-0.004), 1.0);
        assert_eq!(errors.below(PoseError { degrees: 0.2, share: 0.005 }), 5, "{}", errors.describe());
    }
}
