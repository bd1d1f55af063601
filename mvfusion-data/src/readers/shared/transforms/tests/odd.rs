//! Oddities of users' files, which the usual tools do not write.

use super::*;
use crate::error::DataError;
use crate::readers::shared::transforms::ignored_masks;
use crate::scene::{Distortion, Picture, Scene};

/// Three images below `images`, and their frames.
fn three(folder: &SceneFolder) -> Vec<Value> {
    let name = |i: u8| format!("images/{i}.png");
    (0..3).for_each(|i| folder.write_picture(&name(i), SIZE, i));
    (0..3).map(|i| frame(&name(i), 0.0)).collect()
}

fn opened(folder: &SceneFolder, value: &Value) -> Scene {
    folder.write_json("transforms.json", value);
    folder.open().expect("read")
}

fn names(scene: &Scene) -> [Vec<&str>; 2] {
    [&scene.train, &scene.test].map(|views| views.iter().map(|view| view.name.as_str()).collect())
}

#[test]
fn one_list_is_enough_to_part_the_pictures_and_paths_may_be_written_in_two_ways() {
    let folder = SceneFolder::new();
    let whole = file(three(&folder));
    let only = |key: &str, list: &[&str]| with(whole.clone(), key, json!(list));
    let train = only("train_filenames", &["./images/0.png", "images/2.png"]);
    assert_eq!(names(&opened(&folder, &train)), [vec!["images/0", "images/2"], vec!["images/1"]]);
    let test = only("test_filenames", &["./images/2.png"]);
    assert_eq!(names(&opened(&folder, &test)), [vec!["images/0", "images/1"], vec!["images/2"]]);
    // Without test images, the validation images are held out.
    let validated = with(train, "val_filenames", json!(["images/1.png"]));
    let validated = with(validated, "test_filenames", json!([]));
    assert_eq!(names(&opened(&folder, &validated)), [vec!["images/0", "images/2"], vec!["images/1"]]);
    let message = complaint(&folder, &only("test_filenames", &["images/0.png", "images/1.png", "images/2.png"]));
    assert!(message.contains("holds out every image"), "{message}");
    let message = complaint(&folder, &only("val_filenames", &["images/7.png"]));
    assert!(message.contains("images/7.png, which is no frame"), "{message}");
}

#[test]
fn pictures_that_are_for_nothing_need_not_be_there() {
    let folder = SceneFolder::new();
    let parted = with(file(three(&folder)), "train_filenames", json!(["images/0.png"]));
    folder.write_json("transforms.json", &with(parted, "test_filenames", json!(["images/1.png"])));
    folder.remove("images/2.png");
    assert_eq!(names(&folder.open().expect("read")), [vec!["images/0"], vec!["images/1"]]);
}

#[test]
fn an_option_that_holds_out_every_picture_is_the_one_to_blame() {
    let folder = SceneFolder::new();
    folder.write_json("transforms.json", &file(three(&folder)));
    let read = |test_every| folder.open_with(ReadOptions { test_every, ..Default::default() });
    assert!(matches!(read(1), Err(DataError::Setting { option: "test_every", .. })));
    assert_eq!(names(&read(2).expect("read")), [vec!["images/1"], vec!["images/0", "images/2"]]);
    assert!(read(0).expect("read").test.is_empty());
}

#[test]
fn seconds_and_nanoseconds_are_not_mixed_and_no_span_is_too_long() {
    let folder = SceneFolder::new();
    let frames = three(&folder);
    let timed = |entries: [(&str, f64); 3]| {
        file(frames.iter().zip(entries).map(|(frame, (key, time))| with(frame.clone(), key, json!(time))).collect())
    };
    let message = complaint(&folder, &timed([("time", 0.0), ("time", 0.5), ("timestamp", 1e18)]));
    assert!(message.contains("images/0.png has a time, but other frames have none of the kind"), "{message}");
    for [first, middle, last] in [[-1e308, 0.0, 1e308], [-5e-324, 0.0, 0.0], [7.0, 7.0, 7.0]] {
        let scene = opened(&folder, &timed([("timestamp", first), ("timestamp", middle), ("timestamp", last)]));
        assert!(
            scene.train.iter().chain(&scene.test).all(|view| (0.0..=1.0).contains(&view.time)),
            "{first} to {last}"
        );
    }
}

