//! A tiny scene, intact and with the usual kinds of damage.

use std::io::{Cursor, Write};

use glam::DVec3;
use serde_json::{Value, json};
use zip::ZipWriter;
use zip::write::SimpleFileOptions;

use super::*;
use crate::readers::testing::{PLY, SceneFolder, npy, shown, with};
use crate::readers::{Format, TimeRule, recognise};

const TIMES: usize = 3;

/// The cameras of a file, at x = -number and looking along +z.
fn meta(cameras: &[i64]) -> Value {
    let all = |entry: &dyn Fn(usize, i64) -> Value| -> Value {
        (0..TIMES).map(|time| cameras.iter().map(|&camera| entry(time, camera)).collect::<Value>()).collect()
    };
    json!({
        "w": 48, "h": 32,
        "k": all(&|_, _| json!([[40.0, 0.0, 23.0], [0.0, 42.0, 16.5], [0.0, 0.0, 1.0]])),
        "w2c": all(&|_, camera| json!([[1, 0, 0, camera], [0, 1, 0, 0], [0, 0, 1, 0], [0, 0, 0, 1]])),
        "fn": all(&|time, camera| json!(format!("{camera}/{time:06}.png"))),
        "cam_id": all(&|_, camera| json!(camera)),
    })
}

fn archive(name: &str, array: &[u8]) -> Vec<u8> {
    let mut archive = ZipWriter::new(Cursor::new(Vec::new()));
    archive.start_file(name, SimpleFileOptions::default()).expect("entry");
    archive.write_all(array).expect("written");
    archive.finish().expect("written").into_inner()
}

fn scene() -> SceneFolder {
    let folder = SceneFolder::new();
    for camera in [0, 2, 5] {
        for time in 0..TIMES {
            folder.write_picture(&format!("ims/{camera}/{time:06}.png"), (48, 32), (10 * camera + time) as u8);
        }
    }
    folder.write_json(TRAIN, &meta(&[5, 2]));
    folder.write_json(TEST, &meta(&[0]));
    let points = vec![1.0, 2.0, 3.0, 1.0, 0.5, 0.0, 1.0, 4.0, 5.0, 6.0, 0.0, 0.25, 1.5, 0.0];
    folder.write(ARCHIVE, archive("data.npy", &npy(&[2, 7], points)));
    folder
}

#[test]
fn a_whole_scene_is_read_camera_by_camera() {
    let folder = scene();
    assert_eq!(recognise(folder.path(), None).expect("known"), Format::PANOPTIC);
    let scene = folder.open().expect("read");
    assert_eq!((scene.capture, scene.near), (Capture::Video, None));
    let names: Vec<_> = shown(&scene.train).into_iter().map(|(name, _)| name).collect();
    assert_eq!(names, ["2/000000", "2/000001", "2/000002", "5/000000", "5/000001", "5/000002"]);
    assert_eq!(shown(&scene.test), [("0/000000", 0.0), ("0/000001", 1.0 / 3.0), ("0/000002", 2.0 / 3.0)]);
    assert_eq!(scene.train[4].time, 1.0 / 3.0);
    assert_eq!(scene.train[4].image.rgb().expect("picture").get_pixel(3, 3).0, [51; 3]);
    let camera = scene.train[0].camera;
    assert_eq!(camera.centre(), DVec3::new(-2.0, 0.0, 0.0));
    assert_eq!(camera.project(DVec3::new(-1.0, 0.5, 2.0)), Some(DVec2::new(43.0, 27.0)));
    assert_eq!(scene.points.positions, [Vec3::new(1.0, 2.0, 3.0), Vec3::new(4.0, 5.0, 6.0)]);
    assert_eq!(scene.points.colours, [Vec3::new(1.0, 0.5, 0.0), Vec3::new(0.0, 0.25, 1.0)]);
}

