//! Small files, intact and with the usual kinds of damage, and the readers that use them.

use std::fs;

use glam::{DVec2, DVec3};
use image::{Rgba, RgbaImage};
use serde_json::{Value, json};

use crate::readers::testing::{SceneFolder, shown, with};
use crate::readers::{Format, ReadOptions, open, recognise};
use crate::scene::Capture;

mod exif;
mod odd;

const SIZE: (u32, u32) = (48, 32);

/// The message of the error for a nerfstudio file, which must name the file.
fn complaint(folder: &SceneFolder, value: &Value) -> String {
    folder.write_json("transforms.json", value);
    let message = folder.open().expect_err("the scene is damaged").to_string();
    assert!(message.contains("transforms.json"), "{message}");
    message
}

/// A camera at `x` that looks along the world's +z with y down, in OpenGL's axes.
fn pose(x: f64) -> Value {
    json!([[1.0, 0.0, 0.0, x], [0.0, -1.0, 0.0, 2.0], [0.0, 0.0, -1.0, 3.0], [0.0, 0.0, 0.0, 1.0]])
}

fn frame(name: &str, x: f64) -> Value {
    json!({ "file_path": name, "transform_matrix": pose(x) })
}

/// A file as nerfstudio writes it, for images twice as large as those on disk.
fn file(frames: Vec<Value>) -> Value {
    json!({ "fl_x": 80.0, "fl_y": 84.0, "cx": 46.0, "cy": 33.0, "w": 96, "h": 64, "frames": frames })
}

#[test]
fn poses_and_lenses_become_ours() {
    let folder = SceneFolder::new();
    for name in ["a.png", "b.png"] {
        folder.write_picture(name, SIZE, 7);
    }
    folder.write_json("transforms.json", &file(vec![frame("./a.png", 1.0), frame("b.png", 5.0)]));
    let scene = folder.open().expect("read");
    assert_eq!((scene.capture, scene.train.len(), scene.test.len()), (Capture::Photos, 1, 1));
    assert_eq!((shown(&scene.test), shown(&scene.train)), (vec![("a", 0.0)], vec![("b", 0.5)]));
    let camera = scene.train[0].camera;
    assert_eq!((camera.width, camera.height), (48, 32));
    assert_eq!((camera.fx, camera.fy, camera.cx, camera.cy), (40.0, 42.0, 23.0, 16.5));
    assert!((camera.centre() - DVec3::new(5.0, 2.0, 3.0)).length() < 1e-12);
    // A metre to the right of the axis and half of one below, two in front.
    let pixel = camera.project(DVec3::new(6.0, 2.5, 5.0)).expect("in front");
    assert!((pixel - DVec2::new(43.0, 27.0)).length() < 1e-9, "{pixel}");
    assert_eq!(scene.train[0].image.rgb().expect("picture").get_pixel(3, 3).0, [7; 3]);
}

#[test]
fn the_vertical_angle_of_view_is_used_where_fl_y_is_absent() {
    let folder = SceneFolder::new();
    folder.write_picture("a.png", SIZE, 7);
    let focal = |value: Value| {
        folder.write_json("transforms.json", &value);
        let options = ReadOptions { test_every: 0, ..Default::default() };
        let camera = open(folder.path(), &options).map(|scene| scene.train[0].camera);
        camera.map(|camera| (camera.fx, camera.fy)).map_err(|error| error.to_string())
    };
    // With fy = h, the tangent of half the angle is a half.
    let angle = json!(2.0 * 0.5f64.atan());
    let known = with(file(vec![frame("a.png", 0.0)]), "camera_angle_y", angle.clone());
    assert_eq!(focal(known.clone()), Ok((40.0, 42.0)));
    let (fx, fy) = focal(with(known.clone(), "fl_y", Value::Null)).expect("read");
    assert!(fx == 40.0 && (fy - 32.0).abs() < 1e-9, "{fx}, {fy}");
    // Without a size, for images of any size.
    let angles = json!({ "camera_angle_x": angle, "camera_angle_y": angle, "frames": [frame("a.png", 0.0)] });
    let (fx, fy) = focal(angles.clone()).expect("read");
    assert!((fx - 48.0).abs() < 1e-9 && (fy - 32.0).abs() < 1e-9, "{fx}, {fy}");
    let said = focal(with(angles, "camera_angle_y", json!(3.2))).expect_err("no angle of view");
    assert!(said.contains("its camera_angle_y is 3.2"), "{said}");
}

