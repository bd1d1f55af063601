//! Built-in scenes, written in every layout and read back.

use std::path::Path;
use std::sync::Arc;

use glam::DVec3;
use image::RgbImage;
use tempfile::TempDir;

use super::*;
use crate::builtin::{BuiltinKind, BuiltinOptions, builtin};
use crate::inspect::{Pictures, inspect};
use crate::readers::{Format, ReadOptions, attach_masks, open};
use crate::scene::{Camera, Mask, Picture, PointCloud, View};

mod files;
mod misfits;

/// Largest error of a camera after conversion to another convention and back.
const ROUNDING: f64 = 1e-9;

const FRAMES: usize = 3;
const PHOTOS: usize = 6;
const HELD_OUT: usize = 2;

fn scene(capture: Capture) -> Scene {
    let kind = match capture {
        Capture::Video => BuiltinKind::Video,
        Capture::Photos => BuiltinKind::Casual,
    };
    let sizes =
        BuiltinOptions { width: 48, height: 32, frames: FRAMES, photos: PHOTOS, test_photos: HELD_OUT, seed: 3, kind };
    builtin(&sizes)
}

fn written(scene: &Scene, layout: Layout) -> TempDir {
    let folder = tempfile::tempdir().expect("folder");
    write(scene, layout, folder.path()).expect("written");
    folder
}

/// The format that a layout is read back as, with the names and times of its views.
struct ReadBack {
    format: Format,
    name: fn(&View, held_out: bool, index: usize) -> String,
    time: fn(&View, held_out: bool, index: usize) -> f64,
}

fn read_back(layout: Layout) -> ReadBack {
    let photo: fn(&View, bool, usize) -> String = |_, held_out, index| match held_out {
        true => format!("1extra{index:03}"),
        false => format!("2clutter{index:03}"),
    };
    let by_number: fn(&View, bool, usize) -> f64 = |_, _, index| index as f64 / (PHOTOS - 1) as f64;
    let same: fn(&View, bool, usize) -> f64 = |view, _, _| view.time;
    match layout {
        Layout::Neu3d => ReadBack { format: Format::NEU3D, name: |view, _, _| view.name.clone(), time: same },
        Layout::Nerfstudio => {
            ReadBack { format: Format::NERFSTUDIO, name: |view, _, _| format!("images/{}", view.name), time: same }
        }
        Layout::DNerf => ReadBack {
            format: Format::DNERF,
            name: |_, held_out, index| format!("{}/r_{index:03}", if held_out { "test" } else { "train" }),
            time: |view, _, _| view.time / ((FRAMES - 1) as f64 / FRAMES as f64),
        },
        Layout::OnTheGo => ReadBack {
            format: Format::ONTHEGO,
            name: |_, held_out, index| match held_out {
                true => format!("images/1extra{index:03}"),
                false => format!("images/2clutter{index:03}"),
            },
            time: by_number,
        },
        Layout::Colmap | Layout::OnTheGoColmap | Layout::RobustNerf => {
            ReadBack { format: Format::COLMAP, name: photo, time: by_number }
        }
        Layout::Panoptic => ReadBack {
            format: Format::PANOPTIC,
            name: |view, _, index| format!("{}/{:06}", number_of(view), index % FRAMES),
            time: same,
        },
        // Its default split, in which every frame trains, differs from the scene's: see `options_for`.
        Layout::MultipleView => ReadBack {
            format: Format::MULTIPLEVIEW,
            name: |view, _, index| format!("cam{:02}/frame_{:05}", number_of(view), index % FRAMES + 1),
            time: same,
        },
        Layout::HyperNerf => ReadBack {
            format: Format::HYPERNERF,
            name: |_, held_out, index| format!("{:06}", if held_out { 7 * FRAMES + index } else { index }),
            time: |view, _, _| view.time / ((FRAMES - 1) as f64 / FRAMES as f64),
        },
    }
}

/// The number of the view's camera.
fn number_of(view: &View) -> usize {
    view.name[3..5].parse().expect("cam00/0000")
}

/// The options with which the scene's own split is read back.
fn options_for(layout: Layout) -> ReadOptions {
    let held_out = (layout == Layout::MultipleView).then(|| vec!["cam00".into()]);
    ReadOptions { test_cameras: held_out, ..Default::default() }
}