#[test]
fn points_and_masks_that_the_file_names_must_be_there() {
    let folder = SceneFolder::new();
    let mut frames = three(&folder);
    let message = complaint(&folder, &with(file(frames.clone()), "ply_file_path", json!("sparse_pc.ply")));
    assert!(message.contains("no point cloud sparse_pc.ply") && message.contains("ply_file_path"), "{message}");
    frames[1]["mask_path"] = json!("masks/1.png");
    folder.write_json("transforms.json", &file(frames));
    folder.complaint(&["no mask masks/1.png", "1 of 1 masks"]);
}

#[test]
fn masks_that_no_frame_names_are_told() {
    let folder = SceneFolder::new();
    let mut frames = three(&folder);
    let told = |frames: &[Value]| ignored_masks(folder.path(), &opened(&folder, &file(frames.to_vec())));
    assert_eq!(told(&frames), None);
    folder.write_picture("masks/1.png", SIZE, 255);
    let said = "masks/ contains 1 file, but no frame has a `mask_path`";
    assert_eq!(told(&frames).as_deref(), Some(said));
    frames[1]["mask_path"] = json!("masks/1.png");
    assert_eq!(told(&frames), None);
}

#[test]
fn an_angle_serves_as_focal_length_of_pictures_whose_size_is_known() {
    let folder = SceneFolder::new();
    let angled = with(file(three(&folder)), "fl_x", Value::Null);
    let scene = opened(&folder, &with(with(angled.clone(), "fl_y", Value::Null), "camera_angle_x", json!(0.7)));
    let camera = scene.train[0].camera;
    assert!((camera.fx - 24.0 / 0.35f64.tan()).abs() < 1e-9 && camera.fy == camera.fx, "{camera:?}");
    assert_eq!((camera.cx, camera.cy), (23.0, 16.5));
    let message = complaint(&folder, &with(with(angled, "camera_angle_x", json!(0.7)), "w", Value::Null));
    assert!(message.contains("it has intrinsics but not w and h"), "{message}");
}

#[test]
fn coefficients_count_whatever_the_model_is_called() {
    let folder = SceneFolder::new();
    let bent = with(file(three(&folder)), "k1", json!(-0.05));
    let distortion = |value: &Value| match &opened(&folder, value).train[0].image {
        Picture::File(file) => file.lenses.as_ref().map(|lenses| lenses[0].distortion),
        Picture::Memory(_) => None,
    };
    let radial = [-0.05, 0.0, 0.0, 0.0, 0.0, 0.0];
    let perspective = Some(Distortion::opencv(radial, [0.0; 2]));
    assert_eq!(distortion(&with(bent.clone(), "camera_model", json!("PINHOLE"))), perspective);
    assert_eq!(distortion(&with(bent.clone(), "is_fisheye", json!(false))), perspective);
    // As nerfstudio's converters of Metashape and RealityCapture write it, and as OpenCV means it.
    let fourth = with(bent.clone(), "k4", json!("0.02"));
    let eighth =
        Distortion::Perspective { numerator: [-0.05, 0.0, 0.0, 0.02], denominator: [0.0; 3], tangential: [0.0; 2] };
    assert_eq!(distortion(&with(fourth.clone(), "camera_model", json!("OPENCV"))), Some(eighth));
    let fraction = Distortion::opencv([-0.05, 0.0, 0.0, 0.02, 0.0, 0.0], [0.0; 2]);
    assert_eq!(distortion(&with(fourth.clone(), "camera_model", json!("FULL_OPENCV"))), Some(fraction));
    let sixth = Distortion::opencv([-0.05, 0.0, 0.0, 0.02, 0.0, 0.01], [0.0; 2]);
    assert_eq!(distortion(&with(fourth, "k6", json!(0.01))), Some(sixth));
    let fisheye = Distortion::Fisheye { radial, tangential: [0.0; 2], prism: [0.0; 4], shifted_last: false };
    assert_eq!(distortion(&with(bent, "is_fisheye", json!(true))), Some(fisheye));
}

