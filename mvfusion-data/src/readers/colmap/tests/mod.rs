//! A tiny collection in a temporary folder, intact and with the usual kinds of damage.

use std::fs;
use std::path::PathBuf;

use glam::{DVec2, DVec3, Vec3};
use image::{Rgb, RgbImage};
use tempfile::TempDir;

use super::*;
use crate::readers::open;
use crate::scene::{Camera, PointCloud};
use sample::Sample;

mod hostile;
mod layouts;
mod masks;
mod sample;

const NAMES: [&str; 5] = ["2clutter010.png", "1extra005.png", "0clean003.png", "2clutter002.png", "1extra000.png"];
const SIZE: (u32, u32) = (48, 32);

/// A folder with photos, to which a model is written.
struct Fixture(TempDir);

impl Fixture {
    /// The photos of `names` and a binary model of them.
    fn new(names: &[&str]) -> Self {
        let fixture = Self(tempfile::tempdir().expect("folder"));
        for (place, name) in names.iter().enumerate() {
            fixture.write_photo(&format!("images/{name}"), SIZE, [10 * place as u8, 5, 9]);
        }
        fixture.write_binary(&Sample::new(names));
        fixture
    }

    fn at(&self, name: &str) -> PathBuf {
        self.0.path().join(name)
    }

    fn write(&self, name: &str, content: impl AsRef<[u8]>) {
        fs::create_dir_all(self.at(name).parent().expect("a folder")).expect("folder");
        fs::write(self.at(name), content).expect("written");
    }

    fn write_photo(&self, name: &str, (width, height): (u32, u32), colour: [u8; 3]) {
        fs::create_dir_all(self.at(name).parent().expect("a folder")).expect("folder");
        RgbImage::from_pixel(width, height, Rgb(colour)).save(self.at(name)).expect("written");
    }

    fn write_binary(&self, sample: &Sample) {
        self.write("sparse/0/cameras.bin", sample.cameras_binary());
        self.write("sparse/0/images.bin", sample.images_binary());
        self.write("sparse/0/points3D.bin", sample.points_binary());
    }

    fn write_text(&self, sample: &Sample) {
        self.write("sparse/0/cameras.txt", sample.cameras_text());
        self.write("sparse/0/images.txt", sample.images_text());
        self.write("sparse/0/points3D.txt", sample.points_text());
    }

    fn remove_model(&self) {
        fs::remove_dir_all(self.at("sparse/0")).expect("removed");
        fs::create_dir_all(self.at("sparse")).expect("folder");
    }

    fn read(&self) -> Result<Scene, DataError> {
        read(self.0.path(), &ReadOptions::default())
    }

    /// The message of the error, which must occur and name the file.
    fn complaint(&self) -> String {
        let message = self.read().expect_err("the scene is damaged").to_string();
        assert!(message.contains(self.0.path().to_str().expect("utf-8")), "the place is missing: {message}");
        message
    }

    /// The messages of the errors for a changed model, binary and as text.
    fn complaints(&self, change: impl Fn(&mut Sample)) -> [String; 2] {
        let mut sample = Sample::new(&NAMES);
        change(&mut sample);
        self.remove_model();
        self.write_text(&sample);
        let text = self.complaint();
        self.write_binary(&sample);
        [self.complaint(), text]
    }
}

fn assert_says(message: &str, parts: &[&str]) {
    parts.iter().for_each(|part| assert!(message.contains(part), "`{part}` is missing: {message}"));
}

/// Everything of a scene except the folder.
fn content(scene: &Scene) -> (Vec<(String, Camera, f64)>, usize, PointCloud) {
    let views = scene.train.iter().chain(&scene.test).map(|v| (v.name.clone(), v.camera, v.time)).collect();
    (views, scene.train.len(), scene.points.clone())
}