#[test]
fn fewer_frames_and_other_cameras_may_be_asked_for() {
    let folder = scene();
    let two = ReadOptions { frames: Some(2), ..Default::default() };
    let scene = folder.open_with(two).expect("read");
    assert_eq!((scene.train.len(), shown(&scene.test)), (4, vec![("0/000000", 0.0), ("0/000001", 0.5)]));
    let original = ReadOptions { time: TimeRule::FrameOver300, ..Default::default() };
    assert_eq!(folder.open_with(original).expect("read").test[2].time, 2.0 / 300.0);
    let other = ReadOptions { test_cameras: Some(vec!["5".into()]), ..Default::default() };
    let scene = folder.open_with(other).expect("read");
    assert_eq!((scene.train.len(), scene.test.len(), scene.test[0].name.as_str()), (6, 3, "5/000000"));
    assert!(folder.open_with(ReadOptions { frames: Some(0), ..Default::default() }).is_err());
}

/// A file of cameras without the frame 1 of one of them: its place has the frame after.
fn shifted(cameras: &[i64], camera: i64) -> Value {
    let place = cameras.iter().position(|known| *known == camera).expect("a camera");
    let mut value = meta(cameras);
    for time in 1..TIMES {
        value["fn"][time][place] = json!(format!("{camera}/{:06}.png", time + 1));
    }
    value
}

#[test]
fn images_of_one_time_have_the_same_number() {
    let folder = scene();
    for camera in [0, 2, 5] {
        folder.write_picture(&format!("ims/{camera}/{TIMES:06}.png"), (48, 32), 9);
    }
    folder.write_json(TRAIN, &shifted(&[5, 2], 2));
    folder.complaint(&["camera 2 has no frame 000001 at time 1 of train_meta.json", "camera 5 has it", "both files"]);
    folder.write_json(TRAIN, &meta(&[5, 2]));
    folder.write_json(TEST, &shifted(&[0], 0));
    folder.complaint(&["test_meta.json has no frame 000001, but train_meta.json has it", "from both files"]);
    // Times before the first difference are read.
    let one = ReadOptions { frames: Some(1), ..Default::default() };
    assert_eq!(folder.open_with(one).expect("read").test.len(), 1);
    // A gap in all lists is fine.
    let mut train = shifted(&[5, 2], 5);
    train["fn"][1][1] = json!("2/000002.png");
    train["fn"][2][1] = json!("2/000003.png");
    folder.write_json(TRAIN, &train);
    assert_eq!(folder.open().expect("read").test[1].name, "0/000002");
}

#[test]
fn numbers_of_cameras_at_the_end_of_names_are_not_those_of_frames() {
    let folder = scene();
    for (file, cameras) in [(TRAIN, &[5, 2][..]), (TEST, &[0])] {
        let mut value = meta(cameras);
        for (time, (place, camera)) in (0..TIMES).flat_map(|t| cameras.iter().enumerate().map(move |at| (t, at))) {
            let name = format!("{time:06}/cam{camera:02}.png");
            folder.write_picture(&format!("ims/{name}"), (48, 32), 7);
            value["fn"][time][place] = json!(name);
        }
        folder.write_json(file, &value);
    }
    assert_eq!(shown(&folder.open().expect("read").test)[1], ("000001/cam00", 1.0 / 3.0));
}

#[test]
fn without_numbers_cameras_go_by_their_places() {
    let folder = scene();
    folder.write_json(TRAIN, &with(meta(&[5, 2]), "cam_id", Value::Null));
    assert_eq!(folder.open().expect("read").train[0].name, "5/000000");
}

#[test]
fn other_clouds_are_read_where_there_is_no_archive() {
    let folder = scene();
    folder.remove(ARCHIVE);
    assert!(folder.open().expect("read").points.is_empty());
    folder.write("points3D.ply", PLY);
    assert_eq!(folder.open().expect("read").points.len(), 2);
    for (content, part) in [
        (b"no archive".to_vec(), "init_pt_cld.npz"),
        (archive("points.npy", &npy(&[1, 7], vec![0.0; 7])), "no array `data`, but: points.npy"),
        (archive("data.npy", &npy(&[1, 5], vec![0.0; 5])), "its shape is [1, 5], not [rows, 6 or more]"),
        (archive("data.npy", &npy(&[1, 6], vec![0.0, 0.0, f64::NAN, 0.0, 0.0, 0.0])), "row 0"),
        (archive("data.npy", &npy(&[9, 7], vec![0.0; 63])[..200]), "data"),
    ] {
        folder.write(ARCHIVE, content);
        folder.complaint(&["init_pt_cld.npz", part]);
    }
}