#[test]
fn a_lens_that_bends_is_straightened_and_a_frame_may_have_its_own() {
    let folder = SceneFolder::new();
    for name in ["a.png", "b.png"] {
        folder.write_picture(name, SIZE, 90);
    }
    let own = json!({ "file_path": "b.png", "transform_matrix": pose(0.0), "k1": 0.0, "fl_x": 100.0 });
    folder.write_json("transforms.json", &with(file(vec![frame("a.png", 0.0), own]), "k1", json!(-0.1)));
    let scene = folder.open().expect("read");
    let (bent, straight) = (&scene.test[0], &scene.train[0]);
    assert!(matches!(&bent.image, crate::Picture::File(file) if file.lenses.is_some()));
    assert!(matches!(&straight.image, crate::Picture::File(file) if file.lenses.is_none()));
    assert_eq!(straight.camera.fx, 50.0);
    assert!(bent.camera.fx < 42.0 && bent.camera.fx > 35.0, "{}", bent.camera.fx);
    assert!(bent.image.rgb().expect("picture").pixels().all(|pixel| pixel.0 == [90; 3]));
}

#[test]
fn names_in_the_file_part_the_pictures_and_times_are_kept() {
    let folder = SceneFolder::new();
    let frames: Vec<Value> = (0..4)
        .map(|i| {
            folder.write_picture(&format!("images/{i}.png"), SIZE, i);
            with(frame(&format!("images/{i}.png"), f64::from(i)), "time", json!(0.25 * f64::from(i)))
        })
        .collect();
    let parted = with(file(frames.clone()), "train_filenames", json!(["images/0.png", "images/3.png"]));
    folder.write_json("transforms.json", &with(parted.clone(), "test_filenames", json!(["images/1.png"])));
    let scene = folder.open().expect("read");
    assert_eq!(scene.capture, Capture::Video);
    assert_eq!(shown(&scene.train), [("images/0", 0.0), ("images/3", 0.75)]);
    assert_eq!(shown(&scene.test), [("images/1", 0.25)]);
    let message = complaint(&folder, &with(parted, "test_filenames", json!(["images/9.png"])));
    assert!(message.contains("images/9.png, which is no frame"), "{message}");

    // Nanoseconds are scaled to the range from the first to the last.
    let stamped = |i: usize| with(frame(&format!("images/{i}.png"), 0.0), "timestamp", json!(1e9 * (5 + i) as f64));
    folder.write_json("transforms.json", &file((0..3).map(stamped).collect()));
    let scene = folder.open().expect("read");
    assert_eq!(
        (shown(&scene.test), shown(&scene.train)),
        (vec![("images/0", 0.0)], vec![("images/1", 0.5), ("images/2", 1.0)])
    );
    let message = complaint(&folder, &file(vec![stamped(0), frame("images/1.png", 0.0)]));
    assert!(message.contains("other frames have none"), "{message}");
}

