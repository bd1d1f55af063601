//! Gaussian windows over images, and the similarity of two images based on them. CPU twin: `window/cpu.rs` and
//! `window/similarity.rs`.
//!
//! There are two passes. The first computes sums down the columns from the images, the second computes the results
//! along the rows. Images are planes of `[height, width]`, one after another. A unit is a pixel of a plane.

use cubecl::prelude::*;

/// The kind of similarity of two images.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum SimilarityKind {
    /// SSIM.
    Ssim,
    /// The structure term.
    Structure,
}

/// Constants of a similarity (METHOD §4.4).
#[derive(CubeType, CubeLaunch, Clone, Copy)]
pub struct SimilarityConstants {
    /// Constant of SSIM's luminance term.
    pub c1: f32,
    /// Constant of SSIM's contrast term.
    pub c2: f32,
    /// Constant of the structure term.
    pub c3: f32,
    /// Upper bound of the structure term.
    pub structure_max: f32,
}

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
        let (first, count, tap) = taps_along(pixel, weights, &size);
        blurred[pixel as usize] = sum_along(sums, weights, first, count, tap);
    }
}

/// The moments of two images down the columns: mean a, mean b, variance of a + variance of b, covariance,
/// `[4, planes, height, width]`. Sums are relative to the middle pixel. Variances of bright, flat images are therefore
/// not small differences of large numbers. Pixels outside the images are black.
#[cube(launch_unchecked)]
pub fn moment_columns(a: &[f32], b: &[f32], weights: &[f32], sums: &mut [f32], size: PlaneSize) {
    let pixel = ABSOLUTE_POS as u32;
    let pixels = size.planes * size.height * size.width;
    if pixel < pixels {
        let (first, count, tap) = taps_down(pixel, weights, &size);
        let (middle_a, middle_b) = (a[pixel as usize], b[pixel as usize]);
        let mut sum_a = 0.0f32;
        let mut sum_b = 0.0f32;
        let mut squares = 0.0f32;
        let mut product = 0.0f32;
        let mut inside = 0.0f32;
        for i in 0..count {
            let at = (first + i * size.width) as usize;
            let weight = weights[(tap + i) as usize];
            let (from_a, from_b) = (a[at] - middle_a, b[at] - middle_b);
            sum_a += weight * from_a;
            sum_b += weight * from_b;
            squares += weight * (from_a * from_a + from_b * from_b);
            product += weight * (from_a * from_b);
            inside += weight;
        }
        let moments = from_middle(sum_a, sum_b, squares, product, inside, middle_a, middle_b);
        sums[pixel as usize] = moments.mean_a;
        sums[(pixels + pixel) as usize] = moments.mean_b;
        sums[(2u32 * pixels + pixel) as usize] = moments.variances;
        sums[(3u32 * pixels + pixel) as usize] = moments.covariance;
    }
}

/// The similarity from the moments of the columns. If `wanted`, also its derivatives `[4, planes, height, width]` with
/// respect to mean a, mean b, mean a² + b² and mean ab. A variance is the mean of the columns' variances plus the
/// variance of their means. Sums are relative to the middle column.
#[cube(launch_unchecked)]
pub fn similarity_rows(
    sums: &[f32],
    weights: &[f32],
    map: &mut [f32],
    slopes: &mut [f32],
    size: PlaneSize,
    constants: SimilarityConstants,
    #[comptime] kind: SimilarityKind,
    #[comptime] wanted: bool,
) {
    let pixel = ABSOLUTE_POS as u32;
    let pixels = size.planes * size.height * size.width;
    if pixel < pixels {
        let (first, count, tap) = taps_along(pixel, weights, &size);
        let (middle_a, middle_b) = (sums[pixel as usize], sums[(pixels + pixel) as usize]);
        let mut sum_a = 0.0f32;
        let mut sum_b = 0.0f32;
        let mut squares = 0.0f32;
        let mut product = 0.0f32;
        let mut inside = 0.0f32;
        for i in 0..count {
            let at = first + i;
            let weight = weights[(tap + i) as usize];
            let (from_a, from_b) = (sums[at as usize] - middle_a, sums[(pixels + at) as usize] - middle_b);
            sum_a += weight * from_a;
            sum_b += weight * from_b;
            squares += weight * (sums[(2u32 * pixels + at) as usize] + (from_a * from_a + from_b * from_b));
            product += weight * (sums[(3u32 * pixels + at) as usize] + from_a * from_b);
            inside += weight;
        }
        let moments = from_middle(sum_a, sum_b, squares, product, inside, middle_a, middle_b);
        let trace = if comptime!(kind == SimilarityKind::Ssim) {
            ssim(&moments, &constants)
        } else {
            structure(&moments, &constants)
        };
        map[pixel as usize] = trace.value;
        if comptime!(wanted) {
            slopes[pixel as usize] = trace.by_mean_a;
            slopes[(pixels + pixel) as usize] = trace.by_mean_b;
            slopes[(2u32 * pixels + pixel) as usize] = trace.by_square;
            slopes[(3u32 * pixels + pixel) as usize] = trace.by_cross;
        }
    }
}

/// The derivatives times the cotangent of the map, summed down the columns.
#[cube(launch_unchecked)]
pub fn adjoint_columns(v_map: &[f32], slopes: &[f32], weights: &[f32], sums: &mut [f32], size: PlaneSize) {
    let pixel = ABSOLUTE_POS as u32;
    let pixels = size.planes * size.height * size.width;
    if pixel < pixels {
        let (first, count, tap) = taps_down(pixel, weights, &size);
        #[unroll]
        for moment in 0..4u32 {
            let mut sum = 0.0f32;
            for i in 0..count {
                let at = first + i * size.width;
                sum += weights[(tap + i) as usize] * v_map[at as usize] * slopes[(moment * pixels + at) as usize];
            }
            sums[(moment * pixels + pixel) as usize] = sum;
        }
    }
}

