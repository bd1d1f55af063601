//! A scene from arrays in memory: cameras, times and pictures that no reader has seen.
//!
//! `cargo run -p mvfusion-model --example own_dataset`
#![allow(clippy::print_stdout, reason = "an example shows what it found")]

use std::sync::Arc;

use glam::{DMat3, DVec3, Vec3};
use image::{Rgb, RgbImage};
use mvfusion_data::{Camera, Capture, Picture, PointCloud, Scene, Truth, View};
use mvfusion_model::config::{Config, TrainConfig};
use mvfusion_model::train::Trainer;
use mvfusion_model::{ModelError, device};

const CAMERAS: usize = 5;
const FRAMES: usize = 6;

/// Where the ball of this scene is at a time in `[0, 1]`, world units.
fn ball(time: f64) -> DVec3 {
    DVec3::new(2.0 * time - 1.0, 0.0, 4.0)
}

/// What a camera sees: a red ball before a wall of green and blue. Your own arrays stand here.
fn picture(camera: &Camera, time: f64) -> RgbImage {
    let centre = camera.project(ball(time)).unwrap_or_default();
    let radius = 0.4 * camera.fx / 4.0;
    RgbImage::from_fn(camera.width as u32, camera.height as u32, |x, y| {
        let pixel = glam::dvec2(f64::from(x) + 0.5, f64::from(y) + 0.5);
        match pixel.distance(centre) < radius {
            true => Rgb([220, 40, 30]),
            false => Rgb([20, (60 + 2 * x) as u8, (80 + 2 * y) as u8]),
        }
    })
}

fn view(number: usize, frame: usize) -> View {
    // Side by side, looking along +z with x right and y down (OpenCV). The rotation is that from camera to world.
    let position = DVec3::new(number as f64 - (CAMERAS - 1) as f64 / 2.0, 0.0, 0.0) * 0.4;
    let camera = Camera::centred(64, 48, 60.0, DMat3::IDENTITY, position);
    let time = frame as f64 / FRAMES as f64;
    View {
        name: format!("cam{number:02}/{frame:04}"),
        camera,
        time,
        image: Picture::Memory(Arc::new(picture(&camera, time))),
        mask: None,
        truth: Truth::default(),
    }
}

fn main() -> Result<(), ModelError> {
    let film = |number: usize| (0..FRAMES).map(move |frame| view(number, frame));
    // Points to start from: a wall behind the ball.
    let mut points = PointCloud::default();
    for index in 0..400_u16 {
        let (row, column) = (f32::from(index / 20), f32::from(index % 20));
        points.push(Vec3::new(column / 4.0 - 2.5, row / 5.0 - 2.0, 6.0), Vec3::splat(0.5));
    }
    let held_out = CAMERAS / 2;
    let scene = Scene {
        name: "a ball before a wall".into(),
        capture: Capture::Video,
        train: (0..CAMERAS).filter(|&number| number != held_out).flat_map(film).collect(),
        test: film(held_out).collect(),
        points,
        near: None,
    };
    let train = TrainConfig { scale: 0.002, ..TrainConfig::default() };
    let config = Config { seed: 1, train, ..Config::default() }.scaled();
    let mut trainer = Trainer::new(config, &scene, &device::flex())?;
    while trainer.step()?.is_some() {}
    println!("{} dynamic Gaussians after {} steps", trainer.state().model.dynamic.count(), trainer.state().completed);
    Ok(())
}