#[test]
fn numbers_that_nothing_can_be_computed_with_are_refused() {
    let folder = SceneFolder::new();
    let frames = three(&folder);
    let mut far = frames.clone();
    far[2]["transform_matrix"][0][3] = json!(1e300);
    for (value, parts) in [
        (with(file(frames.clone()), "fl_x", json!(1e300)), &["images/1.png", "too large or too small"][..]),
        (with(file(frames.clone()), "fl_y", json!(1e-60)), &["too large or too small"]),
        (with(file(frames.clone()), "cx", json!(-1e300)), &["too large or too small"]),
        (file(far), &["images/2.png", "too large or too small"]),
        (with(with(file(frames.clone()), "w", json!(1e-30)), "h", json!(1e-30)), &["one factor"]),
        (with(file(frames), "k1", json!(1e300)), &["shows nothing in front of the camera"]),
    ] {
        folder.write_json("transforms.json", &value);
        folder.complaint(parts);
    }
}

/// The header of a PNG file of eight million by sixteen pixels: both sides, the pixel format, the checksum.
const HUGE: [u8; 17] =
    [0x00, 0x7a, 0x12, 0x00, 0x00, 0x00, 0x00, 0x10, 0x08, 0x02, 0x00, 0x00, 0x00, 0x8f, 0xd8, 0xfd, 0x41];

#[test]
fn a_header_that_claims_a_gigantic_picture_is_refused_before_its_border_is_walked() {
    let folder = SceneFolder::new();
    let frames = three(&folder);
    let mut bytes = fs::read(folder.at("images/0.png")).expect("read");
    bytes[16..33].copy_from_slice(&HUGE);
    (0..3).for_each(|i| folder.write(&format!("images/{i}.png"), &bytes));
    let claimed = with(with(file(frames), "w", json!(8_000_000)), "h", json!(16));
    folder.write_json("transforms.json", &with(claimed, "k1", json!(0.01)));
    folder.complaint(&["images/", "8000000 x 16", "65535"]);
}

#[test]
fn lego_is_tested_on_the_pictures_that_show_its_shape() {
    let moving = |name: &str, time: f64| with(frame(name, 0.0), "time", json!(time));
    let of = |frame: Value| json!({ "camera_angle_x": 0.7, "frames": [frame] });
    let folder = SceneFolder::new();
    for scene in ["Lego", "mutant"] {
        for part in ["train", "val", "test"] {
            folder.write_picture(&format!("{scene}/{part}/r_0.png"), SIZE, 9);
            folder.write_json(&format!("{scene}/transforms_{part}.json"), &of(moving(&format!("./{part}/r_0"), 1.0)));
        }
    }
    let held_out = |scene: &str| {
        let scene = open(&folder.at(scene), &ReadOptions::default()).expect("read");
        scene.test[0].name.clone()
    };
    assert_eq!((held_out("Lego").as_str(), held_out("mutant").as_str()), ("val/r_0", "test/r_0"));
    folder.write_json("mutant/transforms_test.json", &of(moving("./test/r_0", -1.0)));
    let message = open(&folder.at("mutant"), &ReadOptions::default()).expect_err("refused").to_string();
    assert!(message.contains("transforms_test.json") && message.contains("-1"), "{message}");
    // Blender's own lego does not move, and its test images are correct.
    for part in ["train", "val", "test"] {
        folder.write_json(&format!("Lego/transforms_{part}.json"), &of(frame(&format!("./{part}/r_0"), 0.0)));
    }
    assert_eq!(held_out("Lego"), "test/r_0");
    let grey = open(&folder.at("Lego"), &ReadOptions::default()).expect("read").points;
    assert!(grey.colours.iter().all(|colour| (*colour - 0.5).abs().max_element() < 0.002), "METHOD §5.6");
}
