//! Sums over Gaussian windows of images. CPU twin: `window/cpu.rs`.
//!
//! A window is separable: sums down the columns come first, then sums of these along the rows. Images are planes of
//! `[height, width]`, one after another. A unit is a pixel of a plane.

use cubecl::prelude::*;

/// Size of the images, `[planes, height, width]`.
#[derive(CubeType, CubeLaunch, Clone, Copy)]
pub struct PlaneSize {
    /// Number of images.
    pub planes: u32,
    /// Rows.
    pub height: u32,
    /// Columns.
    pub width: u32,
}

/// Weighted sums down the columns of `images`.
#[cube(launch_unchecked)]
pub fn blur_columns(images: &[f32], weights: &[f32], sums: &mut [f32], size: PlaneSize) {
    let pixel = ABSOLUTE_POS as u32;
    if pixel < size.planes * size.height * size.width {
        let (first, count, tap) = taps_down(pixel, weights, &size);
        let mut sum = 0.0f32;
        for i in 0..count {
            sum += weights[(tap + i) as usize] * images[(first + i * size.width) as usize];
        }
        sums[pixel as usize] = sum;
    }
}

/// Weighted sums along the rows.
#[cube(launch_unchecked)]
pub fn blur_rows(sums: &[f32], weights: &[f32], blurred: &mut [f32], size: PlaneSize) {
    let pixel = ABSOLUTE_POS as u32;
    if pixel < size.planes * size.height * size.width {
        let (before, count, tap) = taps_along(pixel, weights, &size);
        let mut sum = 0.0f32;
        for i in 0..count {
            sum += weights[(tap + i) as usize] * sums[(pixel - before + i) as usize];
        }
        blurred[pixel as usize] = sum;
    }
}

/// The first pixel, the number of taps and the first weight of the window down a column.
#[cube]
pub(super) fn taps_down(pixel: u32, weights: &[f32], size: &PlaneSize) -> (u32, u32, u32) {
    let radius = weights.len() as u32 / 2u32;
    let row = pixel / size.width % size.height;
    let up = min(row, radius);
    let down = min(size.height - 1u32 - row, radius);
    (pixel - up * size.width, up + down + 1u32, radius - up)
}

/// The pixels before this one in the window along a row, the number of taps and the first weight.
#[cube]
pub(super) fn taps_along(pixel: u32, weights: &[f32], size: &PlaneSize) -> (u32, u32, u32) {
    let radius = weights.len() as u32 / 2u32;
    let column = pixel % size.width;
    let left = min(column, radius);
    let right = min(size.width - 1u32 - column, radius);
    (left, left + right + 1u32, radius - left)
}
