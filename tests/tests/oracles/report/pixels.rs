//! What a page in a browser looks like.

use anyhow::{Context, Result, ensure};
use base64::Engine;
use base64::engine::general_purpose::STANDARD;
use image::RgbImage;
use serde_json::{Value, json};

use crate::browser::devtools::Connection;

/// The part of the window that a rectangle covers.
///
/// # Errors
/// As [`capture`].
pub fn view(connection: &mut Connection, place: &Value) -> Result<RgbImage> {
    let scroll = connection.evaluate("[scrollX, scrollY]")?;
    let at = |name: &str| place[name].as_f64().unwrap_or(0.0);
    let (x, y) = (at("x") + scroll[0].as_f64().unwrap_or(0.0), at("y") + scroll[1].as_f64().unwrap_or(0.0));
    let clip = json!({"x": x, "y": y, "width": at("width"), "height": at("height"), "scale": 1});
    capture(connection, json!({"format": "png", "clip": clip}))
}

/// The picture that the browser takes with these parameters.
///
/// # Errors
/// If it takes none.
pub fn capture(connection: &mut Connection, parameters: Value) -> Result<RgbImage> {
    let answer = connection.call("Page.captureScreenshot", parameters)?;
    let bytes = STANDARD.decode(answer["data"].as_str().context("a picture")?)?;
    Ok(image::load_from_memory(&bytes)?.into_rgb8())
}

/// The share of pixels that differ visibly.
///
/// # Errors
/// If the pictures differ in size.
pub fn difference(a: &RgbImage, b: &RgbImage) -> Result<f64> {
    ensure!(a.dimensions() == b.dimensions(), "{:?} and {:?} pixels", a.dimensions(), b.dimensions());
    let differs = |(a, b): &(&image::Rgb<u8>, &image::Rgb<u8>)| a.0.iter().zip(b.0).any(|(&a, b)| a.abs_diff(b) > 8);
    Ok(a.pixels().zip(b.pixels()).filter(differs).count() as f64 / f64::from(a.width() * a.height()))
}
