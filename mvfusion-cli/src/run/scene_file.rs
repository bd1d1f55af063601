//! `scene.json`: where the cameras of a run stand and at which times they look, for its report.

use glam::DVec3;
use mvfusion_data::{Scene, View, by_camera};
use serde::{Deserialize, Serialize};

/// Share of the points that the box of points leaves out at either end of an axis: strays would make it useless.
const STRAYS: f64 = 0.02;

/// The scene of a run.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct SceneFile {
    /// 1.1 times the largest distance of a training camera from their mean, in world units.
    pub extent: f64,
    /// Mean of the training cameras' centres.
    pub centre: [f64; 3],
    /// Corners of a box around the initial points without strays, if there are any.
    #[serde(skip_serializing_if = "Option::is_none", default)]
    pub points: Option<[[f64; 3]; 2]>,
    /// The distinct cameras, the training cameras first.
    pub cameras: Vec<SceneCamera>,
    /// The held-out views, in the order of their files.
    pub held_out: Vec<HeldOutView>,
}

/// A camera: views of one pose and lens.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct SceneCamera {
    /// Name of its first view.
    pub name: String,
    /// Whether its views are held out.
    pub is_held_out: bool,
    /// Its centre.
    pub position: [f64; 3],
    /// What is to the right, down and forward, as unit vectors.
    pub axes: [[f64; 3]; 3],
    /// Half the width and height of the image in a distance of 1.
    pub half_size: [f64; 2],
    /// Its first and last time.
    pub times: [f64; 2],
    /// Number of its views.
    pub views: usize,
}

/// A held-out view.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct HeldOutView {
    /// Its name.
    pub name: String,
    /// Its time, 0 to 1.
    pub time: f64,
    /// Index of its camera.
    pub camera: usize,
}

impl SceneFile {
    /// What a report needs to know of a scene.
    pub fn of(scene: &Scene) -> Self {
        let mut cameras = Vec::new();
        let mut held_out = Vec::new();
        for group in by_camera(scene.train.iter()) {
            cameras.push(SceneCamera::of(&scene.train, &group, false));
        }
        for group in by_camera(scene.test.iter()) {
            held_out.extend(group.iter().map(|&index| (index, cameras.len())));
            cameras.push(SceneCamera::of(&scene.test, &group, true));
        }
        held_out.sort_unstable();
        let view = |(view, (_, camera)): (&View, (usize, usize))| HeldOutView {
            name: view.name.clone(),
            time: view.time,
            camera,
        };
        Self {
            extent: scene.extent(),
            centre: scene.training_centre().to_array(),
            points: points_box(scene),
            cameras,
            held_out: scene.test.iter().zip(held_out).map(view).collect(),
        }
    }
}

impl SceneCamera {
    /// The camera of some views, which is the same for all.
    fn of(views: &[View], group: &[usize], is_held_out: bool) -> Self {
        let first = &views[group[0]];
        let camera = &first.camera;
        let half = |pixels: usize, focal: f64| pixels as f64 / (2.0 * focal);
        let times = group.iter().map(|&index| views[index].time);
        Self {
            name: first.name.clone(),
            is_held_out,
            position: camera.centre().to_array(),
            axes: [0, 1, 2].map(|row| camera.rotation.row(row).to_array()),
            half_size: [half(camera.width, camera.fx), half(camera.height, camera.fy)],
            times: [times.clone().fold(f64::INFINITY, f64::min), times.fold(f64::NEG_INFINITY, f64::max)],
            views: group.len(),
        }
    }
}

fn points_box(scene: &Scene) -> Option<[[f64; 3]; 2]> {
    let last = scene.points.len().checked_sub(1)?;
    let ends = [0, 1, 2].map(|axis| {
        let mut places: Vec<f32> = scene.points.positions.iter().map(|point| point[axis]).collect();
        places.sort_by(f32::total_cmp);
        [STRAYS, 1.0 - STRAYS].map(|share| f64::from(places[(last as f64 * share).round() as usize]))
    });
    Some([0, 1].map(|end| DVec3::new(ends[0][end], ends[1][end], ends[2][end]).to_array()))
}

#[cfg(test)]
mod tests {
    use mvfusion_data::{BuiltinKind, BuiltinOptions, builtin};

    use super::*;

    #[test]
    fn a_fixed_camera_is_one_camera_at_all_its_times() {
        let options = BuiltinOptions { width: 48, height: 36, ..BuiltinOptions::of_kind(BuiltinKind::Video) };
        let scene = builtin::builtin(&options);
        let file = SceneFile::of(&scene);
        let count = |is_held_out| file.cameras.iter().filter(|camera| camera.is_held_out == is_held_out).count();
        let cameras = scene.training_cameras().into_iter().max().map_or(0, |last| last + 1);
        assert_eq!((count(false), file.held_out.len()), (cameras, scene.test.len()));
        assert_eq!(file.cameras.iter().map(|camera| camera.views).sum::<usize>(), scene.train.len() + scene.test.len());
        let first = &file.cameras[file.held_out[0].camera];
        assert!(first.is_held_out && first.times[0] < first.times[1], "{first:?}");
        assert_eq!(first.axes[2], scene.test[0].camera.forward().to_array());
        let [low, high] = file.points.expect("the scene has points");
        assert!(low.iter().zip(high).all(|(low, high)| *low < high));
    }
}
