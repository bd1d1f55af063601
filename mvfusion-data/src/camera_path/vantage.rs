//! The vantage point of a scene: the position of its training cameras and their target.

use glam::DVec3;

use super::placed::{axes, placed};
use crate::scene::{Camera, PointCloud, Scene, nearest_to_axes};

/// Length of the mean viewing direction above which the cameras look the same way. Cameras that all deviate from their
/// mean by 37 degrees have this length.
const ALIKE: f64 = 0.8;
/// Determinant of the normal equations above which the optical axes meet. It is 0 for parallel axes. This value is
/// reached by axes that deviate by about 2 degrees.
const MEETING: f64 = 1e-3;
/// Points that an image must contain for their median depth to be reliable.
const FEWEST_POINTS: usize = 10;
/// The meeting point may be this many times nearer or farther than the visible points.
const FARTHEST: f64 = 4.0;

/// The position of the training cameras and their target.
#[derive(Clone, Debug)]
pub struct Vantage {
    /// A camera in the middle. If the cameras look the same way, it has their mean position and direction. Otherwise
    /// the mean would be inside the objects that they surround, so it is the camera of median height.
    pub middle: Camera,
    /// The target of the cameras: the point nearest to all optical axes. If the axes do not meet near the visible
    /// points, it is straight ahead of the middle camera instead.
    pub target: DVec3,
    /// Depth of the middle camera's view.
    pub depth: f64,
    /// The upward direction of most cameras, a unit vector.
    pub up: DVec3,
}

impl Vantage {
    /// The vantage of the scene's training cameras.
    pub fn of(scene: &Scene) -> Self {
        let cameras: Vec<&Camera> = scene.train.iter().map(|view| &view.camera).collect();
        let down: DVec3 = cameras.iter().map(|camera| camera.rotation.row(1)).sum();
        let up = (-down).try_normalize().unwrap_or_else(|| -cameras[0].rotation.row(1));
        let middle = middle(&cameras, scene.training_centre(), up);
        let meeting = nearest_to_axes(&cameras, MEETING);
        let ahead = meeting.map(|point| middle.to_camera(point).z).filter(|&z| z > 0.0);
        let depth = median_depth(&middle, &scene.points)
            .or(ahead)
            .unwrap_or_else(|| if scene.extent() > 0.0 { scene.extent() } else { 1.0 });
        let seen = |point: &DVec3| {
            let z = middle.to_camera(*point).z;
            (depth / FARTHEST..depth * FARTHEST).contains(&z)
        };
        let target = meeting.filter(seen).unwrap_or_else(|| middle.centre() + depth * middle.forward());
        Self { middle, target, depth, up }
    }
}

/// The camera in the middle, see [`Vantage::middle`]. `cameras` is not empty.
fn middle(cameras: &[&Camera], mean: DVec3, up: DVec3) -> Camera {
    let mut by_height = cameras.to_vec();
    by_height.sort_by(|a, b| up.dot(a.centre()).total_cmp(&up.dot(b.centre())));
    let median = by_height[by_height.len() / 2];
    let sum = |row: usize| cameras.iter().map(|camera| camera.rotation.row(row)).sum::<DVec3>() / cameras.len() as f64;
    let (forward, down) = (sum(2), sum(1));
    match axes(forward, down).filter(|_| forward.length() >= ALIKE) {
        Some(axes) => placed(median, axes, mean),
        None => *median,
    }
}

/// The median depth of the points within a camera's image, if there are enough of them.
fn median_depth(camera: &Camera, points: &PointCloud) -> Option<f64> {
    let inside = |point: DVec3| {
        let pixel = camera.project(point)?;
        let (x, y) = (0.0..camera.width as f64, 0.0..camera.height as f64);
        (x.contains(&pixel.x) && y.contains(&pixel.y)).then(|| camera.to_camera(point).z)
    };
    let mut depths: Vec<f64> = points.positions.iter().filter_map(|point| inside(point.as_dvec3())).collect();
    depths.sort_by(f64::total_cmp);
    (depths.len() >= FEWEST_POINTS).then(|| depths[depths.len() / 2])
}

#[cfg(test)]
mod tests {
    use super::*;

    fn looking(from: DVec3, at: DVec3) -> Camera {
        Camera::centred(64, 48, 60.0, axes(at - from, DVec3::NEG_Z).expect("axes"), from)
    }

    #[test]
    fn optical_axes_meet_where_the_cameras_look() {
        let target = DVec3::new(0.3, -0.2, 1.0);
        let cameras = [DVec3::new(4.0, 0.0, 1.5), DVec3::new(0.0, 4.0, 2.0), DVec3::new(-3.0, 1.0, 0.0)]
            .map(|from| looking(from, target));
        let meeting = nearest_to_axes(&cameras.each_ref(), MEETING).expect("they meet");
        assert!(meeting.distance(target) < 1e-12, "{meeting}");
        let parallel = [DVec3::ZERO, DVec3::Y].map(|from| looking(from, from + 5.0 * DVec3::X));
        assert_eq!(nearest_to_axes(&parallel.each_ref(), MEETING), None);
    }

    #[test]
    fn cameras_that_look_one_way_have_their_mean_in_the_middle_and_a_ring_the_one_of_median_height() {
        let row = [-1.0, 0.5, 2.0].map(|y| looking(DVec3::new(0.0, y, 0.0), DVec3::new(5.0, y, 0.0)));
        let found = middle(&row.each_ref(), DVec3::new(0.0, 0.5, 0.0), DVec3::Z);
        assert!(
            found.centre().distance(DVec3::new(0.0, 0.5, 0.0)) < 1e-12 && found.forward().distance(DVec3::X) < 1e-12
        );
        // All around at several heights, one of them almost straight above.
        let places = [[3.0, 0.0, 0.5], [0.0, 3.0, 1.0], [-3.0, 0.0, 1.5], [0.0, -3.0, 0.0], [0.1, 0.0, 3.0]];
        let ring = places.map(|place| looking(DVec3::from_array(place), DVec3::ZERO));
        assert_eq!(middle(&ring.each_ref(), DVec3::Z, DVec3::Z), ring[1]);
    }
}
