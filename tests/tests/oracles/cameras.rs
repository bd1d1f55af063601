//! `cameras_neu3d`: rows of `poses_bounds.npy` as cameras, alone and through the reader.

use std::fs::{self, File};
use std::path::Path;

use anyhow::{Context, Result};
use burn::tensor::Device;
use glam::{DMat3, DVec3};
use mvfusion_data::readers::neu3d::{ROW, camera_from_row};
use mvfusion_data::{Camera, ReadOptions, Scene, TimeRule};
use mvfusion_tests::{Array, Checklist, Tolerance};
use npyz::WriterBuilder;

use crate::archive::Archive;

/// From the README of the oracle.
const EXACT: Tolerance = Tolerance::of_largest(1e-6);

/// From the README, for what the original computes in single precision.
const SINGLE: Tolerance = Tolerance::of_largest(1e-5);

/// Size of the pictures that the file's focal length is for.
const SIZE: [usize; 2] = [1352, 1014];

/// A black picture of that size, one bit a pixel. The reader looks at no more than its size.
const FRAME: &[u8] = include_bytes!("../../oracles/frame_1352x1014.png");

/// Outputs that are not compared.
pub const LEFT_OUT: &[(&str, &str)] = &[
    ("out.projection", "our cameras project by focal lengths, not by a clip matrix"),
    ("out.spiral_c2w", "camera paths come with rendering of videos"),
];

/// The cameras of a file. It knows no device.
pub fn check(archive: &Archive, _device: &Device) -> Result<()> {
    let rows = archive.array("in.poses_bounds")?;
    let cameras: Vec<Camera> = rows
        .values
        .chunks_exact(ROW)
        .map(|row| camera_from_row(&std::array::from_fn(|i| row[i]), SIZE[0], SIZE[1]))
        .collect();
    let mut checks = Checklist::default();
    compare_cameras(&mut checks, archive, &cameras)?;

    let folder = tempfile::tempdir()?;
    let frames = archive.array("out.times")?.values.len();
    let scene = read_back(folder.path(), rows, frames)?;
    compare_scene(&mut checks, archive, &scene)?;
    let read: Vec<Camera> = scene.test.iter().chain(&scene.train).step_by(frames).map(|view| view.camera).collect();
    compare_cameras(&mut checks, archive, &read)?;
    checks.finish()
}

fn compare_cameras(checks: &mut Checklist, archive: &Archive, cameras: &[Camera]) -> Result<()> {
    let count = cameras.len();
    // Ours is world to camera; the file's rotation is its inverse.
    let rotations = cameras.iter().flat_map(|camera| row_major(camera.rotation.transpose())).collect();
    checks.close("R", archive.array("out.R")?, &Array::new([count, 3, 3], rotations), EXACT);
    let vectors = |of: &dyn Fn(&Camera) -> DVec3| {
        Array::new([count, 3], cameras.iter().flat_map(|camera| of(camera).to_array()).collect())
    };
    checks.close("T", archive.array("out.T")?, &vectors(&|camera| camera.translation), EXACT);
    let centres = vectors(&|camera| camera.centre());
    checks.close("camera_center_f64", archive.array("out.camera_center_f64")?, &centres, EXACT);
    checks.close("camera_center_f32", archive.array("out.camera_center_f32")?, &centres, SINGLE);
    let views = cameras.iter().flat_map(world_to_camera).collect();
    checks.close("world_view_f32", archive.array("out.world_view_f32")?, &Array::new([count, 4, 4], views), SINGLE);

    let first = cameras.first().context("there is no camera")?;
    let view_angles = first.field_of_view();
    checks.close_number("focal", archive.number("out.focal")?, first.fx, EXACT);
    checks.close_number("focal along y", archive.number("out.focal")?, first.fy, EXACT);
    checks.close_number("FoVx", archive.number("out.FoVx")?, view_angles.x, EXACT);
    checks.close_number("FoVy", archive.number("out.FoVy")?, view_angles.y, EXACT);
    Ok(())
}

fn compare_scene(checks: &mut Checklist, archive: &Archive, scene: &Scene) -> Result<()> {
    checks.same("n_train", &[archive.count("out.n_train")?], &[scene.train.len()]);
    checks.same("n_test", &[archive.count("out.n_test")?], &[scene.test.len()]);
    let times = Array::list(scene.test.iter().map(|view| view.time).collect());
    checks.close("times", archive.array("out.times")?, &times, EXACT);
    checks.close_number("radius", archive.number("out.nerfpp_radius_f64")?, scene.extent(), EXACT);
    checks.close_number("radius in f32", archive.number("out.nerfpp_radius")?, scene.extent(), SINGLE);
    let translation = Array::list((-scene.training_centre()).to_array().to_vec());
    checks.close("translate", archive.array("out.nerfpp_translate")?, &translation, SINGLE);
    Ok(())
}

/// Writes a scene with these rows in the layout of Neu3D, and reads it.
fn read_back(folder: &Path, rows: &Array, frames: usize) -> Result<Scene> {
    for camera in 0..rows.shape[0] {
        let images = folder.join(format!("cam{camera:02}/images"));
        fs::create_dir_all(&images)?;
        for frame in 0..frames {
            fs::write(images.join(format!("{frame:04}.png")), FRAME)?;
        }
    }
    let shape: Vec<u64> = rows.shape.iter().map(|&length| length as u64).collect();
    let mut writer = npyz::WriteOptions::new()
        .default_dtype()
        .shape(&shape)
        .writer(File::create(folder.join("poses_bounds.npy"))?)
        .begin_nd()?;
    writer.extend(rows.values.iter())?;
    writer.finish()?;
    let options = ReadOptions { time: TimeRule::FrameOver300, ..ReadOptions::default() };
    Ok(mvfusion_data::open(folder, &options)?)
}

fn row_major(matrix: DMat3) -> [f64; 9] {
    matrix.transpose().to_cols_array()
}

/// The 4x4 matrix from world to camera, row by row.
fn world_to_camera(camera: &Camera) -> Vec<f64> {
    let rotation = row_major(camera.rotation);
    let row = |i: usize| [rotation[3 * i], rotation[3 * i + 1], rotation[3 * i + 2], camera.translation[i]];
    [row(0), row(1), row(2), [0.0, 0.0, 0.0, 1.0]].concat()
}