#[test]
fn damaged_files_are_refused_with_the_frame_and_the_reason() {
    let folder = SceneFolder::new();
    folder.write_picture("a.png", SIZE, 1);
    let pose_with = |row: usize, column: usize, value: Value| {
        let mut pose = pose(0.0);
        pose[row][column] = value;
        json!({ "file_path": "a.png", "transform_matrix": pose })
    };
    for (value, part) in [
        (file(vec![]), "no frame"),
        (file(vec![frame("a.png", 0.0), frame("./a.png", 1.0)]), "frames 0 and 1 are both of ./a.png"),
        (file(vec![frame("../a.png", 0.0)]), "leads out of the folder"),
        (file(vec![frame("/etc/passwd", 0.0)]), "leads out of the folder"),
        (file(vec![frame("", 0.0)]), "leads out of the folder"),
        (file(vec![pose_with(0, 0, json!(0.0))]), "frame 0 (a.png): its transform_matrix is no rotation and shift"),
        (file(vec![pose_with(0, 0, json!(-1.0))]), "no rotation and shift"),
        (file(vec![pose_with(1, 3, Value::Null)]), "invalid type"),
        (file(vec![json!({ "file_path": "a.png", "transform_matrix": [[1.0]] })]), "3 or 4 rows of 4 numbers"),
        (with(file(vec![frame("a.png", 0.0)]), "fl_x", json!(0.0)), "its fl_x is 0"),
        (with(file(vec![frame("a.png", 0.0)]), "w", Value::Null), "not w and h"),
        (with(file(vec![frame("a.png", 0.0)]), "fl_x", Value::Null), "neither fl_x nor a camera_angle_x"),
        (with(file(vec![frame("a.png", 0.0)]), "camera_model", json!("EQUIRECTANGULAR")), "EQUIRECTANGULAR"),
        (json!([1, 2]), "invalid type"),
    ] {
        let message = complaint(&folder, &value);
        assert!(message.contains(part), "`{part}` is missing: {message}");
    }
    folder.write("transforms.json", "{ \"frames\": [");
    assert!(folder.open().expect_err("torn").to_string().contains("EOF"));
    folder.write_json("transforms.json", &file(vec![frame("a.png", 0.0), frame("b.png", 0.0)]));
    let message = folder.open().expect_err("absent").to_string();
    assert!(message.contains("no image b.png") && message.contains("1 of 2"), "{message}");
}

#[test]
fn a_scene_of_d_nerf_is_read_with_times_over_both_files_and_its_backdrop() {
    let folder = SceneFolder::new();
    let moving = |name: &str, time: f64| with(frame(name, 0.0), "time", json!(time));
    let of = |frames: Vec<Value>| json!({ "camera_angle_x": 0.7, "frames": frames });
    for name in ["train/r_000.png", "train/r_001.png", "test/r_000.png"] {
        fs::create_dir_all(folder.at(name).parent().expect("a folder")).expect("folder");
        RgbaImage::from_pixel(SIZE.0, SIZE.1, Rgba([10, 20, 30, 0])).save(folder.at(name)).expect("written");
    }
    folder.write_json("transforms_train.json", &of(vec![moving("./train/r_000", 0.0), moving("./train/r_001", 0.4)]));
    folder.write_json("transforms_test.json", &of(vec![moving("./test/r_000", 0.8)]));
    assert_eq!(recognise(folder.path(), None).expect("known"), Format::DNERF);
    let options = ReadOptions { backdrop: [255; 3], ..Default::default() };
    let scene = open(folder.path(), &options).expect("read");
    assert_eq!(shown(&scene.train), [("train/r_000", 0.0), ("train/r_001", 0.5)]);
    assert_eq!(shown(&scene.test), [("test/r_000", 1.0)]);
    assert_eq!(scene.train[0].image.rgb().expect("picture").get_pixel(3, 3).0, [255; 3]);
    assert_eq!((scene.points.len(), scene.capture), (2000, Capture::Video));
    let camera = scene.train[0].camera;
    assert!((camera.fx - 24.0 / 0.35f64.tan()).abs() < 1e-9 && camera.fx == camera.fy);
    assert_eq!((camera.cx, camera.cy), (24.0, 16.0));
    folder.write_json("transforms_test.json", &of(vec![frame("./test/r_000", 0.0)]));
    let message = folder.open().expect_err("refused").to_string();
    assert!(message.contains("1 of 3 frames have no time (./test/r_000)"), "{message}");
    fs::remove_file(folder.at("transforms_test.json")).expect("removed");
    let message = folder.open().expect_err("half a scene").to_string();
    assert!(message.contains("there is no transforms_test.json in") && message.contains("come together"), "{message}");
}

