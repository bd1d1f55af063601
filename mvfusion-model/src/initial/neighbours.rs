//! Distances to the nearest other points.

use std::collections::{BTreeMap, HashMap};
use std::num::NonZeroUsize;

use glam::Vec3;
use kiddo::{ImmutableKdTree, SquaredEuclidean};
use rayon::prelude::*;

/// Number of neighbours that determine the scale of a Gaussian (3DGS).
const NEIGHBOURS: usize = 3;

/// Mean of the squared distances to the three nearest other points, in double precision. With fewer than four points,
/// all others count; a single point has distance 0. Points that coincide are neighbours at distance 0.
pub fn mean_squared_distances(positions: &[Vec3]) -> Vec<f64> {
    if positions.len() < 2 {
        return vec![0.0; positions.len()];
    }
    let places = Places::of(positions);
    let tree = places.tree();
    let Places { distinct, counts, of_point } = places;
    let wanted = NonZeroUsize::MIN.saturating_add(NEIGHBOURS);
    let means: Vec<f64> = distinct
        .par_iter()
        .map(|place| {
            let nearest = tree.query(place).nearest_n::<SquaredEuclidean<f64>>(wanted).execute();
            let found = nearest.iter().flat_map(|found| {
                // Proof: the tree numbers its points by their place in `distinct`.
                let count = counts[found.item as usize].min(wanted.get());
                std::iter::repeat_n(found.distance, count)
            });
            let mut squared: Vec<f64> = found.collect();
            squared.sort_by(f64::total_cmp);
            squared.truncate(wanted.get());
            // The point itself is among its nearest, at distance 0.
            let others = &squared[1..];
            others.iter().sum::<f64>() / others.len() as f64
        })
        .collect();
    of_point.into_iter().map(|place| means[place]).collect()
}

/// For every point, the indices of its `count` nearest others, nearest first; row by row. Of points that coincide, the
/// first one stands for all. Where there are fewer others, the last of them is repeated; a single point is its own.
pub fn nearest_others(positions: &[Vec3], count: usize) -> Vec<usize> {
    let places = Places::of(positions);
    if places.distinct.len() < 2 {
        return vec![0; positions.len() * count];
    }
    let tree = places.tree();
    let firsts = places.firsts();
    let wanted = NonZeroUsize::MIN.saturating_add(count);
    let of_place = |(place, position): (usize, &[f64; 3])| {
        let nearest = tree.query(position).nearest_n::<SquaredEuclidean<f64>>(wanted).execute();
        let mut nearest: Vec<(f64, usize)> =
            nearest.iter().map(|found| (found.distance, found.item as usize)).collect();
        nearest.sort_by(|a, b| a.0.total_cmp(&b.0).then(a.1.cmp(&b.1)));
        let mut others: Vec<usize> =
            nearest.into_iter().filter(|&(_, other)| other != place).map(|(_, other)| firsts[other]).collect();
        others.truncate(count);
        let last = others.last().copied().unwrap_or(firsts[place]);
        others.resize(count, last);
        others
    };
    let others: Vec<Vec<usize>> = places.distinct.par_iter().enumerate().map(of_place).collect();
    places.of_point.into_iter().flat_map(|place| others[place].clone()).collect()
}

/// The distinct places of points. A tree of points that coincide has leaves of any size, and searching them takes the
/// square of their number.
struct Places {
    distinct: Vec<[f64; 3]>,
    /// Number of points at each place.
    counts: Vec<usize>,
    /// The place of each point.
    of_point: Vec<usize>,
}

impl Places {
    fn of(positions: &[Vec3]) -> Self {
        let mut index: HashMap<[u32; 3], usize> = HashMap::with_capacity(positions.len());
        let mut places = Self { distinct: Vec::new(), counts: Vec::new(), of_point: Vec::new() };
        for position in positions {
            // Adding 0.0 turns -0.0 into 0.0.
            let key = position.to_array().map(|coordinate| (coordinate + 0.0).to_bits());
            let place = *index.entry(key).or_insert_with(|| {
                places.distinct.push(position.to_array().map(f64::from));
                places.counts.push(0);
                places.distinct.len() - 1
            });
            places.counts[place] += 1;
            places.of_point.push(place);
        }
        places
    }

    /// A tree that numbers its points by their place in `distinct`.
    fn tree(&self) -> ImmutableKdTree<f64, 3> {
        // Proof: a leaf of this tree contains no coinciding points. 2^32 Gaussians with two moments for each of their 59
        // values would need 3 TB.
        ImmutableKdTree::new_from_slice(&self.distinct).expect("only more than 2^32 points cannot be indexed")
    }

    /// The first point at each place.
    fn firsts(&self) -> Vec<usize> {
        let mut firsts = vec![usize::MAX; self.distinct.len()];
        for (point, &place) in self.of_point.iter().enumerate() {
            firsts[place] = firsts[place].min(point);
        }
        firsts
    }
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
        // Two twins have one neighbour at distance 0, and two that are not.
        let line: Vec<Vec3> = [0.0, 0.0, 1.0, 3.0].map(|x| Vec3::new(x, 0.0, 0.0)).to_vec();
        let expected = [10.0 / 3.0, 10.0 / 3.0, (1.0 + 1.0 + 4.0) / 3.0, (9.0 + 9.0 + 4.0) / 3.0];
        assert_eq!(mean_squared_distances(&line), expected);
        assert_eq!(mean_squared_distances(&[Vec3::ONE]), [0.0]);
        assert_eq!(mean_squared_distances(&[]), Vec::<f64>::new());
    }

    #[test]
    fn nearest_others_leave_out_the_point_and_its_twins() {
        let line: Vec<Vec3> = [0.0, 0.0, 1.0, 3.0].map(|x| Vec3::new(x, 0.0, 0.0)).to_vec();
        assert_eq!(nearest_others(&line, 2), [2, 3, 2, 3, 0, 3, 2, 0]);
        assert_eq!(nearest_others(&line, 3), [2, 3, 3, 2, 3, 3, 0, 3, 3, 2, 0, 0]);
        assert_eq!(nearest_others(&[Vec3::ONE; 2], 2), [0; 4]);
    }

    #[test]
    fn a_hundred_thousand_points_at_one_place_are_as_quick_as_others() {
        // The square of this number would take half a minute.
        let squared = mean_squared_distances(&vec![Vec3::ONE; 100_000]);
        assert!(squared.len() == 100_000 && squared.iter().all(|&s| s == 0.0));
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
