//! A tiny capture, intact and with the usual kinds of damage.

use glam::{DVec2, DVec3, Vec3};
use serde_json::{Value, json};

use super::dataset::by_position;
use super::*;
use crate::readers::testing::{PLY, SceneFolder, npy, shown, with};
use crate::readers::{Format, recognise};

const IDS: [&str; 4] = ["left_0", "right_0", "left_1", "right_1"];

/// A camera at (1, 2, 3) that looks along the world's +x with y down; for images of 96 by 64 pixels.
fn camera() -> Value {
    json!({
        "orientation": [[0.0, 0.0, -1.0], [0.0, 1.0, 0.0], [1.0, 0.0, 0.0]],
        "position": [1.0, 2.0, 3.0],
        "focal_length": 80.0,
        "principal_point": [46.0, 33.0],
        "skew": 0.0,
        "pixel_aspect_ratio": 1.05,
        "radial_distortion": [0.0, 0.0, 0.0],
        "tangential_distortion": [0.0, 0.0],
        "image_size": [96, 64],
    })
}

/// A capture with images at half and at a quarter of the size.
fn capture() -> SceneFolder {
    let folder = SceneFolder::new();
    for (index, id) in IDS.iter().enumerate() {
        folder.write_json(&format!("camera/{id}.json"), &camera());
        folder.write_picture(&format!("rgb/2x/{id}.png"), (48, 32), 10 * index as u8);
        folder.write_picture(&format!("rgb/4x/{id}.png"), (24, 16), 100 + index as u8);
    }
    folder.write_json("dataset.json", &dataset());
    folder.write_json("metadata.json", &metadata());
    folder.write_json("scene.json", &json!({ "scale": 0.5, "center": [9.0, 9.0, 9.0], "near": 0.2, "far": 3.0 }));
    folder.write("points.npy", npy(&[2, 3], vec![1.0f32, 2.0, 3.0, 4.0, 5.0, 6.0]));
    folder
}

fn dataset() -> Value {
    json!({ "count": 4, "ids": IDS, "train_ids": ["left_0", "left_1"], "val_ids": ["right_1"] })
}

fn metadata() -> Value {
    let moment = |warp: u32| json!({ "warp_id": warp, "appearance_id": warp, "camera_id": 0 });
    json!({ "left_0": moment(0), "right_0": moment(4), "left_1": moment(1), "right_1": moment(1), "spare": moment(8) })
}

#[test]
fn a_whole_capture_is_read() {
    let folder = capture();
    assert_eq!(recognise(folder.path(), None).expect("known"), Format::HYPERNERF);
    let scene = folder.open().expect("read");
    assert_eq!((scene.capture, scene.near), (Capture::Video, Some(0.4)));
    // The times count every image that `ids` lists, used or not.
    assert_eq!(shown(&scene.train), [("left_0", 0.0), ("left_1", 0.25)]);
    assert_eq!(shown(&scene.test), [("right_1", 0.25)]);
    assert_eq!(scene.train[1].image.rgb().expect("picture").get_pixel(3, 3).0, [20; 3]);
    assert_eq!((scene.points.positions[1], scene.points.colours[1]), (Vec3::new(4.0, 5.0, 6.0), Vec3::splat(GREY)));
    let camera = scene.train[0].camera;
    assert_eq!((camera.width, camera.height, camera.fx, camera.fy), (48, 32, 40.0, 42.0));
    assert!((camera.centre() - DVec3::new(1.0, 2.0, 3.0)).length() < 1e-12);
    // Two in front, half a unit below, and one to the right, which is opposite to the world's z.
    let pixel = camera.project(DVec3::new(3.0, 2.5, 2.0)).expect("in front");
    assert!((pixel - DVec2::new(43.0, 27.0)).length() < 1e-9, "{pixel}");
}

