//! A tiny scene in a temporary folder, intact and with the usual kinds of damage.

mod frames;

use std::fs;
use std::path::PathBuf;

use glam::DVec3;
use image::{Rgb, RgbImage};
use npyz::WriterBuilder;
use tempfile::TempDir;

use super::*;
use crate::inspect::{Pictures, inspect};
use crate::readers::{TimeRule, attach_masks, open};

const CAMERAS: [&str; 3] = ["cam00", "cam02", "cam05"];
const FRAMES: usize = 4;
const SIZE: (u32, u32) = (48, 32);
const PLY: &str = "ply\nformat ascii 1.0\nelement vertex 2\nproperty float x\nproperty float y\nproperty float z\n\
    property uchar red\nproperty uchar green\nproperty uchar blue\nend_header\n1 2 3 255 0 0\n4 5 6 0 255 0\n";

/// A folder with an intact scene.
struct Fixture(TempDir);

impl Fixture {
    fn new() -> Self {
        let fixture = Self(tempfile::tempdir().expect("folder"));
        fixture.write_poses(&rows());
        for (number, camera) in CAMERAS.iter().enumerate() {
            fs::create_dir_all(fixture.at(&format!("{camera}/images"))).expect("folder");
            for frame in 0..FRAMES {
                fixture.write_frame(
                    &format!("{camera}/images/{frame:04}.png"),
                    SIZE,
                    [10 * number as u8, frame as u8, 9],
                );
            }
        }
        fs::write(fixture.at("points3D.ply"), PLY).expect("written");
        fixture
    }

    fn at(&self, name: &str) -> PathBuf {
        self.0.path().join(name)
    }

    fn write_frame(&self, name: &str, (width, height): (u32, u32), colour: [u8; 3]) {
        RgbImage::from_pixel(width, height, Rgb(colour)).save(self.at(name)).expect("written");
    }

    fn write_poses(&self, rows: &[[f64; ROW]]) {
        self.write_array(&[rows.len() as u64, ROW as u64], rows.concat());
    }

    fn write_array<T: npyz::AutoSerialize>(&self, shape: &[u64], values: Vec<T>) {
        let file = fs::File::create(self.at(POSES)).expect("file");
        let mut writer = npyz::WriteOptions::new().default_dtype().shape(shape).writer(file).begin_nd().expect("npy");
        writer.extend(values).expect("written");
        writer.finish().expect("written");
    }

    fn read(&self) -> Result<Scene, DataError> {
        read(self.0.path(), &ReadOptions::default())
    }

    fn read_with(&self, options: ReadOptions) -> Result<Scene, DataError> {
        read(self.0.path(), &options)
    }

    /// The message of the error, which must occur.
    fn complaint(&self) -> String {
        let error = self.read().expect_err("the scene is damaged");
        let message = error.to_string();
        assert!(message.contains(self.0.path().to_str().expect("utf-8")), "the place is missing: {message}");
        message
    }
}

/// Cameras in a row along x that look along +y; calibrated at twice the size of the frames.
fn rows() -> Vec<[f64; ROW]> {
    let row = |x: f64| {
        let (down, right, backward) = (DVec3::NEG_Z, DVec3::X, DVec3::NEG_Y);
        let columns = [down, right, backward, DVec3::new(x, -4.0, 1.0), DVec3::new(64.0, 96.0, 80.0)];
        let mut row = [0.0; ROW];
        (0..15).for_each(|i| row[i] = columns[i % 5][i / 5]);
        (row[15], row[16]) = (0.5, 20.0);
        row
    };
    [0.0, 1.0, -1.0].map(row).to_vec()
}

fn assert_says(message: &str, parts: &[&str]) {
    parts.iter().for_each(|part| assert!(message.contains(part), "`{part}` is missing: {message}"));
}

#[test]
fn a_whole_scene_is_read() {
    let fixture = Fixture::new();
    let scene = open(fixture.0.path(), &ReadOptions::default()).expect("read");
    assert_eq!((scene.capture, scene.train.len(), scene.test.len()), (Capture::Video, 2 * FRAMES, FRAMES));
    assert_eq!((scene.test[1].name.as_str(), scene.test[1].time), ("cam00/0001", 0.25));
    assert_eq!(scene.train[FRAMES + 3].name, "cam05/0003");
    assert_eq!(scene.points.positions[1], glam::Vec3::new(4.0, 5.0, 6.0));
    assert_eq!(scene.train[2].image.rgb().expect("frame").get_pixel(5, 5).0, [10, 2, 9]);
    let camera = scene.train[0].camera;
    assert_eq!((camera.width, camera.height, camera.fx, camera.fy), (48, 32, 40.0, 40.0));
    assert_eq!(camera.centre(), DVec3::new(1.0, -4.0, 1.0));
    assert_eq!(camera.project(DVec3::new(1.5, 0.0, 1.5)), Some(glam::DVec2::new(29.0, 11.0)));
    assert_eq!(scene.extent(), 1.1);
}

