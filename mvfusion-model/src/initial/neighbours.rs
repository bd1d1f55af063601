//! Distances to the nearest other points.

use std::collections::BTreeMap;

use glam::Vec3;
use kiddo::{ImmutableKdTree, SquaredEuclidean};
use rayon::prelude::*;

/// Mean of the squared distances to the three nearest other points, in double precision. With fewer than four points,
/// all others count; a single point has distance 0.
pub fn mean_squared_distances(positions: &[Vec3]) -> Vec<f64> {
    /// Number of neighbours that determine the scale of a Gaussian (3DGS).
    const NEIGHBOURS: usize = 3;
    let points: Vec<[f64; 3]> = positions.iter().map(|p| p.to_array().map(f64::from)).collect();
    if points.len() < 2 {
        return vec![0.0; points.len()];
    }
    // Proof: a leaf of this tree may contain any number of coinciding points. 2^32 Gaussians with two moments for each
    // of their 59 values would need 3 TB.
    let tree: ImmutableKdTree<f64, 3> =
        ImmutableKdTree::new_from_slice(&points).expect("only more than 2^32 points cannot be indexed");
    let wanted = std::num::NonZeroUsize::MIN.saturating_add(NEIGHBOURS);
    points
        .par_iter()
        .map(|point| {
            // The point itself is among its nearest, at distance 0. Dropping one zero drops it or a coinciding point.
            let mut squared: Vec<f64> = tree
                .query(point)
                .nearest_n::<SquaredEuclidean<f64>>(wanted)
                .execute()
                .iter()
                .map(|found| found.distance)
                .collect();
            squared.sort_by(f64::total_cmp);
            let others = &squared[1..];
            others.iter().sum::<f64>() / others.len() as f64
        })
        .collect()
}

/// Minimum size of a group; fewer points say little about their distances.
const LEAST_GROUP: usize = 8;

/// The same within groups of points, such as the points of one moment. Groups with fewer than eight points are merged.
pub(super) fn mean_squared_distances_within<G: Ord + Copy>(positions: &[Vec3], groups: &[G]) -> Vec<f64> {
    let mut members: BTreeMap<G, Vec<usize>> = BTreeMap::new();
    for (index, &group) in groups.iter().enumerate().take(positions.len()) {
        members.entry(group).or_default().push(index);
    }
    let (large, small): (Vec<_>, Vec<_>) = members.into_values().partition(|indices| indices.len() >= LEAST_GROUP);
    let mut squared = vec![0.0; positions.len()];
    for indices in large.into_iter().chain([small.concat()]) {
        let of_group: Vec<Vec3> = indices.iter().map(|&index| positions[index]).collect();
        for (index, distance) in indices.into_iter().zip(mean_squared_distances(&of_group)) {
            squared[index] = distance;
        }
    }
    squared
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_scale_of_a_gaussian_comes_from_its_three_nearest_neighbours() {
        let line: Vec<Vec3> = (0..5).map(|i| Vec3::new(i as f32, 0.0, 0.0)).collect();
        let squared = mean_squared_distances(&line);
        assert!((squared[0] - (1.0 + 4.0 + 9.0) / 3.0).abs() < 1e-12);
        assert!((squared[2] - (1.0 + 1.0 + 4.0) / 3.0).abs() < 1e-12);
    }

    #[test]
    fn twins_are_neighbours_at_distance_zero() {
        let squared = mean_squared_distances(&[Vec3::ONE; 6]);
        assert!(squared.iter().all(|&s| s == 0.0));
        assert_eq!(mean_squared_distances(&[Vec3::ONE]), [0.0]);
        assert_eq!(mean_squared_distances(&[]), Vec::<f64>::new());
    }

    #[test]
    fn points_of_another_moment_are_no_neighbours() {
        let line: Vec<Vec3> = (0..32).map(|i| Vec3::new(i as f32, 0.0, 0.0)).collect();
        let groups: Vec<usize> = (0..32).map(|i| i % 2).collect();
        let squared = mean_squared_distances_within(&line, &groups);
        assert_eq!(squared[16], (4.0 + 4.0 + 16.0) / 3.0);
        // Moments with one point each are merged.
        let alone: Vec<usize> = (0..32).collect();
        assert_eq!(mean_squared_distances_within(&line, &alone), mean_squared_distances(&line));
    }
}
