//! The facts of a scene that a page needs: cameras, times, layers, points.

use std::path::Path;

use anyhow::Context;
use axum::body::Bytes;
use glam::DVec3;
use mvfusion_data::camera_path::Vantage;
use mvfusion_data::{Camera, Capture, PointCloud, Scene, View};
use mvfusion_model::evaluation::{Layer, heat_colours};
use mvfusion_model::timeline::spread;
use serde::Serialize;

use super::protocol::Limits;

/// Most points that are sent: enough to see a shape.
const MOST_POINTS: usize = 4000;
/// Colours of the legend of heat maps.
const LEGEND: usize = 33;
/// Most pixels of a picture.
const MOST_PIXELS: usize = 1920 * 1080;

/// What else is known of the run.
#[derive(Clone, Copy, Debug)]
pub struct RunFacts<'a> {
    /// Its folder.
    pub run: &'a Path,
    /// Whether it trains now.
    pub is_training: bool,
    /// Whether its model has temporal attention.
    pub has_mfta: bool,
    /// Whether its model has a static branch.
    pub has_static: bool,
    /// Grey level behind everything.
    pub background: f64,
}

#[derive(Serialize)]
struct Facts<'a> {
    scene: &'a str,
    run: String,
    training: bool,
    mfta: bool,
    background: f64,
    most_pixels: usize,
    /// Whether held-out photos are compared with the static branch alone, because their times were not trained.
    clean_test: bool,
    up: DVec3,
    target: DVec3,
    extent: f64,
    times: Vec<f64>,
    cameras: Vec<CameraFacts>,
    train: Vec<ViewFacts<'a>>,
    test: Vec<ViewFacts<'a>>,
    layers: Vec<LayerFacts>,
    heat: Vec<[u8; 3]>,
    /// Number of points in `points.bin`.
    points: usize,
}

/// A camera as in the `cameras.json` of 3DGS.
#[derive(Serialize)]
struct CameraFacts {
    position: DVec3,
    /// Camera to world, by rows.
    rotation: [DVec3; 3],
    width: usize,
    height: usize,
    fx: f64,
    fy: f64,
    cx: f64,
    cy: f64,
}

/// A view: its name, the index of its camera, its time.
#[derive(Serialize)]
struct ViewFacts<'a>(&'a str, usize, f64);

#[derive(Serialize)]
struct LayerFacts {
    name: &'static str,
    label: &'static str,
}

/// What is granted for a scene.
pub fn limits(scene: &Scene) -> Limits {
    Limits { pixels: MOST_PIXELS, train: scene.train.len(), test: scene.test.len() }
}

/// The facts as JSON.
///
/// # Errors
/// If the facts cannot be written as JSON.
pub fn facts(scene: &Scene, run: &RunFacts<'_>) -> anyhow::Result<Bytes> {
    let vantage = Vantage::of(scene);
    let mut cameras: Vec<&Camera> = Vec::new();
    let train = listed(&scene.train, &mut cameras);
    let test = listed(&scene.test, &mut cameras);
    let facts = Facts {
        scene: &scene.name,
        run: run.run.display().to_string(),
        training: run.is_training,
        mfta: run.has_mfta,
        background: run.background,
        most_pixels: MOST_PIXELS,
        clean_test: scene.capture == Capture::Photos && run.has_static,
        up: vantage.up,
        target: vantage.target,
        extent: scene.extent(),
        times: scene.training_times(),
        train,
        test,
        cameras: cameras.into_iter().map(CameraFacts::of).collect(),
        layers: Layer::ALL.map(|layer| LayerFacts { name: layer.name(), label: layer.label() }).into(),
        heat: heat_colours(LEGEND),
        points: chosen(&scene.points).len(),
    };
    Ok(serde_json::to_vec(&facts).context("cannot describe the scene for the viewer")?.into())
}

/// Positions of some points as `f32`, then their colours as `u8`, little-endian.
pub fn points(scene: &Scene) -> Bytes {
    let (PointCloud { positions, colours }, chosen) = (&scene.points, chosen(&scene.points));
    let places = chosen.iter().flat_map(|&index| positions[index].to_array()).flat_map(f32::to_le_bytes);
    let levels = chosen.iter().flat_map(|&index| colours[index].to_array().map(|level| (255.0 * level) as u8));
    places.chain(levels).collect::<Vec<u8>>().into()
}

fn chosen(points: &PointCloud) -> Vec<usize> {
    spread(points.len(), MOST_POINTS)
}

/// The views, with the index of each one's camera among the distinct ones.
fn listed<'a>(views: &'a [View], cameras: &mut Vec<&'a Camera>) -> Vec<ViewFacts<'a>> {
    let fact = |view: &'a View| {
        // The views of a camera often follow each other, so the search begins at the end.
        let known = cameras.iter().rposition(|camera| **camera == view.camera);
        let camera = known.unwrap_or_else(|| {
            cameras.push(&view.camera);
            cameras.len() - 1
        });
        ViewFacts(&view.name, camera, view.time)
    };
    views.iter().map(fact).collect()
}

impl CameraFacts {
    fn of(camera: &Camera) -> Self {
        let Camera { width, height, fx, fy, cx, cy, .. } = *camera;
        // The columns of the rotation to the camera are the rows of the rotation to the world.
        let rotation = [0, 1, 2].map(|row| camera.rotation.col(row));
        Self { position: camera.centre(), rotation, width, height, fx, fy, cx, cy }
    }
}

#[cfg(test)]
pub(super) mod tests {
    use mvfusion_data::{BuiltinOptions, builtin};
    use serde_json::Value;

    use super::*;

    pub fn scene() -> Scene {
        builtin::builtin(&BuiltinOptions { width: 32, height: 24, frames: 3, ..Default::default() })
    }

    /// The facts of a run on the scene.
    pub fn run_facts() -> RunFacts<'static> {
        RunFacts { run: Path::new("runs/test"), is_training: true, has_mfta: true, has_static: true, background: 0.0 }
    }

    #[test]
    fn each_camera_is_told_once_and_every_view_names_its_own() {
        let scene = scene();
        let facts: Value = serde_json::from_slice(&facts(&scene, &run_facts()).expect("facts")).expect("JSON");
        let cameras = facts["cameras"].as_array().expect("a list").len();
        assert!(cameras < scene.train.len() + scene.test.len());
        for (views, told) in [(&scene.train, &facts["train"]), (&scene.test, &facts["test"])] {
            for (view, fact) in views.iter().zip(told.as_array().expect("a list")) {
                assert_eq!((fact[0].as_str(), fact[2].as_f64()), (Some(&*view.name), Some(view.time)));
                let camera = &facts["cameras"][fact[1].as_u64().expect("an index") as usize];
                let place = DVec3::from_array([0, 1, 2].map(|i| camera["position"][i].as_f64().expect("a number")));
                assert!(place.distance(view.camera.centre()) < 1e-9);
                let forward = [0, 1, 2].map(|row| camera["rotation"][row][2].as_f64().expect("a number"));
                assert!(DVec3::from_array(forward).distance(view.camera.forward()) < 1e-9);
            }
        }
        assert_eq!(facts["layers"].as_array().map(Vec::len), Some(Layer::ALL.len()));
    }

    #[test]
    fn points_are_some_and_have_colours() {
        let scene = scene();
        let count = chosen(&scene.points).len();
        assert!(count > 0 && count <= MOST_POINTS);
        assert_eq!(points(&scene).len(), count * (3 * size_of::<f32>() + 3));
    }
}
