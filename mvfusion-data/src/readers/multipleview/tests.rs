//! A tiny scene, intact and with the usual kinds of damage.

use std::fmt::Write;

use glam::{DVec2, DVec3, Vec3};

use super::*;
use crate::readers::testing::{PLY, SceneFolder, npy, shown};
use crate::readers::{Format, recognise};

/// Cameras 1, 2 and 10, of seven frames.
const CAMERAS: [&str; 3] = ["cam01", "cam02", "cam10"];
const FRAMES: usize = 7;

/// The images of a model. Image `i` is at x = -i and looks along +z.
fn images(names: &[&str]) -> String {
    let mut text = String::new();
    for (place, name) in names.iter().enumerate() {
        write!(text, "{} 1 0 0 0 {place} 0 0 1 {name}\n\n", place + 1).expect("a string grows");
    }
    text
}

fn scene() -> SceneFolder {
    let folder = SceneFolder::new();
    for camera in CAMERAS {
        for frame in 1..=FRAMES {
            folder.write_picture(&format!("{camera}/frame_{frame:05}.jpg"), (48, 32), 10 * frame as u8);
        }
    }
    folder.write("sparse_/cameras.txt", "1 PINHOLE 96 64 80 84 46 33\n");
    folder.write("sparse_/images.txt", images(&["image10.jpg", "image1.jpg", "image2.jpg"]));
    folder.write("sparse_/points3D.txt", "1 7 8 9 255 255 255 0.5\n");
    folder.write("points3D_multipleview.ply", PLY);
    folder
}

#[test]
fn a_whole_scene_is_read() {
    let folder = scene();
    assert_eq!(recognise(folder.path(), None).expect("known"), Format::MULTIPLEVIEW);
    let scene = folder.open().expect("read");
    assert_eq!((scene.capture, scene.train.len(), scene.near), (Capture::Video, 3 * FRAMES, None));
    assert_eq!(shown(&scene.train)[8], ("cam02/frame_00002", 1.0 / 7.0));
    let looked_at = ["cam01/frame_00001", "cam01/frame_00003", "cam01/frame_00005", "cam02/frame_00001"];
    assert_eq!(shown(&scene.test).iter().map(|(name, _)| *name).take(4).collect::<Vec<_>>(), looked_at);
    assert_eq!((scene.test.len(), scene.test[1].time), (9, 2.0 / 7.0));
    // JPEG preserves a uniform grey to within a level.
    assert!(scene.train[8].image.rgb().expect("frame").get_pixel(3, 3).0[0].abs_diff(20) <= 1);
    let camera = scene.train[FRAMES].camera;
    assert_eq!((camera.width, camera.height, camera.fx, camera.fy), (48, 32, 40.0, 42.0));
    assert_eq!(camera.centre(), DVec3::new(-2.0, 0.0, 0.0));
    assert_eq!(camera.project(DVec3::new(-1.0, 0.5, 2.0)), Some(DVec2::new(43.0, 27.0)));
    assert_eq!(scene.train[2 * FRAMES].camera.centre(), DVec3::ZERO);
    assert_eq!(scene.points.positions[1], Vec3::new(4.0, 5.0, 6.0));
}

#[test]
fn cameras_can_be_held_out_and_frames_left_out() {
    let folder = scene();
    let options = ReadOptions { test_cameras: Some(vec!["cam10".into()]), frames: Some(2), ..Default::default() };
    let scene = folder.open_with(options).expect("read");
    assert_eq!(shown(&scene.test), [("cam10/frame_00001", 0.0), ("cam10/frame_00002", 0.5)]);
    assert_eq!(scene.train.len(), 4);
    // Of two frames, the first and the second are test views; of one frame, only that one.
    let count =
        |frames| folder.open_with(ReadOptions { frames: Some(frames), ..Default::default() }).expect("read").test;
    assert_eq!((count(2).len(), count(1).len()), (6, 3));
}