#[test]
fn a_whole_scene_is_read() {
    let fixture = Fixture::new(&NAMES);
    let scene = open(fixture.0.path(), &ReadOptions::default()).expect("read");
    assert_eq!((scene.capture, scene.near), (Capture::Photos, None));
    let shown = |views: &[View]| views.iter().map(|v| (v.name.clone(), v.time)).collect::<Vec<_>>();
    assert_eq!(shown(&scene.train), [("2clutter002".to_owned(), 0.2), ("2clutter010".to_owned(), 1.0)]);
    assert_eq!(shown(&scene.test), [("1extra000".to_owned(), 0.0), ("1extra005".to_owned(), 0.5)]);
    assert_eq!(scene.train[0].image.rgb().expect("photo").get_pixel(5, 5).0, [30, 5, 9]);
    assert_eq!(scene.points.positions, [Vec3::new(1.0, 2.0, 3.0), Vec3::new(-4.5, 0.125, 6.0)]);
    assert_eq!(scene.points.colours, [Vec3::new(1.0, 0.0, 0.2), Vec3::new(0.0, 0.4, 1.0)]);
    let camera = scene.train[0].camera;
    assert_eq!((camera.width, camera.height, camera.fx, camera.fy), (48, 32, 40.0, 42.0));
    assert_eq!(camera.centre(), DVec3::new(-3.0, 0.0, 0.0));
    assert_eq!(camera.project(DVec3::new(-1.0, 1.0, 2.0)), Some(DVec2::new(63.0, 38.5)));
}

#[test]
fn quaternions_are_w_x_y_z_and_lead_from_the_world_to_the_camera() {
    let fixture = Fixture::new(&NAMES);
    let mut sample = Sample::new(&NAMES);
    // A quarter turn about y that maps the world's z to the camera's x, with twice the norm of a unit quaternion.
    sample.images[0].quaternion = [2f64.sqrt(), 0.0, 2f64.sqrt(), 0.0];
    sample.images[0].translation = [0.0, 0.0, 5.0];
    fixture.write_binary(&sample);
    let camera = fixture.read().expect("read").train[1].camera;
    /// Rounding tolerance for a few products of numbers near one.
    const ROUNDING: f64 = 1e-12;
    assert!((camera.to_camera(DVec3::new(0.0, 1.0, 2.0)) - DVec3::new(2.0, 1.0, 5.0)).length() < ROUNDING);
    assert!((camera.centre() - DVec3::new(5.0, 0.0, 0.0)).length() < ROUNDING);
}

#[test]
fn binary_and_text_agree_and_binary_comes_first() {
    let fixture = Fixture::new(&NAMES);
    let mut sample = Sample::new(&NAMES);
    sample.images[1].quaternion = [0.3, -0.1, 0.7, 0.2];
    sample.points.push(([1e-7, 1.0 / 3.0, -1e9], [1, 2, 3]));
    fixture.write_binary(&sample);
    let binary = content(&fixture.read().expect("read"));
    fixture.remove_model();
    fixture.write_text(&sample);
    assert_eq!(content(&fixture.read().expect("read")), binary);
    fixture.write("sparse/0/images.txt", sample.images_text().replace('\n', "\r\n"));
    assert_eq!(content(&fixture.read().expect("read")), binary);
    fixture.write("sparse/0/images.txt", sample.images_text().replace(' ', "\t"));
    assert_eq!(content(&fixture.read().expect("read")), binary);
    fixture.write_binary(&Sample::new(&NAMES));
    assert_ne!(content(&fixture.read().expect("read")), binary);
}

#[test]
fn a_model_may_lie_in_sparse_itself() {
    let fixture = Fixture::new(&NAMES);
    let expected = content(&fixture.read().expect("read"));
    for file in ["cameras.bin", "images.bin", "points3D.bin"] {
        fs::rename(fixture.at(&format!("sparse/0/{file}")), fixture.at(&format!("sparse/{file}"))).expect("moved");
    }
    assert_eq!(content(&fixture.read().expect("read")), expected);
}

