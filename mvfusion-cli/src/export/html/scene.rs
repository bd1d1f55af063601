//! The description of a scene for the player.

use mvfusion_data::camera_path::Vantage;
use mvfusion_data::keyframes::BranchLayout;
use mvfusion_data::{Capture, View, distinct_cameras};
use mvfusion_model::timeline::spread;
use serde::Serialize;

use super::Packed;
use crate::export::Exporter;
use crate::run::OpenRun;

/// Most cameras to jump to.
const MOST_CAMERAS: usize = 48;

/// Everything about a scene but its Gaussians.
#[derive(Clone, Debug, Serialize)]
pub(super) struct SceneDescription {
    /// Title of the page.
    pub title: String,
    /// The static branch; `null` in a model with one branch.
    #[serde(rename = "static")]
    static_: Option<BranchLayout>,
    /// The dynamic branch.
    dynamic: BranchLayout,
    /// Gaussians at this z in camera coordinates or nearer are not drawn.
    near: f64,
    /// Level of the colours behind all Gaussians.
    grey: f64,
    /// Mask probabilities behind all Gaussians: static, brightness, dynamic.
    masks: [f64; 3],
    /// First and last training time.
    span: [f64; 2],
    /// Number of training times.
    training_times: usize,
    /// What the cameras look at.
    target: [f64; 3],
    /// Upwards.
    up: [f64; 3],
    /// The first camera, then cameras to jump to.
    cameras: Vec<CameraDescription>,
}

/// A camera in OpenCV axes, see [`mvfusion_data::Camera`].
#[derive(Clone, Debug, Serialize)]
struct CameraDescription {
    name: String,
    width: usize,
    height: usize,
    fx: f64,
    fy: f64,
    cx: f64,
    cy: f64,
    /// Rotation from world to camera, by rows.
    rotation: [f64; 9],
    translation: [f64; 3],
    /// Its time, in a photo collection, where each photo has its own.
    time: Option<f64>,
}

impl CameraDescription {
    fn new(view: &View, name: &str, capture: Capture) -> Self {
        let camera = &view.camera;
        let rows = [0, 1, 2].map(|row| camera.rotation.row(row).to_array());
        let is_photo = capture == Capture::Photos;
        Self {
            name: name.to_owned(),
            width: camera.width,
            height: camera.height,
            fx: camera.fx,
            fy: camera.fy,
            cx: camera.cx,
            cy: camera.cy,
            rotation: std::array::from_fn(|index| rows[index / 3][index % 3]),
            translation: camera.translation.to_array(),
            time: is_photo.then_some(view.time),
        }
    }
}

/// The names of cameras by views of them. In a video, the name is the folder of the frame's, `cam00` of `cam00/0003`, if no
/// other of these views has the same.
fn camera_names<'a>(views: &[&'a View], capture: Capture) -> Vec<&'a str> {
    let folder = |view: &'a View| view.name.rsplit_once('/').map(|(folder, _)| folder);
    let is_unique = |name: &&str| views.iter().filter(|view| folder(view) == Some(*name)).count() == 1;
    let name = |view: &&'a View| match capture {
        Capture::Photos => view.name.as_str(),
        Capture::Video => folder(view).filter(is_unique).unwrap_or(&view.name),
    };
    views.iter().map(name).collect()
}

/// Describes the scene of a run and its packed Gaussians.
pub(super) fn describe(run: &OpenRun, exporter: &Exporter, packed: &Packed) -> SceneDescription {
    let scene = &run.scene;
    let views = distinct_cameras(scene.test.iter().chain(&scene.train));
    let views: Vec<&View> = spread(views.len(), MOST_CAMERAS).into_iter().map(|index| views[index]).collect();
    let mut layouts = packed.layouts.clone();
    // Proof: a page has a dynamic branch.
    let dynamic = layouts.pop().expect("a dynamic branch");
    let times = exporter.context.timeline.times();
    let vantage = Vantage::of(scene);
    SceneDescription {
        title: scene.name.clone(),
        static_: layouts.pop(),
        dynamic,
        near: exporter.context.near,
        grey: exporter.context.background.grey,
        masks: exporter.context.background.masks,
        span: [times[0], times[times.len() - 1]],
        training_times: times.len(),
        target: vantage.target.to_array(),
        up: vantage.up.to_array(),
        cameras: views
            .iter()
            .zip(camera_names(&views, scene.capture))
            .map(|(view, name)| CameraDescription::new(view, name, scene.capture))
            .collect(),
    }
}

#[cfg(test)]
mod tests {
    use mvfusion_data::{BuiltinOptions, builtin};

    use super::*;

    #[test]
    fn a_camera_of_a_video_is_called_after_its_folder_if_that_is_its_own() {
        let scene = builtin::builtin(&BuiltinOptions { width: 32, height: 24, frames: 1, ..Default::default() });
        let names = |names: [&str; 3], capture| {
            let views = names.map(|name| View { name: name.to_owned(), ..scene.train[0].clone() });
            camera_names(&views.each_ref(), capture).into_iter().map(str::to_owned).collect::<Vec<_>>()
        };
        let rig = ["cam00/0003", "cam01/0003", "walk"];
        assert_eq!(names(rig, Capture::Video), ["cam00", "cam01", "walk"]);
        assert_eq!(names(rig, Capture::Photos), rig);
        let one_moving = ["images/0001", "images/0002", "test/r_000"];
        assert_eq!(names(one_moving, Capture::Video), ["images/0001", "images/0002", "test"]);
    }
}