#[test]
fn frames_of_cameras_that_are_held_out_stay_in_the_order_of_time() {
    let folder = SceneFolder::new();
    for (camera, frame) in ["cam1", "cam2"].into_iter().flat_map(|camera| [9, 10, 11].map(|frame| (camera, frame))) {
        folder.write_picture(&format!("{camera}/frame_{frame}.png"), (48, 32), 1);
    }
    folder.write("sparse_/cameras.txt", "1 PINHOLE 96 64 80 84 46 33\n");
    folder.write("sparse_/images.txt", images(&["image1.jpg", "image2.jpg"]));
    folder.write("sparse_/points3D.txt", "");
    let options = ReadOptions { test_cameras: Some(vec!["cam2".into()]), ..Default::default() };
    let scene = folder.open_with(options).expect("read");
    let names = |views: &[View]| views.iter().map(|view| view.name.clone()).collect::<Vec<_>>();
    assert_eq!(names(&scene.test), ["cam2/frame_9", "cam2/frame_10", "cam2/frame_11"]);
    assert_eq!(names(&scene.train), ["cam1/frame_9", "cam1/frame_10", "cam1/frame_11"]);
}

#[test]
fn cameras_without_a_pose_and_images_without_a_camera_are_left_out() {
    let folder = scene();
    folder.write("sparse_/images.txt", images(&["image2.jpg", "image77.jpg"]));
    let scene = folder.open().expect("read");
    assert_eq!((scene.train.len(), scene.train[0].name.as_str()), (FRAMES, "cam02/frame_00001"));
    folder.write("sparse_/images.txt", images(&["image77.jpg"]));
    folder.complaint(&["no camera with frames and a pose"]);
}

#[test]
fn images_and_cameras_that_cannot_be_told_apart_are_refused() {
    let folder = scene();
    for (names, parts) in [
        (&["image1.jpg", "front.jpg"][..], &["sparse_", "front.jpg"][..]),
        (&["image+1.jpg"], &["sparse_", "image+1.jpg"]),
        (&["image1.jpg", "image01.jpg"], &["image01.jpg", "number 1"]),
        (&["image1.jpg", "image1.png"], &["images.txt", "extensions"]),
        (&["../image1.jpg"], &["images.txt", "`..`"]),
    ] {
        folder.write("sparse_/images.txt", images(names));
        folder.complaint(parts);
    }
    folder.write("sparse_/images.txt", images(&["image1.jpg"]));
    folder.write_picture("cam1/frame_00001.jpg", (48, 32), 1);
    folder.complaint(&["the camera cam01", "number 1"]);
}

#[test]
fn frames_must_be_there_for_every_camera_that_is_used() {
    let folder = scene();
    folder.remove("cam02/frame_00003.jpg");
    folder.complaint(&["cam02 has no frame 00003, but cam01 has it"]);
    folder.remove("cam02");
    std::fs::create_dir(folder.at("cam02")).expect("folder");
    folder.complaint(&["no frame of the camera cam02"]);
    folder.remove("cam02");
    assert_eq!(folder.open().expect("read").train.len(), 2 * FRAMES);
    folder.remove("sparse_");
    folder.complaint(&["no model with cameras.bin or cameras.txt", "sparse_"]);
}

#[test]
fn the_near_bound_and_the_points_come_from_where_they_are() {
    let folder = scene();
    let row = |near: f64| [0., 1., 0., 1., 64., -1., 0., 0., 2., 96., 0., 0., 1., 3., 80., near, 9.];
    folder.write(BOUNDS, npy(&[2, 17], [row(0.5), row(0.25)].concat()));
    assert_eq!(folder.open().expect("read").near, Some(0.25));
    folder.write(BOUNDS, npy(&[2, 17], [row(0.5), row(0.0)].concat()));
    assert_eq!(folder.open().expect("read").near, None);
    folder.write(BOUNDS, npy(&[1, 17], row(f64::NAN).to_vec()));
    folder.complaint(&[BOUNDS, "row 0"]);
    folder.remove(BOUNDS);
    folder.remove("points3D_multipleview.ply");
    assert_eq!(folder.open().expect("read").points.positions, [Vec3::new(7.0, 8.0, 9.0)]);
    // With its own poses, it would be a Neu3D scene.
    folder.write("poses_bounds.npy", "not looked at");
    assert_eq!(recognise(folder.path(), None).expect("known"), Format::NEU3D);
}
