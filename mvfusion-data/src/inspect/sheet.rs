//! A contact sheet: the points drawn over a few photos, so that wrong poses are immediately visible.

use colorgrad::Gradient;
use glam::DVec2;
use image::imageops::{self, FilterType};
use image::{Rgb, RgbImage};

use super::rig::spread;
use super::sight::pixel;
use crate::error::DataError;
use crate::scene::{Scene, View};

/// Maximum number of points on each photo.
const POINTS: usize = 3000;
/// Pixels between the photos.
const GAP: u32 = 6;
/// Colour between the photos.
const PAPER: Rgb<u8> = Rgb([32, 32, 32]);
/// Colour around each point, so that it stands out from any photo.
const OUTLINE: Rgb<u8> = Rgb([0, 0, 0]);
/// Largest enlargement of photos.
const LARGEST_SCALE: f64 = 3.0;
/// The part of the map turbo that ranks of depths get: its ends are too dark for points on a photo.
const COLOURS: [f32; 2] = [0.1, 0.86];

/// Photos with the points on them. Near points are red, far ones blue.
#[derive(Clone, Debug)]
pub struct ContactSheet {
    /// The photos in rows.
    pub image: RgbImage,
    /// The names of the views, in reading order.
    pub names: Vec<String>,
    /// Photos per row.
    pub columns: usize,
}

/// Draws a scene's points over some of its photos, in a sheet of at most `largest_side` pixels per side. The photos are
/// evenly spaced training views from first to last, and one held-out view at the end. There are at most `photos` of
/// them, but at least one.
///
/// # Errors
/// [`DataError::Image`] if an image cannot be read.
pub fn points_over_photos(scene: &Scene, photos: usize, largest_side: u32) -> Result<ContactSheet, DataError> {
    let views = chosen(scene, photos.max(1));
    let Some(first) = views.first() else {
        return Ok(ContactSheet { image: RgbImage::new(1, 1), names: Vec::new(), columns: 1 });
    };
    let (columns, scale) = layout(views.len(), first.image.size(), largest_side);
    let mut cells = Vec::with_capacity(views.len());
    for view in &views {
        cells.push(cell(scene, view, scale)?);
    }
    let names = views.iter().map(|view| view.name.clone()).collect();
    Ok(ContactSheet { image: mounted(&cells, columns), names, columns })
}

/// Training views from first to last, and one held-out view.
fn chosen(scene: &Scene, photos: usize) -> Vec<&View> {
    let held_out = usize::from(photos > 1 && !scene.test.is_empty());
    let train = spread(scene.train.len(), photos - held_out).into_iter().map(|index| &scene.train[index]);
    let test = scene.test.get(scene.test.len() / 2).into_iter().take(held_out);
    train.chain(test).collect()
}

/// The number of columns that makes the photos largest, and their scale.
fn layout(count: usize, (width, height): (u32, u32), largest_side: u32) -> (usize, f64) {
    let scale = |columns: usize| {
        let fit = |count: usize, side: u32| {
            let room = f64::from(largest_side) - f64::from(GAP) * (count as f64 + 1.0);
            room / (count as f64 * f64::from(side.max(1)))
        };
        fit(columns, width).min(fit(count.div_ceil(columns), height)).min(LARGEST_SCALE)
    };
    let best = (1..=count).max_by(|&a, &b| scale(a).total_cmp(&scale(b)));
    let columns = best.unwrap_or(1);
    (columns, scale(columns))
}

/// A view's photo at its size in the sheet, with the points on it.
fn cell(scene: &Scene, view: &View, scale: f64) -> Result<RgbImage, DataError> {
    let photo = view.image.rgb()?;
    let side = |side: u32| ((f64::from(side) * scale) as u32).max(1);
    let mut cell = imageops::resize(&*photo, side(photo.width()), side(photo.height()), FilterType::Triangle);
    let size = DVec2::new(f64::from(cell.width()), f64::from(cell.height()));
    let scale = size / DVec2::new(view.camera.width as f64, view.camera.height as f64);
    let place = |&point: &glam::Vec3| {
        let point = point.as_dvec3();
        Some(Dot { at: pixel(&view.camera, point)? * scale, depth: view.camera.to_camera(point).z })
    };
    let all: Vec<Dot> = scene.points.positions.iter().filter_map(place).collect();
    let mut dots: Vec<Dot> = spread(all.len(), POINTS).into_iter().map(|index| all[index]).collect();
    dots.sort_by(|a, b| b.depth.total_cmp(&a.depth));
    let radius = (size.max_element() / 300.0).clamp(1.0, 4.0);
    // Colours follow the rank. Otherwise, a few far points would leave only one colour for all others.
    let map = colorgrad::preset::turbo();
    for (rank, dot) in dots.iter().enumerate() {
        disc(&mut cell, dot.at, radius, colour(&map, (dots.len() - 1 - rank) as f64 / (dots.len() - 1).max(1) as f64));
    }
    Ok(cell)
}

/// A point on a photo.
#[derive(Clone, Copy)]
struct Dot {
    at: DVec2,
    depth: f64,
}

/// The colour of a depth's rank: 0 for the nearest, which is red, 1 for the farthest, which is blue.
fn colour(map: &impl Gradient, rank: f64) -> Rgb<u8> {
    let [low, high] = COLOURS;
    let [r, g, b, _] = map.at(high + (low - high) * rank as f32).to_rgba8();
    Rgb([r, g, b])
}

/// Draws a disc with an outline one pixel wide.
fn disc(image: &mut RgbImage, at: DVec2, radius: f64, colour: Rgb<u8>) {
    let reach = (radius + 1.0).ceil() as i64;
    let (centre_x, centre_y) = (at.x as i64, at.y as i64);
    for y in centre_y - reach..=centre_y + reach {
        for x in centre_x - reach..=centre_x + reach {
            let distance = DVec2::new(x as f64 + 0.5, y as f64 + 0.5).distance(at);
            let inside = (0..i64::from(image.width())).contains(&x) && (0..i64::from(image.height())).contains(&y);
            if inside && distance <= radius + 1.0 {
                image.put_pixel(x as u32, y as u32, if distance <= radius { colour } else { OUTLINE });
            }
        }
    }
}

/// Lays out the photos in rows.
fn mounted(cells: &[RgbImage], columns: usize) -> RgbImage {
    let width = cells.iter().map(RgbImage::width).max().unwrap_or(1);
    let height = cells.iter().map(RgbImage::height).max().unwrap_or(1);
    let (across, down) = (columns as u32, cells.len().div_ceil(columns) as u32);
    let mut sheet = RgbImage::from_pixel(across * (width + GAP) + GAP, down * (height + GAP) + GAP, PAPER);
    for (index, cell) in cells.iter().enumerate() {
        let (column, row) = (index as u32 % across, index as u32 / across);
        let (x, y) = (GAP + column * (width + GAP), GAP + row * (height + GAP));
        imageops::replace(&mut sheet, cell, i64::from(x), i64::from(y));
    }
    sheet
}