#[test]
fn every_layout_is_read_back_as_the_scene_that_was_written() {
    for layout in Layout::ALL {
        let expected = read_back(layout);
        let scene = scene(layout.capture());
        let folder = written(&scene, layout);
        assert_eq!(crate::recognise(folder.path(), None).expect("recognised"), expected.format, "{layout:?}");
        let read = open(folder.path(), &options_for(layout)).expect("read");
        assert_eq!(read.capture, scene.capture);
        for (held_out, before, after) in [(false, &scene.train, &read.train), (true, &scene.test, &read.test)] {
            assert_eq!(before.len(), after.len(), "{layout:?}");
            for (index, (before, after)) in before.iter().zip(after).enumerate() {
                assert_eq!(after.name, (expected.name)(before, held_out, index), "{layout:?}");
                let time = (expected.time)(before, held_out, index);
                assert!((after.time - time).abs() < ROUNDING, "{layout:?}: {} is at {}", after.name, after.time);
                assert_same_camera(&before.camera, &after.camera, layout);
                assert_eq!(before.image.rgb().expect("image"), after.image.rgb().expect("image"), "{layout:?}");
            }
        }
        assert_same_points(&scene.points, &read.points);
    }
}

#[test]
fn what_is_written_raises_no_problem() {
    for layout in Layout::ALL {
        let kind = match layout.capture() {
            Capture::Video => BuiltinKind::Video,
            Capture::Photos => BuiltinKind::Casual,
        };
        let sizes = BuiltinOptions { width: 64, height: 48, frames: 4, photos: 8, test_photos: 10, seed: 1, kind };
        let folder = written(&builtin(&sizes), layout);
        let (inspection, _) = inspect(folder.path(), &options_for(layout), Pictures::Decoded);
        assert_eq!(inspection.problems, [], "{layout:?}");
    }
}

fn assert_same_camera(before: &Camera, after: &Camera, layout: Layout) {
    assert_eq!((before.width, before.height), (after.width, after.height));
    let numbers = |c: &Camera| {
        let mut numbers = vec![c.fx, c.fy, c.cx, c.cy];
        numbers.extend(c.rotation.to_cols_array());
        numbers.extend(c.translation.to_array());
        numbers
    };
    for (a, b) in numbers(before).into_iter().zip(numbers(after)) {
        assert!((a - b).abs() < ROUNDING, "{layout:?}: {a} became {b}");
    }
}

fn assert_same_points(before: &PointCloud, after: &PointCloud) {
    assert!(!before.is_empty());
    assert_eq!(before.positions, after.positions);
    for (a, b) in before.colours.iter().zip(&after.colours) {
        assert!((*a - *b).abs().max_element() < 0.51 / 255.0, "{a} became {b}");
    }
}

#[test]
fn what_is_known_of_the_views_lies_beside_them_under_the_names_that_they_get() {
    for layout in Layout::ALL {
        let expected = read_back(layout);
        let scene = scene(layout.capture());
        let folder = written(&scene, layout);
        let mut read = open(folder.path(), &options_for(layout)).expect("read");
        let with_mask = scene.train.iter().chain(&scene.test).filter(|v| v.truth.dynamic_mask.is_some()).count();
        assert_eq!(attach_masks(&mut read, &folder.path().join(MASKS_TRUTH)).expect("attached"), with_mask);
        for (index, (before, after)) in scene.train.iter().zip(&read.train).enumerate() {
            let name = (expected.name)(before, false, index);
            let mask = |view: &View| view.truth.dynamic_mask.as_ref().map(|mask| mask.mask().expect("mask"));
            assert_eq!(mask(before), mask(after), "{layout:?}: {name}");
            assert!(after.truth.movers_mask.is_none(), "{layout:?}: no folder of masks says what goes somewhere");
            let file = folder.path().join(MOVERS_TRUTH).join(format!("{name}.png"));
            let movers = before.truth.movers_mask.as_ref().expect("known").mask().expect("mask");
            assert_eq!(movers, image::open(file).expect("movers").into_luma8());
            let background = before.truth.background.as_ref().expect("known").rgb().expect("image");
            let file = folder.path().join(BACKGROUND_TRUTH).join(format!("{name}.png"));
            assert_eq!(*background, image::open(file).expect("background").into_rgb8());
            let depth = std::fs::read(folder.path().join(DEPTH_TRUTH).join(format!("{name}.npy"))).expect("depth");
            let depth = npyz::NpyFile::new(&depth[..]).expect("array");
            assert_eq!(depth.shape(), [32, 48]);
            assert_eq!(depth.into_vec::<f32>().expect("float32"), **before.truth.depth.as_ref().expect("known"));
        }
    }
}

