//! Every layout of the field that we write is read back as the scene that was written, and the layouts of a kind train
//! alike: the same cameras, times and split, and from the same pictures and points the same losses. Layouts are of one kind
//! that give their pictures the same times.

use std::path::Path;

use mvfusion_data::builtin::builtin;
use mvfusion_data::{BuiltinKind, BuiltinOptions, Camera, Capture, ReadOptions, Scene, View, open};
use mvfusion_data::{Layout, write};
use mvfusion_model::config::Config;
use mvfusion_model::train::Trainer;
use mvfusion_tests::{backends, numbers};

use crate::training::config;

/// Steps whose losses are compared.
const STEPS: usize = 10;

/// What a number of a camera may differ by on its way through a file.
const CAMERA: f64 = 1e-5;

/// What a loss may differ by, as a share of it: cameras differ in the last bits of a double.
const LOSS: f64 = 1e-6;

const FRAMES: usize = 4;
const PHOTOS: usize = 9;

/// The built-in scene of a kind, small. Its points have the colours of 8 bits that most layouts have room for.
fn original(kind: BuiltinKind) -> Scene {
    let sizes = BuiltinOptions { kind, width: 48, height: 36, frames: FRAMES, photos: PHOTOS, test_photos: 3, seed: 2 };
    let mut scene = builtin(&sizes);
    scene.points.colours.iter_mut().for_each(|colour| *colour = (*colour * 255.0).round() / 255.0);
    scene
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
        let off = camera_numbers(&found.camera).into_iter().zip(camera_numbers(&wanted.camera));
        let off = off.map(|(a, b)| (a - b).abs()).fold(0.0, f64::max);
        assert!(off < CAMERA, "{layout}: the camera of {} is off by {off}", found.name);
        let pixels = |view: &View| view.image.rgb().expect("a picture");
        assert!(pixels(found) == pixels(wanted), "{layout}: {} shows something else", found.name);
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

/// Writes the original in each layout, and expects to read what is wanted and the same from all.
fn assert_alike(original: &Scene, wanted: &Scene, layouts: &[Layout]) {
    let folder = tempfile::tempdir().expect("folder");
    let mut reference: Option<Vec<f64>> = None;
    for &layout in layouts {
        let scene = read_back(original, layout, &folder.path().join(layout.key()));
        assert_eq!(scene.capture, layout.capture(), "{}", layout.key());
        assert_same_views(layout, &scene.train, &wanted.train);
        assert_same_views(layout, &scene.test, &wanted.test);
        assert!(scene.points == wanted.points, "{}: other points", layout.key());
        let losses = first_losses(&scene);
        let Some(wanted) = &reference else {
            reference = Some(losses);
            continue;
        };
        for (step, (found, wanted)) in losses.iter().zip(wanted).enumerate() {
            assert!((found / wanted - 1.0).abs() < LOSS, "{}, step {step}: {found}, not {wanted}", layout.key());
        }
    }
}

#[test]
fn the_layouts_for_videos_give_one_scene_and_train_alike() {
    let original = original(BuiltinKind::Video);
    let layouts = [Layout::Neu3d, Layout::Panoptic, Layout::Nerfstudio, Layout::MultipleView];
    assert_alike(&original, &original, &layouts);
}

#[test]
fn the_layouts_whose_last_moment_is_time_one_give_one_scene_and_train_alike() {
    let original = original(BuiltinKind::Video);
    let mut stretched = original.clone();
    let last = (FRAMES - 1) as f64 / FRAMES as f64;
    stretched.train.iter_mut().chain(&mut stretched.test).for_each(|view| view.time /= last);
    assert_alike(&original, &stretched, &[Layout::DNerf, Layout::HyperNerf]);
}

#[test]
fn a_format_of_photos_can_hold_the_frames_of_a_video() {
    let (original, folder) = (original(BuiltinKind::Casual), tempfile::tempdir().expect("folder"));
    let photos = read_back(&original, Layout::Colmap, folder.path());
    let options = ReadOptions { capture: Some(Capture::Video), ..Default::default() };
    let video = open(folder.path(), &options).expect("read");
    assert_eq!((photos.capture, video.capture), (Capture::Photos, Capture::Video));
    assert_same_views(Layout::Colmap, &video.train, &photos.train);
    assert_same_views(Layout::Colmap, &video.test, &photos.test);
}

#[test]
fn the_layouts_for_photos_give_one_scene_and_train_alike() {
    let original = original(BuiltinKind::Casual);
    // Held-out photos get times by their numbers, like the others.
    let mut numbered = original.clone();
    for (number, view) in numbered.test.iter_mut().enumerate() {
        view.time = number as f64 / (PHOTOS - 1) as f64;
    }
    let layouts = [Layout::Colmap, Layout::OnTheGo, Layout::OnTheGoColmap, Layout::RobustNerf];
    assert_alike(&original, &numbered, &layouts);
}