/// The adjoints of the two images, from the column sums of `adjoint_columns`.
#[cube(launch_unchecked)]
pub fn adjoint_rows(
    sums: &[f32],
    a: &[f32],
    b: &[f32],
    weights: &[f32],
    v_a: &mut [f32],
    v_b: &mut [f32],
    size: PlaneSize,
) {
    let pixel = ABSOLUTE_POS as u32;
    let pixels = size.planes * size.height * size.width;
    if pixel < pixels {
        let (first, count, tap) = taps_along(pixel, weights, &size);
        let v_mean_a = sum_along(sums, weights, first, count, tap);
        let v_mean_b = sum_along(sums, weights, first + pixels, count, tap);
        let v_square = 2.0f32 * sum_along(sums, weights, first + 2u32 * pixels, count, tap);
        let v_cross = sum_along(sums, weights, first + 3u32 * pixels, count, tap);
        let (own_a, own_b) = (a[pixel as usize], b[pixel as usize]);
        v_a[pixel as usize] = v_mean_a + own_a * v_square + own_b * v_cross;
        v_b[pixel as usize] = v_mean_b + own_b * v_square + own_a * v_cross;
    }
}

/// The first pixel, the number of taps and the first weight of the window down a column.
#[cube]
fn taps_down(pixel: u32, weights: &[f32], size: &PlaneSize) -> (u32, u32, u32) {
    let radius = weights.len() as u32 / 2u32;
    let row = pixel / size.width % size.height;
    let up = min(row, radius);
    let down = min(size.height - 1u32 - row, radius);
    (pixel - up * size.width, up + down + 1u32, radius - up)
}

/// The same along a row.
#[cube]
fn taps_along(pixel: u32, weights: &[f32], size: &PlaneSize) -> (u32, u32, u32) {
    let radius = weights.len() as u32 / 2u32;
    let column = pixel % size.width;
    let left = min(column, radius);
    let right = min(size.width - 1u32 - column, radius);
    (pixel - left, left + right + 1u32, radius - left)
}

#[cube]
fn sum_along(sums: &[f32], weights: &[f32], first: u32, count: u32, tap: u32) -> f32 {
    let mut sum = 0.0f32;
    for i in 0..count {
        sum += weights[(tap + i) as usize] * sums[(first + i) as usize];
    }
    sum
}

/// The windowed moments of two images: mean a, mean b, variance of a + variance of b, covariance.
#[derive(CubeType, Clone, Copy)]
struct Moments {
    mean_a: f32,
    mean_b: f32,
    variances: f32,
    covariance: f32,
}

/// Moments from sums that are relative to the middle and include the weights `inside` the image; pixels outside are
/// black.
#[cube]
fn from_middle(
    sum_a: f32,
    sum_b: f32,
    squares: f32,
    product: f32,
    inside: f32,
    middle_a: f32,
    middle_b: f32,
) -> Moments {
    let outside = 1.0f32 - inside;
    let sum_a = sum_a - outside * middle_a;
    let sum_b = sum_b - outside * middle_b;
    let squares = squares + outside * (middle_a * middle_a + middle_b * middle_b);
    let product = product + outside * (middle_a * middle_b);
    Moments {
        mean_a: middle_a + sum_a,
        mean_b: middle_b + sum_b,
        variances: squares - (sum_a * sum_a + sum_b * sum_b),
        covariance: product - sum_a * sum_b,
    }
}

/// A similarity and its derivatives.
#[derive(CubeType, Clone, Copy)]
struct Trace {
    value: f32,
    by_mean_a: f32,
    by_mean_b: f32,
    by_square: f32,
    by_cross: f32,
}

#[cube]
fn ssim(moments: &Moments, constants: &SimilarityConstants) -> Trace {
    let (mean_a, mean_b) = (moments.mean_a, moments.mean_b);
    let squared_means = mean_a * mean_a + mean_b * mean_b;
    let luminance = 2.0f32 * mean_a * mean_b + constants.c1;
    let contrast = 2.0f32 * moments.covariance + constants.c2;
    let means = squared_means + constants.c1;
    let variances = max(moments.variances, 0.0f32) + constants.c2;
    let inverse = 1.0f32 / (means * variances);
    let value = luminance * contrast * inverse;
    let (by_means, by_variances) = (value * variances * inverse, value * means * inverse);
    let through_other = 2.0f32 * (contrast - luminance) * inverse;
    let through_own = 2.0f32 * (by_variances - by_means);
    Trace {
        value,
        by_mean_a: mean_b * through_other + mean_a * through_own,
        by_mean_b: mean_a * through_other + mean_b * through_own,
        by_square: -by_variances,
        by_cross: 2.0f32 * luminance * inverse,
    }
}

#[cube]
fn structure(moments: &Moments, constants: &SimilarityConstants) -> Trace {
    let (mean_a, mean_b) = (moments.mean_a, moments.mean_b);
    let covariance = moments.covariance + constants.c3;
    let variances = max(moments.variances, 0.0f32) + constants.c3;
    let inverse = 1.0f32 / variances.sqrt();
    let value = covariance * inverse;
    let clipped = clamp(value, 0.0f32, constants.structure_max);
    let open = select(value == clipped, inverse, 0.0f32);
    let by_variances = value * inverse * open;
    Trace {
        value: clipped,
        by_mean_a: mean_a * by_variances - mean_b * open,
        by_mean_b: mean_b * by_variances - mean_a * open,
        by_square: -0.5f32 * by_variances,
        by_cross: open,
    }
}
