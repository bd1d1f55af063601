//! Clusters of error pixels by position and colour.

use glam::{DVec2, Vec3};
use rayon::prelude::*;

use crate::random::Stream;

/// Number of clustering iterations; later ones change little.
const ROUNDS: usize = 6;

/// Colour difference with the weight of a distance of one cluster size (SLIC superpixels: a compactness of 10 to 40 of
/// 255 levels).
const COLOUR_WEIGHT: f64 = 0.1;

/// A pixel with a large error.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct ErrorPixel {
    /// Its centre.
    pub position: DVec2,
    /// The photo's colour.
    pub colour: Vec3,
    /// The error in `[0, 1]`.
    pub error: f32,
    /// Its index, row by row.
    pub index: usize,
}

/// The pixels in at most `count` non-empty clusters, by k-means over position and colour.
pub(super) fn clusters(pixels: &[ErrorPixel], count: usize, stream: &mut Stream) -> Vec<Vec<ErrorPixel>> {
    if pixels.is_empty() || count == 0 {
        return Vec::new();
    }
    let count = count.min(pixels.len());
    let side = (pixels.len() as f64 / count as f64).sqrt();
    let order = stream.permutation(pixels.len());
    let mut centres: Vec<(DVec2, Vec3)> =
        order[..count].iter().map(|&pixel| (pixels[pixel].position, pixels[pixel].colour)).collect();
    let mut members = Vec::new();
    for _ in 0..ROUNDS {
        members = vec![Vec::new(); count];
        let nearest: Vec<usize> = pixels.par_iter().map(|pixel| nearest(pixel, &centres, side)).collect();
        for (pixel, nearest) in pixels.iter().zip(nearest) {
            members[nearest].push(*pixel);
        }
        for (centre, members) in centres.iter_mut().zip(&members).filter(|(_, members)| !members.is_empty()) {
            let share = 1.0 / members.len() as f64;
            centre.0 = members.iter().map(|pixel| pixel.position).sum::<DVec2>() * share;
            centre.1 = members.iter().map(|pixel| pixel.colour).sum::<Vec3>() * share as f32;
        }
    }
    members.retain(|members| !members.is_empty());
    members
}

/// Index of the nearest centre by position and colour; the first one on a tie.
fn nearest(pixel: &ErrorPixel, centres: &[(DVec2, Vec3)], side: f64) -> usize {
    let distance = |&(position, colour): &(DVec2, Vec3)| {
        let colour = f64::from(pixel.colour.distance_squared(colour)) / (COLOUR_WEIGHT * COLOUR_WEIGHT);
        pixel.position.distance_squared(position) / (side * side) + colour
    };
    let distances = centres.iter().map(distance).enumerate();
    distances.min_by(|a, b| a.1.total_cmp(&b.1)).map_or(0, |(number, _)| number)
}