#[test]
fn options_shrink_the_pictures_and_choose_frames_and_times() {
    let fixture = Fixture::new();
    let options = ReadOptions { downscale: 2.0, frames: Some(2), time: TimeRule::FrameOver300, ..Default::default() };
    let scene = fixture.read_with(options).expect("read");
    assert_eq!((scene.train.len(), scene.test[1].time), (4, 1.0 / 300.0));
    let camera = scene.test[0].camera;
    assert_eq!((camera.width, camera.height, camera.fx, camera.cx, camera.cy), (24, 16, 20.0, 12.0, 8.0));
    assert_eq!(scene.test[0].image.rgb().expect("frame").dimensions(), (24, 16));
}

#[test]
fn frames_of_another_shape_than_the_cameras_are_a_problem_with_a_remedy() {
    let fixture = Fixture::new();
    let shapes = || {
        let (inspection, _) = inspect(fixture.0.path(), &ReadOptions::default(), Pictures::Headers);
        inspection.problems.into_iter().filter(|problem| problem.what.contains("another shape")).collect::<Vec<_>>()
    };
    assert!(shapes().is_empty());
    let wide = rows().into_iter().map(|mut row| {
        row[9] *= 1.5;
        row
    });
    fixture.write_poses(&wide.collect::<Vec<_>>());
    let [problem] = &shapes()[..] else { panic!("one problem") };
    assert_says(&problem.what, &["48x32", "144x64"]);
    assert!(problem.remedy.contains("cropping"), "{problem:?}");
}

#[test]
fn single_precision_and_column_major_poses_are_read() {
    let fixture = Fixture::new();
    fixture.write_array(&[3, 17], rows().concat().iter().map(|&v| v as f32).collect::<Vec<f32>>());
    let expected: Vec<Camera> = fixture.read().expect("read").train.iter().map(|v| v.camera).collect();
    let file = fs::File::create(fixture.at(POSES)).expect("file");
    let options = npyz::WriteOptions::new().default_dtype().order(npyz::Order::Fortran).shape(&[3, 17]);
    let mut writer = options.writer(file).begin_nd().expect("npy");
    (0..ROW).for_each(|column| writer.extend(rows().iter().map(|row| row[column])).expect("written"));
    writer.finish().expect("written");
    assert_eq!(fixture.read().expect("read").train.iter().map(|v| v.camera).collect::<Vec<_>>(), expected);
}

#[test]
fn a_missing_point_cloud_is_allowed_and_fused_ply_comes_first() {
    let fixture = Fixture::new();
    fs::write(fixture.at("fused.ply"), PLY.replace("1 2 3", "7 8 9")).expect("written");
    assert_eq!(fixture.read().expect("read").points.positions[0], glam::Vec3::new(7.0, 8.0, 9.0));
    fs::remove_file(fixture.at("fused.ply")).expect("removed");
    fs::remove_file(fixture.at("points3D.ply")).expect("removed");
    assert!(fixture.read().expect("read").points.is_empty());
}

#[test]
fn folders_that_are_no_scene_are_refused() {
    let error = read(Path::new("no/such/scene"), &ReadOptions::default()).expect_err("missing").to_string();
    assert_says(&error, &["no/such/scene"]);
    let empty = Fixture(tempfile::tempdir().expect("folder"));
    assert_says(&empty.complaint(), &["Neu3D", POSES, "cam00/images"]);
}

