//! Sound scenes pass, and every damage is refused with its place and a remedy.

use std::sync::{Arc, LazyLock};

use glam::{DMat3, DVec3, Vec3};
use image::RgbImage;

use super::*;
use crate::builtin::{BuiltinKind, BuiltinOptions, builtin};
use crate::scene::Mask;

const SIZE: (u32, u32) = (24, 16);

fn sound(kind: BuiltinKind) -> Scene {
    let (width, height) = (SIZE.0 as usize, SIZE.1 as usize);
    builtin(&BuiltinOptions { kind, width, height, frames: 2, photos: 4, test_photos: 2, ..Default::default() })
}

fn video() -> Scene {
    static VIDEO: LazyLock<Scene> = LazyLock::new(|| sound(BuiltinKind::Video));
    VIDEO.clone()
}

/// A damaged scene must be refused in words that name it and contain all `parts`.
fn refused(damage: impl FnOnce(&mut Scene), parts: &[&str]) {
    let mut scene = video();
    damage(&mut scene);
    let error = scene.check().expect_err("damaged");
    let said = error.to_string();
    assert!(
        matches!(error, DataError::Scene { .. }) && said.contains("the scene built-in video cannot be used"),
        "{said}"
    );
    parts.iter().for_each(|part| assert!(said.contains(part), "`{part}` is missing: {said}"));
}

fn blank(width: u32, height: u32) -> Picture {
    Picture::Memory(Arc::new(RgbImage::new(width, height)))
}

/// Gives a view another size.
fn resize(view: &mut View, (width, height): (u32, u32)) {
    view.camera = view.camera.resized(width as usize, height as usize);
    view.image = blank(width, height);
    view.truth = Truth::default();
}

#[test]
fn built_in_scenes_pass() {
    for kind in BuiltinKind::ALL {
        sound(kind).check().expect("sound");
    }
}

#[test]
fn scenes_without_points_or_held_out_views_and_views_in_files_that_are_not_there_pass() {
    let mut scene = video();
    (scene.points, scene.test) = (PointCloud::default(), Vec::new());
    scene.train[3].image = Picture::file("absent.png".into(), SIZE);
    scene.check().expect("nothing is decoded");
}

#[test]
fn held_out_views_may_have_a_size_of_their_own_and_the_names_of_training_views() {
    let mut scene = video();
    resize(&mut scene.test[1], (32, 20));
    scene.test[1].name = scene.train[0].name.clone();
    scene.check().expect("sound");
}

#[test]
fn times_outside_0_to_1_are_refused() {
    for (time, shown) in [(f64::NAN, "NaN"), (f64::INFINITY, "inf"), (-0.25, "-0.25"), (7.0, "7.0")] {
        let shown = format!("has the time {shown},");
        refused(|scene| scene.train[1].time = time, &["the training view `cam01/0001`", &shown, "number of moments"]);
    }
    refused(|scene| scene.test[0].time = 1.5, &["the held-out view `cam00/0000`"]);
}

#[test]
fn training_images_of_different_sizes_are_refused() {
    let parts = ["`cam02/0001` has 32 x 20 pixels, but `cam01/0000` has 24 x 16", "one size"];
    refused(|scene| resize(&mut scene.train[3], (32, 20)), &parts);
}

#[test]
fn whatever_has_another_size_than_its_camera_is_refused() {
    let parts = ["`cam01/0000`", "has an image of 16 x 24 pixels, but its camera is for 24 x 16", "Camera::resized"];
    refused(|scene| scene.train[0].image = blank(16, 24), &parts);
    refused(|scene| scene.train[0].image = Picture::file("absent.png".into(), (16, 24)), &parts);
    refused(|scene| scene.test[0].camera.width = 25, &["`cam00/0000`", "has an image", "is for 25 x 16"]);
    let mask = || Some(Mask { picture: blank(12, 8), inverted: false });
    refused(|scene| scene.train[0].mask = mask(), &["has a mask of 12 x 8 pixels"]);
    refused(|scene| scene.test[1].truth.background = Some(blank(1, 1)), &["`cam00/0001`", "a true background"]);
    refused(|scene| scene.test[1].truth.dynamic_mask = Some(blank(1, 1)), &["a true mask of what moves"]);
    refused(|scene| scene.test[1].truth.movers_mask = Some(blank(1, 1)), &["a true mask of movers"]);
    refused(|scene| scene.test[1].truth.depth = Some(Arc::new(vec![1.0; 7])), &["has 7 true depths"]);
}

#[test]
fn cameras_with_numbers_that_cannot_be_used_are_refused() {
    fn camera(change: fn(&mut Camera), parts: &[&str]) {
        refused(|scene| change(&mut scene.train[2].camera), parts);
        refused(|scene| change(&mut scene.test[1].camera), &["the held-out view `cam00/0001` has a camera"]);
    }
    camera(|camera| camera.fx = f64::NAN, &["NaN in its fx"]);
    camera(|camera| camera.cy = f64::NEG_INFINITY, &["-inf in its cy"]);
    camera(|camera| camera.rotation.y_axis.x = f64::NAN, &["NaN in its rotation"]);
    camera(|camera| camera.translation.z = f64::INFINITY, &["inf in its translation", "leave the view out"]);
    camera(|camera| camera.fy = -60.0, &["-60.0", "too large or too small"]);
    camera(|camera| camera.translation = DVec3::new(1e12, 0.0, 0.0), &["up to 1e9"]);
    camera(|camera| camera.rotation = -camera.rotation, &["no rotation", "not mirrored"]);
    camera(|camera| camera.rotation = DMat3::ZERO, &["no rotation"]);
    camera(|camera| camera.height = 0, &["a camera of 24 x 0 pixels"]);
}

#[test]
fn points_without_a_colour_or_a_place_are_refused() {
    refused(|scene| scene.points.colours.truncate(7), &["positions and 7 colours", "PointCloud::push"]);
    refused(|scene| scene.points.positions[5].y = f32::NAN, &["its point 5 (from 0) is at", "at most 1e9"]);
    refused(|scene| scene.points.positions[0].x = 2e9, &["its point 0 (from 0) is at", "scale the scene"]);
    refused(|scene| scene.points.colours[2] = Vec3::splat(f32::INFINITY), &["its point 2 (from 0) has the colour"]);
}

#[test]
fn views_of_one_name_are_refused() {
    let parts = ["two training views have the name `cam01/0000`", "a name of its own"];
    refused(|scene| scene.train[9].name = scene.train[0].name.clone(), &parts);
    refused(
        |scene| scene.test[1].name = scene.test[0].name.clone(),
        &["two held-out views have the name `cam00/0000`"],
    );
}