#[test]
fn masks_come_back_where_the_layout_has_a_place_for_them() {
    for layout in [Layout::Nerfstudio, Layout::DNerf, Layout::Colmap, Layout::OnTheGo, Layout::RobustNerf] {
        let mut scene = scene(layout.capture());
        let picture = RgbImage::from_fn(48, 32, |x, _| image::Rgb([if x < 7 { 255 } else { 0 }; 3]));
        let picture = Picture::Memory(Arc::new(picture));
        // Black is valid in this mask; in files white is.
        scene.train[1].mask = Some(Mask { picture, inverted: true });
        let folder = written(&scene, layout);
        let read = open(folder.path(), &options_for(layout)).expect("read");
        assert_eq!(read.train.iter().filter(|view| view.mask.is_some()).count(), 1, "{layout:?}");
        let mask = read.train[1].mask.as_ref().expect("a mask").read().expect("mask");
        assert_eq!((mask.get_pixel(3, 9).0, mask.get_pixel(7, 9).0), ([0], [255]), "{layout:?}");
    }
}

#[test]
fn a_scene_that_was_read_can_be_written_again() {
    let first = written(&scene(Capture::Video), Layout::Neu3d);
    let read = open(first.path(), &ReadOptions::default()).expect("read");
    assert!(read.near.is_some_and(|near| near > 0.1), "the bounds come from the true depths");
    let again = written(&read, Layout::Neu3d);
    let reread = open(again.path(), &ReadOptions::default()).expect("read");
    assert_eq!(read.near, reread.near);
    for (a, b) in read.train.iter().zip(&reread.train) {
        assert_eq!((&a.name, a.time), (&b.name, b.time));
        assert_same_camera(&a.camera, &b.camera, Layout::Neu3d);
    }
}

#[test]
fn more_photos_than_three_digits_can_count_still_sort_by_number() {
    let mut scene = scene(Capture::Photos);
    let view = scene.train[0].clone();
    scene.train = vec![view; 1001];
    let names: Vec<String> = photos::entries(&scene, "").into_iter().map(|entry| entry.name).collect();
    assert_eq!((names[0].as_str(), names[1000].as_str()), ("2clutter0000", "2clutter1000"));
    assert!(names[..1001].is_sorted());
}

#[test]
fn a_layouts_key_is_what_configurations_write() {
    for layout in Layout::ALL {
        assert_eq!(serde_json::to_value(layout).expect("json"), layout.key());
    }
}

/// All cameras with an off-centre principal point and non-square pixels.
fn off_centre(scene: &mut Scene) {
    for view in scene.train.iter_mut().chain(&mut scene.test) {
        view.camera.cx += 1.5;
        view.camera.fy *= 1.1;
    }
}

/// All cameras move a little with time.
fn moving(scene: &mut Scene) {
    for view in scene.train.iter_mut().chain(&mut scene.test) {
        view.camera.translation += DVec3::new(view.time, 0.0, 0.0);
    }
}

#[test]
fn lenses_and_poses_of_all_kinds_survive_where_the_layout_has_words_for_them() {
    for layout in [
        Layout::Panoptic,
        Layout::Nerfstudio,
        Layout::HyperNerf,
        Layout::Colmap,
        Layout::OnTheGoColmap,
        Layout::OnTheGo,
        Layout::RobustNerf,
    ] {
        let mut scene = scene(layout.capture());
        off_centre(&mut scene);
        moving(&mut scene);
        scene.train[0].camera.fx *= 1.25; // Two lenses, so that one for all is not enough.
        let folder = written(&scene, layout);
        let read = open(folder.path(), &options_for(layout)).expect("read");
        for (before, after) in scene.train.iter().chain(&scene.test).zip(read.train.iter().chain(&read.test)) {
            assert_same_camera(&before.camera, &after.camera, layout);
        }
    }
}

fn exists(folder: &Path, name: &str) {
    assert!(folder.join(name).is_file(), "{name}");
}
