//! A red ball that fifteen cameras and one more film: where it is seen, and where it must be.

use std::collections::BTreeMap;

use anyhow::Result;
use glam::{DMat3, DVec2, DVec3};
use image::RgbImage;
use mvfusion_data::{Scene, View};

/// Red enough to be the ball.
const LEAST_RED: f64 = 90.0;
/// How much redder than green or blue.
const REDDER: f64 = 1.9;
/// Pixels of the ball at least.
const LEAST_PIXELS: usize = 4;
/// Half the side of the square around the middle of all red that holds the ball, pixels.
const REACH: f64 = 7.0;
/// Share of the red that must be in it; else there is something else that is red.
const LEAST_SHARE: f64 = 0.7;
/// A detection farther than this from the ball is of something else, pixels.
const OUTLIER: f64 = 3.0;

/// What a camera saw of the ball.
struct Detection<'a> {
    view: &'a View,
    at: DVec2,
}

/// Distances in pixels between where the ball is seen and where it is by the other cameras, at all moments at which three or
/// more agree on it. Sightings of other red things count as well, so the median tells, not the mean.
pub fn distances(scene: &Scene) -> Result<Vec<f64>> {
    let mut moments: BTreeMap<u64, Vec<Detection<'_>>> = BTreeMap::new();
    for view in scene.train.iter().chain(&scene.test) {
        if let Some(at) = ball(view.image.rgb()?.as_ref()) {
            moments.entry(view.time.to_bits()).or_default().push(Detection { view, at });
        }
    }
    let mut distances = Vec::new();
    for detections in moments.values() {
        let Some(place) = agreed_place(detections) else { continue };
        distances.extend(detections.iter().filter_map(|detection| distance(detection, place)));
    }
    Ok(distances)
}

/// Middle of the red pixels, if they are together.
fn ball(image: &RgbImage) -> Option<DVec2> {
    let is_red = |pixel: &image::Rgb<u8>| {
        let [r, g, b] = pixel.0.map(f64::from);
        r > LEAST_RED && r > REDDER * g && r > REDDER * b
    };
    let red: Vec<DVec2> = image
        .enumerate_pixels()
        .filter(|(_, _, pixel)| is_red(pixel))
        .map(|(x, y, _)| DVec2::new(f64::from(x) + 0.5, f64::from(y) + 0.5))
        .collect();
    if red.len() < LEAST_PIXELS {
        return None;
    }
    let middle = |axis: usize| super::median(red.iter().map(|p| p[axis]).collect());
    let middle = DVec2::new(middle(0), middle(1));
    let near: Vec<&DVec2> = red.iter().filter(|p| (**p - middle).abs().max_element() < REACH).collect();
    let is_ball = near.len() >= LEAST_PIXELS && near.len() as f64 >= LEAST_SHARE * red.len() as f64;
    is_ball.then(|| near.iter().copied().sum::<DVec2>() / near.len() as f64)
}

/// The place on which most cameras agree, if there are three.
fn agreed_place(detections: &[Detection<'_>]) -> Option<DVec3> {
    let supporters = |place: DVec3| {
        let near = |s: &&Detection<'_>| distance(s, place).is_some_and(|distance| distance < OUTLIER);
        detections.iter().filter(near).collect::<Vec<_>>()
    };
    let pairs = (0..detections.len()).flat_map(|a| (0..a).map(move |b| [a, b]));
    let places = pairs.filter_map(|pair| triangulated(&pair.map(|index| &detections[index])));
    let best = places.map(supporters).max_by_key(Vec::len)?;
    if best.len() < 3 { None } else { triangulated(&best) }
}

fn distance(detection: &Detection<'_>, place: DVec3) -> Option<f64> {
    Some(detection.view.camera.project(place)?.distance(detection.at))
}

/// The place nearest to all rays; `None` if they are parallel.
fn triangulated(detections: &[&Detection<'_>]) -> Option<DVec3> {
    let (mut matrix, mut vector) = (DMat3::ZERO, DVec3::ZERO);
    for Detection { view, at } in detections {
        let camera = &view.camera;
        let ray = DVec3::new((at.x - camera.cx) / camera.fx, (at.y - camera.cy) / camera.fy, 1.0).normalize();
        let ray = camera.rotation.transpose() * ray;
        let across = DMat3::IDENTITY - DMat3::from_cols(ray * ray.x, ray * ray.y, ray * ray.z);
        matrix += across;
        vector += across * camera.centre();
    }
    (matrix.determinant().abs() > 1e-9).then(|| matrix.inverse() * vector)
}