#[test]
fn entries_that_are_no_cameras_are_refused_with_their_places() {
    let folder = scene();
    for (key, value, part) in [
        ("k", json!([[40, 0, 23], [0, 0, 16], [0, 0, 1]]), "focal lengths in k are 40 and 0"),
        ("k", json!([[40, 3, 23], [0, 42, 16], [0, 0, 1]]), "its k is"),
        ("k", json!([[40, 0, 23], [0, 42, 16], [0, 0, 0]]), "its k is"),
        ("k", json!([[40, 0, 23], [0, 42, 16]]), "its k has not 3 rows of 3 numbers"),
        ("w2c", json!([[1, 0, 0, 0], [0, 1, 0, 0], [0, 0, 1, 0]]), "its w2c has not 4 rows of 4 numbers"),
        ("w2c", json!([[0, 0, 0, 0], [0, 1, 0, 0], [0, 0, 1, 0], [0, 0, 0, 1]]), "no rotation and shift"),
        ("w2c", json!([[1, 0, 0, 0], [0, 1, 0, 0], [0, 0, -1, 0], [0, 0, 0, 1]]), "no rotation and shift"),
        ("w2c", json!([[1, 0, 0, 0], [0, 1, 0, 0], [0, 0, 1, 0], [0, 0, 1, 1]]), "no rotation and shift"),
        ("fn", json!("../5/000001.png"), "leads out of the folder"),
        ("fn", json!("/5/000001.png"), "leads out of the folder"),
    ] {
        let mut value_at = meta(&[5, 2]);
        value_at[key][1][0] = value;
        folder.write_json(TRAIN, &value_at);
        folder.complaint(&["train_meta.json", "time 1, camera 0 (", part]);
    }
    folder.write(TRAIN, meta(&[5, 2]).to_string().replacen("40.0", "NaN", 1));
    folder.complaint(&["train_meta.json", "expected"]);
    folder.write_json(TRAIN, &with(meta(&[5, 2]), "w", json!(0)));
    folder.complaint(&["train_meta.json", "its w and h are 0 and 32"]);
    folder.write_json(TRAIN, &with(meta(&[5, 2]), "h", json!(30)));
    folder.complaint(&["48 x 32", "48 x 30"]);
}

#[test]
fn lists_of_other_shapes_are_refused() {
    let folder = scene();
    for (key, places, part) in [
        ("k", TIMES - 1, "`k` has 2 times, but `fn` has 3"),
        ("w2c", TIMES - 1, "`w2c` has 2 times"),
        ("cam_id", TIMES - 1, "`cam_id` has 2 times"),
    ] {
        let mut value = meta(&[5, 2]);
        value[key] = (0..places).map(|time| meta(&[5, 2])[key][time].clone()).collect();
        folder.write_json(TRAIN, &value);
        folder.complaint(&["train_meta.json", part]);
    }
    let mut value = meta(&[5, 2]);
    value["w2c"][2] = json!([]);
    folder.write_json(TRAIN, &value);
    folder.complaint(&["train_meta.json", "`w2c` has 0 cameras at time 2, but `fn` has 2"]);
    folder.write_json(TRAIN, &json!({ "w": 48, "h": 32, "k": [], "w2c": [], "fn": [] }));
    folder.complaint(&["train_meta.json has 0 times", "test_meta.json has 3"]);
    folder.write_json(TEST, &json!({ "w": 48, "h": 32, "k": [], "w2c": [], "fn": [] }));
    folder.complaint(&["no image to train on"]);
}

#[test]
fn pictures_are_there_and_named_once() {
    let folder = scene();
    folder.write_json(TEST, &meta(&[5]));
    folder.complaint(&["ims/5/000000.png", "would have the name"]);
    folder.write_json(TEST, &meta(&[7]));
    folder.complaint(&["no image ims/7/000000.png", "3 of 9"]);
    folder.remove(TEST);
    folder.complaint(&["no test_meta.json"]);
}

#[test]
fn damaged_text_is_an_error_or_a_scene_of_finite_numbers() {
    scene().survives_wrong_characters(TRAIN, &meta(&[5, 2]).to_string());
}