#[test]
fn the_folder_of_pictures_follows_the_downscale() {
    let folder = capture();
    let read = |downscale: f64| {
        let view = folder.open_with(ReadOptions { downscale, ..Default::default() }).expect("read").train.remove(0);
        (view.camera.width, view.camera.fx as f32, view.image.rgb().expect("picture").get_pixel(3, 3).0[0])
    };
    assert_eq!(read(2.0), (48, 40.0, 0));
    assert_eq!(read(1.5), (48, 40.0, 0));
    assert_eq!(read(3.0), (32, 80.0 / 3.0, 0));
    folder.write_picture("rgb/1x/left_0.png", (96, 64), 200);
    folder.write_picture("rgb/1x/left_1.png", (96, 64), 200);
    folder.write_picture("rgb/1x/right_1.png", (96, 64), 200);
    folder.write("rgb/03x/notes.txt", "none");
    assert_eq!(read(1.0), (96, 80.0, 200));
    assert_eq!(read(1.5), (64, 80.0 / 1.5, 200));
    // A quarter is 24 x 16, the smallest useful size.
    assert_eq!(read(4.0), (24, 20.0, 100));
    for downscale in [0.5, f64::NAN] {
        let error = folder.open_with(ReadOptions { downscale, ..Default::default() }).expect_err("refused");
        assert!(matches!(error, DataError::Setting { option: "downscale", .. }), "{error}");
    }
    folder.remove("rgb/1x");
    folder.remove("rgb/2x");
    folder.remove("rgb/4x");
    folder.complaint(&["no folder 2x or the like", "rgb"]);
    folder.remove("rgb");
    folder.complaint(&["rgb", "2x"]);
}

#[test]
fn without_val_ids_pictures_are_parted_by_position() {
    let purposes = |count: usize| {
        let shown = |part: &Option<Part>| match part {
            Some(Part::Train) => 'T',
            Some(Part::Test) => 'h',
            None => '.',
        };
        by_position(count).iter().map(shown).collect::<String>()
    };
    assert_eq!(purposes(9), "T.h.T.h.T");
    assert_eq!(purposes(8), "T.h.T...");
    assert_eq!((purposes(4), purposes(0)), ("T...".into(), String::new()));
    let folder = capture();
    folder.write_json("dataset.json", &with(dataset(), "val_ids", json!([])));
    let scene = folder.open().expect("read");
    assert_eq!((shown(&scene.train), scene.test.len()), (vec![("left_0", 0.0)], 0));
}

#[test]
fn a_picture_in_both_lists_is_held_out_and_ids_may_be_left_out() {
    let folder = capture();
    folder.write_json("dataset.json", &json!({ "train_ids": ["left_0", "left_1"], "val_ids": ["right_1"] }));
    let scene = folder.open().expect("read");
    assert_eq!(shown(&scene.train), [("left_0", 0.0), ("left_1", 1.0)]);
    folder.write_json("dataset.json", &with(dataset(), "train_ids", json!(["left_0", "right_1"])));
    let scene = folder.open().expect("read");
    assert_eq!((scene.train.len(), scene.test.len()), (1, 1));
}

#[test]
fn a_lens_that_bends_is_straightened_whatever_its_tangential_shift_is_called() {
    let folder = capture();
    let old = with(camera(), "tangential", json!([0.01, 0.02]));
    folder.write_json("camera/left_0.json", &old);
    folder.write_json("camera/left_1.json", &with(camera(), "radial_distortion", json!([-0.1, 0.01])));
    let scene = folder.open().expect("read");
    for (view, bent) in [(&scene.train[0], true), (&scene.train[1], true), (&scene.test[0], false)] {
        let crate::Picture::File(file) = &view.image else { panic!("a file") };
        assert_eq!(file.lenses.is_some(), bent, "{}", view.name);
    }
}