#[test]
fn bad_poses_are_refused() {
    let fixture = Fixture::new();
    fixture.write_poses(&rows()[..2]);
    assert_says(&fixture.complaint(), &["2 rows", "3 cameras"]);
    fixture.write_array(&[3, 16], vec![1.0; 48]);
    assert_says(&fixture.complaint(), &[POSES, "[3, 16]", "17"]);
    fixture.write_array(&[51], vec![1.0; 51]);
    assert_says(&fixture.complaint(), &[POSES, "[51]"]);
    fixture.write_array(&[3, 17], vec![1i64; 51]);
    assert_says(&fixture.complaint(), &[POSES, "<i8", "float64"]);
    let mut damaged = rows();
    damaged[1][7] = f64::NAN;
    fixture.write_poses(&damaged);
    assert_says(&fixture.complaint(), &[POSES, "row 1", "NaN", "column 7"]);
    damaged[1][7] = f64::INFINITY;
    fixture.write_poses(&damaged);
    assert_says(&fixture.complaint(), &["row 1", "inf"]);
    fs::write(fixture.at(POSES), b"\x93NUMPY").expect("written");
    assert_says(&fixture.complaint(), &[POSES]);
    fixture.write_poses(&rows());
    let bytes = fs::read(fixture.at(POSES)).expect("read");
    fs::write(fixture.at(POSES), &bytes[..bytes.len() - 9]).expect("written");
    assert_says(&fixture.complaint(), &[POSES]);
    fs::remove_file(fixture.at(POSES)).expect("removed");
    assert_says(&fixture.complaint(), &["no poses_bounds.npy"]);
}

#[test]
fn the_near_bound_is_the_least_of_the_training_cameras_if_all_have_one() {
    let fixture = Fixture::new();
    let mut rows = rows();
    for (row, near) in rows.iter_mut().zip([0.5, 2.0, 1.5]) {
        row[15] = near;
    }
    fixture.write_poses(&rows);
    assert_eq!(fixture.read().expect("read").near, Some(1.5));
    // If another camera is held out, the first one trains.
    let other = ReadOptions { test_cameras: Some(vec!["cam05".into()]), ..Default::default() };
    assert_eq!(open(fixture.0.path(), &other).expect("read").near, Some(0.5));
    rows[1][15] = 0.0;
    fixture.write_poses(&rows);
    assert_eq!(fixture.read().expect("read").near, None);
}

#[test]
fn a_single_camera_is_refused() {
    let fixture = Fixture::new();
    CAMERAS[1..].iter().for_each(|c| fs::remove_dir_all(fixture.at(c)).expect("removed"));
    fixture.write_poses(&rows()[..1]);
    assert_says(&fixture.complaint(), &["second camera"]);
}

#[test]
fn a_malformed_point_cloud_is_refused() {
    let fixture = Fixture::new();
    fs::write(fixture.at("points3D.ply"), PLY.replace("4 5 6 0 255 0\n", "")).expect("written");
    assert_says(&fixture.complaint(), &["points3D.ply"]);
    fs::write(fixture.at("points3D.ply"), PLY.replace("1 2 3", "1 nan 3")).expect("written");
    assert_says(&fixture.complaint(), &["points3D.ply", "vertex 0"]);
}

#[test]
fn senseless_options_are_refused() {
    let fixture = Fixture::new();
    for (downscale, part) in [(0.5, "1 or more"), (f64::NAN, "1 or more"), (3.0, "16x11")] {
        let error = fixture.read_with(ReadOptions { downscale, ..Default::default() }).expect_err("refused");
        assert!(matches!(error, DataError::Setting { option: "downscale", .. }));
        assert_says(&error.to_string(), &["downscale", part]);
    }
    let none = ReadOptions { frames: Some(0), ..Default::default() };
    assert_says(&fixture.read_with(none).expect_err("refused").to_string(), &["frames = 0"]);
}

#[test]
fn masks_are_found_by_the_names_of_the_views() {
    let fixture = Fixture::new();
    let mut scene = fixture.read().expect("read");
    let masks = fixture.at("masks");
    assert!(matches!(attach_masks(&mut scene, &masks), Err(DataError::Folder { .. })));
    fs::create_dir_all(masks.join("cam00")).expect("folder");
    let error = attach_masks(&mut scene, &masks).expect_err("no mask").to_string();
    assert_says(&error, &["masks", "cam02/0000.png"]);
    fixture.write_frame("masks/cam00/0001.png", (24, 16), [255; 3]);
    fixture.write_frame("masks/cam00/0002.png", SIZE, [0; 3]);
    assert_eq!(attach_masks(&mut scene, &masks).expect("attached"), 2);
    let mask = scene.test[1].truth.dynamic_mask.as_ref().expect("attached").mask().expect("mask");
    assert_eq!((mask.dimensions(), mask.get_pixel(40, 20).0), (SIZE, [255]));
    assert!(scene.test[0].truth.dynamic_mask.is_none());
    fs::write(masks.join("cam00/0003.png"), b"torn").expect("written");
    assert!(matches!(attach_masks(&mut scene, &masks), Err(DataError::Image { .. })));
}