#[test]
fn photos_without_telling_names_follow_the_rule_of_llff() {
    let names = ["c 1.png", "day/b.png", "a.png", "d.x.png"];
    let fixture = Fixture::new(&names);
    let scene = read(fixture.0.path(), &ReadOptions { test_every: 3, ..Default::default() }).expect("read");
    let shown = |views: &[View]| views.iter().map(|v| (v.name.clone(), v.time)).collect::<Vec<_>>();
    assert_eq!(shown(&scene.test), [("a".to_owned(), 0.0), ("day/b".to_owned(), 0.75)]);
    assert_eq!(shown(&scene.train), [("c 1".to_owned(), 0.25), ("d.x".to_owned(), 0.5)]);
    let expected = content(&fixture.read().expect("read"));
    fixture.remove_model();
    fixture.write_text(&Sample::new(&names));
    assert_eq!(content(&fixture.read().expect("read")), expected);
    let all = ReadOptions { test_every: 1, ..Default::default() };
    assert_says(&read(fixture.0.path(), &all).expect_err("refused").to_string(), &["test_every = 1"]);
}

#[test]
fn photos_are_reduced_and_their_cameras_with_them() {
    let fixture = Fixture::new(&NAMES);
    let scene = read(fixture.0.path(), &ReadOptions { downscale: 2.0, ..Default::default() }).expect("read");
    let camera = scene.train[0].camera;
    assert_eq!((camera.width, camera.height, camera.fx, camera.fy), (24, 16, 20.0, 21.0));
    assert_eq!((camera.cx, camera.cy), (11.5, 8.75));
    assert_eq!(scene.train[0].image.rgb().expect("photo").dimensions(), (24, 16));
    for (downscale, part) in [(0.5, "1 or more"), (f64::NAN, "1 or more"), (3.0, "16x11")] {
        let options = ReadOptions { downscale, ..Default::default() };
        assert_says(&read(fixture.0.path(), &options).expect_err("refused").to_string(), &["downscale", part]);
    }
}

#[test]
fn photos_on_disk_may_be_reduced_already() {
    let fixture = Fixture::new(&NAMES);
    let mut sample = Sample::new(&NAMES);
    sample.cameras[0].size = (96, 64);
    fixture.write_binary(&sample);
    let camera = fixture.read().expect("read").train[0].camera;
    assert_eq!((camera.width, camera.height), (48, 32));
    assert_eq!((camera.fx, camera.fy, camera.cx, camera.cy), (20.0, 21.0, 11.5, 8.75));
    sample.cameras[0].size = (96, 62);
    fixture.write_binary(&sample);
    assert_says(&fixture.complaint(), &["48 x 32", "96 x 62", "one factor"]);
}

#[test]
fn photos_of_several_sizes_are_refused() {
    let fixture = Fixture::new(&NAMES);
    fixture.write_photo("images/2clutter010.png", (96, 64), [1, 2, 3]);
    assert_says(&fixture.complaint(), &["48 x 32", "96 x 64", "2clutter010.png", "one size"]);
    fixture.write("images/2clutter010.png", "torn");
    assert_says(&fixture.complaint(), &["cannot read the image", "2clutter010.png"]);
}

#[test]
fn folders_that_are_no_collection_are_refused() {
    let error = read(Path::new("no/such/scene"), &ReadOptions::default()).expect_err("missing").to_string();
    assert_says(&error, &["no/such/scene"]);
    let fixture = Fixture(tempfile::tempdir().expect("folder"));
    assert_says(&fixture.complaint(), &["COLMAP scene", "images is not there"]);
    fs::create_dir(fixture.at("images")).expect("folder");
    assert_says(&fixture.complaint(), &["COLMAP scene", "sparse is not there"]);
    fs::create_dir(fixture.at("sparse")).expect("folder");
    assert_eq!(recognise(fixture.0.path()), None);
    assert_says(&fixture.complaint(), &["no model with cameras.bin or cameras.txt", "sparse/0"]);
}