#[test]
fn the_lists_of_on_the_go_part_the_sorted_frames_whose_photos_exist() {
    let folder = SceneFolder::new();
    // The first photo has no frame, and the last frame has no photo: neither counts.
    for (i, name) in ["0002", "8470", "8467", "8469", "8468"].iter().enumerate() {
        folder.write_picture(&format!("images/IMG_{name}.JPG"), SIZE, 10 * i as u8);
    }
    let frames = ["8470", "8467", "8469", "8468", "0001"].map(|name| frame(&format!("images/IMG_{name}.JPG"), 0.0));
    folder.write_json("transforms.json", &file(frames.to_vec()));
    folder.write_json("split.json", &json!({ "clutter": [0, 2], "extra": [3], "clean": [1] }));
    let scene = folder.open().expect("read");
    assert_eq!(recognise(folder.path(), None).expect("known"), Format::ONTHEGO);
    assert_eq!(shown(&scene.train), [("images/IMG_8467", 0.0), ("images/IMG_8469", 2.0 / 3.0)]);
    assert_eq!(shown(&scene.test), [("images/IMG_8470", 1.0)]);
    // A photo with another extension is the frame's, unless a frame has it already.
    fs::rename(folder.at("images/IMG_8469.JPG"), folder.at("images/IMG_8469.png")).expect("renamed");
    let twin = frame("images/IMG_8467.png", 0.0);
    folder.write_json("transforms.json", &file([frames.as_slice(), &[twin]].concat()));
    let renamed = folder.open().expect("read");
    assert_eq!(shown(&renamed.train), shown(&scene.train));
    assert_eq!(renamed.train[1].image.rgb().expect("read").get_pixel(0, 0).0, [30; 3]);
    for (split, part) in [
        (json!({ "clutter": [0, 4], "extra": [] }), "photo 4, but there are 4 with a frame"),
        (json!({ "clutter": [0, 1], "extra": [1] }), "photo 1 (images/IMG_8468.JPG) twice"),
        (json!({ "clutter": [], "extra": [1] }), "no photo to train on"),
        (json!({ "clutter": [-1], "extra": [1] }), "invalid value"),
        (json!({ "extra": [1] }), "clutter"),
    ] {
        folder.write_json("split.json", &split);
        let message = folder.open().expect_err("refused").to_string();
        assert!(message.contains(part), "`{part}` is missing: {message}");
    }
}

#[test]
fn smaller_copies_of_the_pictures_stand_for_those_made_smaller_here() {
    let folder = SceneFolder::new();
    for name in ["IMG_0001", "IMG_0002"] {
        folder.write_picture(&format!("images/{name}.JPG"), SIZE, 10);
        folder.write_picture(&format!("images_2/{name}.png"), (24, 16), 200);
    }
    let frames = ["images/IMG_0001.JPG", "./images/IMG_0002.JPG"].map(|name| frame(name, 0.0));
    folder.write_json("transforms.json", &file(frames.to_vec()));
    let read = |downscale| {
        let scene = open(folder.path(), &ReadOptions { downscale, ..Default::default() }).expect("read");
        let view = &scene.train[0];
        (view.camera.width, view.camera.fx, view.image.rgb().expect("picture").get_pixel(3, 3).0[0] > 100)
    };
    assert_eq!((read(1.0), read(2.0)), ((48, 40.0, false), (24, 20.0, true)));
    folder.write_json("split.json", &json!({ "clutter": [0], "extra": [1] }));
    assert_eq!((read(1.0), read(2.0)), ((48, 40.0, false), (24, 20.0, true)));
    fs::remove_dir_all(folder.at("images")).expect("removed");
    assert_eq!((read(1.0), read(2.0)), ((24, 20.0, true), (24, 20.0, true)));
    assert_eq!(shown(&folder.open().expect("read").test), [("images/IMG_0002", 1.0)]);
}
