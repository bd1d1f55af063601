//! Every layout of the field that we write is read back as the scene that was written, and the layouts of a kind train
//! alike: the same cameras, times and split, and from the same pictures and points the same losses.

use std::path::Path;

use mvfusion_data::builtin::builtin;
use mvfusion_data::{BuiltinKind, BuiltinOptions, Camera, ReadOptions, Scene, View, open};
use mvfusion_data::{Layout, write};
use mvfusion_model::config::Config;
use mvfusion_model::train::Trainer;
use mvfusion_tests::{backends, numbers};

use crate::training::config;

/// Steps whose losses are compared.
const STEPS: usize = 10;

/// What a number of a camera may differ by on its way through a file.
const CAMERA: f64 = 1e-5;

const VIDEO: [Layout; 4] = [Layout::Neu3d, Layout::Panoptic, Layout::Nerfstudio, Layout::MultipleView];
const PHOTOS: [Layout; 4] = [Layout::Colmap, Layout::OnTheGo, Layout::OnTheGoColmap, Layout::RobustNerf];

/// The built-in scene of a kind, small.
fn original(kind: BuiltinKind) -> Scene {
    builtin(&BuiltinOptions { kind, width: 48, height: 36, frames: 4, photos: 9, test_photos: 3, seed: 2 })
}

/// The scene as it comes back from a layout, written to `folder`, in which its pictures stay.
fn read_back(scene: &Scene, layout: Layout, folder: &Path) -> Scene {
    write(scene, layout, folder).unwrap_or_else(|error| panic!("{}: {error}", layout.key()));
    // The layout does not say which camera is held out; its own split trains on all.
    let test_cameras = (layout == Layout::MultipleView).then(|| vec!["cam00".to_owned()]);
    open(folder, &ReadOptions { test_cameras, ..Default::default() })
        .unwrap_or_else(|error| panic!("{}: {error}", layout.key()))
}

/// The numbers of a camera.
fn camera_numbers(camera: &Camera) -> Vec<f64> {
    let lens = [camera.fx, camera.fy, camera.cx, camera.cy];
    lens.into_iter().chain(camera.rotation.to_cols_array()).chain(camera.translation.to_array()).collect()
}

fn assert_same_views(layout: Layout, found: &[View], wanted: &[View]) {
    let layout = layout.key();
    assert_eq!(found.len(), wanted.len(), "{layout}: another split");
    for (found, wanted) in found.iter().zip(wanted) {
        assert!((found.time - wanted.time).abs() < 1e-12, "{layout}: {} at {}", found.name, found.time);
        let off = camera_numbers(&found.camera).iter().zip(camera_numbers(&wanted.camera));
        let off = off.map(|(a, b)| (a - b).abs()).fold(0.0, f64::max);
        assert!(off < CAMERA, "{layout}: the camera of {} is off by {off}", found.name);
        let pixels = |view: &View| view.image.rgb().expect("a picture");
        assert_eq!(pixels(found), pixels(wanted), "{layout}: {} shows something else", found.name);
    }
}

/// Only some layouts say how near the nearest surface is, so nobody may make use of it.
fn config_for_all() -> Config {
    let mut config = config();
    config.model.near_share = 0.0;
    config
}

fn first_losses(scene: &Scene) -> Vec<f64> {
    let mut trainer = Trainer::new(config_for_all(), scene, &(backends()[0].device)()).expect("the run can start");
    let mut step = |_| numbers(trainer.step().expect("a step succeeds").expect("not over").total)[0];
    (0..STEPS).map(&mut step).collect()
}

fn assert_alike(kind: BuiltinKind, layouts: [Layout; 4]) {
    let folder = tempfile::tempdir().expect("folder");
    let original = original(kind);
    let mut reference: Option<(Scene, Vec<f64>)> = None;
    for layout in layouts {
        let scene = read_back(&original, layout, &folder.path().join(layout.key()));
        assert_eq!(scene.capture, layout.capture(), "{}", layout.key());
        assert_same_views(layout, &scene.train, &original.train);
        assert_eq!(scene.points.positions, original.points.positions, "{}", layout.key());
        let losses = first_losses(&scene);
        let Some((first, wanted)) = &reference else {
            reference = Some((scene, losses));
            continue;
        };
        // Held-out photos have times of the readers' own, the same in all layouts.
        assert_same_views(layout, &scene.test, &first.test);
        assert_eq!(scene.points, first.points, "{}", layout.key());
        for (step, (found, wanted)) in losses.iter().zip(wanted).enumerate() {
            assert!((found / wanted - 1.0).abs() < 1e-6, "{}, step {step}: {found}, not {wanted}", layout.key());
        }
    }
}

#[test]
fn the_layouts_for_videos_give_one_scene_and_train_alike() {
    assert_alike(BuiltinKind::Video, VIDEO);
}

#[test]
fn the_layouts_for_photos_give_one_scene_and_train_alike() {
    assert_alike(BuiltinKind::Casual, PHOTOS);
}