#[test]
fn coloured_points_come_first_and_a_capture_may_lack_points_and_bounds() {
    let folder = capture();
    folder.write("fused.ply", PLY);
    assert_eq!(folder.open().expect("read").points.colours[0], Vec3::X);
    for name in ["fused.ply", "points.npy", "scene.json"] {
        folder.remove(name);
    }
    let scene = folder.open().expect("read");
    assert_eq!((scene.points.len(), scene.near), (0, None));
    folder.write_json("scene.json", &json!({ "scale": 0.0, "near": 0.2 }));
    assert_eq!(folder.open().expect("read").near, None);
    folder.write("points.npy", npy(&[1, 3], vec![1.0, f64::NAN, 3.0]));
    folder.complaint(&["points.npy", "row 0", "NaN"]);
    folder.write("points.npy", npy(&[3], vec![1.0, 2.0, 3.0]));
    folder.complaint(&["points.npy", "its shape is [3]"]);
}

#[test]
fn cameras_that_are_none_are_refused() {
    let folder = capture();
    for (key, value, part) in [
        ("orientation", json!([[0, 0, 1], [0, 1, 0], [1, 0, 0]]), "is no rotation"),
        ("orientation", json!([[0, 0, 0], [0, 1, 0], [1, 0, 0]]), "is no rotation"),
        ("orientation", json!([[0, 0], [0, 1], [1, 0]]), "invalid length"),
        ("position", json!([1, 2]), "invalid length"),
        ("focal_length", json!(0.0), "its focal_length is 0"),
        ("pixel_aspect_ratio", json!(-1.0), "its pixel_aspect_ratio is -1"),
        ("image_size", json!([96, 0]), "its image_size is 0"),
        ("image_size", json!([96, 62]), "96 x 62"),
        ("skew", json!(2.0), "its skew is 2"),
        ("radial_distortion", json!([0, 0, 0, 1]), "its radial_distortion"),
        ("tangential", json!([0, 0, 0]), "its tangential_distortion"),
    ] {
        folder.write_json("camera/left_1.json", &with(camera(), key, value));
        folder.complaint(&["left_1", part]);
    }
    folder.write("camera/left_1.json", camera().to_string().replace("1.05", "NaN"));
    folder.complaint(&["camera/left_1.json", "expected"]);
    folder.remove("camera/left_1.json");
    folder.complaint(&["camera/left_1.json", "No such file"]);
    folder.remove("camera/right_0.json");
    folder.write_json("camera/left_1.json", &camera());
    assert!(folder.open().is_ok(), "cameras of unused pictures are not needed");
}

#[test]
fn lists_that_do_not_fit_are_refused() {
    let folder = capture();
    for (value, parts) in [
        (with(dataset(), "ids", json!(["a", "a"])), &["dataset.json", "the id a twice"][..]),
        (with(dataset(), "ids", json!(["../a"])), &["dataset.json", "`../a`", "`..`"]),
        (with(dataset(), "ids", json!(["/a"])), &["dataset.json", "`/a`"]),
        (with(dataset(), "ids", json!([""])), &["dataset.json", "``"]),
        (with(dataset(), "ids", json!([[1]])), &["dataset.json", "neither a text nor a whole number"]),
        (with(dataset(), "val_ids", json!(["up_3"])), &["dataset.json", "names up_3"]),
        (with(dataset(), "train_ids", json!([])), &["no image to train on"]),
        (json!({}), &["no image to train on"]),
        (json!([]), &["dataset.json"]),
    ] {
        folder.write_json("dataset.json", &value);
        folder.complaint(parts);
    }
    folder.write_json("dataset.json", &dataset());
    for (value, parts) in [
        (json!({}), &["metadata.json", "no entry for the image left_0"][..]),
        (with(metadata(), "left_1", json!({ "warp_id": -1 })), &["metadata.json", "-1"]),
        (with(metadata(), "left_1", json!({ "camera_id": 1 })), &["metadata.json", "warp_id"]),
    ] {
        folder.write_json("metadata.json", &value);
        folder.complaint(parts);
    }
    folder.write_json("metadata.json", &metadata());
    folder.remove("rgb/2x/right_1.png");
    folder.complaint(&["no image rgb/2x/right_1.png", "1 of 3"]);
}

#[test]
fn damaged_text_is_an_error_or_a_scene_of_finite_numbers() {
    capture().survives_wrong_characters("camera/left_1.json", &camera().to_string());
}