#[test]
fn a_folder_of_two_formats_is_a_photo_collection() {
    let fixture = Fixture::new(&NAMES);
    fixture.write("poses_bounds.npy", "not looked at");
    assert_eq!(open(fixture.0.path(), &ReadOptions::default()).expect("read").capture, Capture::Photos);
}

#[test]
fn missing_files_are_named() {
    let fixture = Fixture::new(&NAMES);
    fs::remove_file(fixture.at("images/0clean003.png")).expect("removed");
    fixture.read().expect("clean photos are not used");
    fs::remove_file(fixture.at("images/1extra005.png")).expect("removed");
    fs::remove_file(fixture.at("images/2clutter002.png")).expect("removed");
    assert_says(&fixture.complaint(), &["no image images/2clutter002.png in", "2 of 4 images"]);
    for part in ["images.bin", "points3D.bin"] {
        let fixture = Fixture::new(&NAMES);
        fixture.write_text(&Sample::new(&NAMES));
        fs::remove_file(fixture.at(&format!("sparse/0/{part}"))).expect("removed");
        assert_says(&fixture.complaint(), &[&format!("no {part} in"), "three files"]);
    }
}

#[test]
fn cameras_that_are_none_are_refused() {
    let fixture = Fixture::new(&NAMES);
    for (place, value) in [(0, 0.0), (1, f64::NAN), (2, f64::INFINITY)] {
        for message in fixture.complaints(|sample| sample.cameras[0].parameters[place] = value) {
            assert_says(&message, &["cameras.", "camera 3", "finite"]);
        }
    }
    for message in fixture.complaints(|sample| sample.cameras.push(sample.cameras[0].clone())) {
        assert_says(&message, &["the camera 3 twice"]);
    }
}

#[test]
fn images_without_pose_or_camera_are_refused() {
    let fixture = Fixture::new(&NAMES);
    for message in fixture.complaints(|sample| sample.images[1].quaternion[2] = f64::NAN) {
        assert_says(&message, &["images.", "1extra005.png", "no pose", "NaN"]);
    }
    for message in fixture.complaints(|sample| sample.images[1].quaternion = [0.0; 4]) {
        assert_says(&message, &["images.", "1extra005.png", "no pose"]);
    }
    for message in fixture.complaints(|sample| sample.images[1].translation[0] = f64::INFINITY) {
        assert_says(&message, &["images.", "1extra005.png", "no pose", "inf"]);
    }
    for message in fixture.complaints(|sample| sample.images[1].camera = 8) {
        assert_says(&message, &["images.", "1extra005.png", "camera 8"]);
    }
    for message in fixture.complaints(|sample| sample.points[1].0[1] = f64::NAN) {
        assert_says(&message, &["points3D.", "NaN"]);
    }
    for message in fixture.complaints(|sample| sample.images.clear()) {
        assert_says(&message, &["no photo to train on", "0 photos"]);
    }
}

#[test]
fn names_must_be_unique_and_stay_in_the_folder() {
    let fixture = Fixture::new(&NAMES);
    for message in fixture.complaints(|sample| sample.images[1].name = "2clutter010.png".into()) {
        assert_says(&message, &["images.", "2clutter010.png twice"]);
    }
    for message in fixture.complaints(|sample| sample.images[1].name = "2clutter010.jpg".into()) {
        assert_says(&message, &["images.", "2clutter010.jpg", "2clutter010.png", "extensions"]);
    }
    for name in ["../2clutter001.png", "day/../../2clutter001.png", "/2clutter001.png", "./2clutter001.png", "", ".."] {
        for message in fixture.complaints(|sample| sample.images[1].name = name.into()) {
            assert_says(&message, &["images.", &format!("`{name}`"), "`..`"]);
        }
    }
}

#[test]
fn a_model_without_points_is_allowed() {
    let fixture = Fixture::new(&NAMES);
    fixture.write_binary(&Sample { points: Vec::new(), ..Sample::new(&NAMES) });
    assert!(fixture.read().expect("read").points.is_empty());
}
