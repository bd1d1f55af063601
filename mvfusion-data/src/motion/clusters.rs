//! Clusters of places: places of one object are connected through neighbours.

use glam::{DVec3, I64Vec3};

/// Number of places to sample for an estimate of the spacing.
const WITNESSES: usize = 256;
/// Side of a cube, in distances between neighbouring places. It is large enough to connect the places of one object.
const SIDE: f64 = 3.0;

/// For each place, the number of places in its object, including itself. Occupied cubes that touch, at least in a
/// corner, hold one object. The side of the cubes follows from the spacing of the places.
pub(super) fn sizes_of_things(places: &[DVec3]) -> Vec<usize> {
    let side = SIDE * spacing(places);
    let cubes: Vec<[i64; 3]> = places.iter().map(|place| (place / side).floor().as_i64vec3().to_array()).collect();
    let mut distinct = cubes.clone();
    distinct.sort_unstable();
    distinct.dedup();
    let number = |cube: &[i64; 3]| distinct.binary_search(cube);
    let mut things = Things { above: (0..distinct.len()).collect() };
    for (index, &cube) in distinct.iter().enumerate() {
        for other in neighbours(cube).filter_map(|neighbour| number(&neighbour).ok()) {
            things.join(index, other);
        }
    }
    // Each cube is among the distinct ones.
    let roots: Vec<usize> = cubes.iter().map(|cube| things.root(number(cube).unwrap_or(0))).collect();
    let mut sizes = vec![0; distinct.len()];
    for &root in &roots {
        sizes[root] += 1;
    }
    roots.into_iter().map(|root| sizes[root]).collect()
}

/// Median distance from a place to the nearest other one; positive.
fn spacing(places: &[DVec3]) -> f64 {
    let nearest = |index: usize| {
        let others = places.iter().enumerate().filter(|&(other, _)| other != index);
        others.map(|(_, place)| place.distance_squared(places[index])).fold(f64::INFINITY, f64::min)
    };
    let step = places.len().div_ceil(WITNESSES).max(1);
    let mut squared: Vec<f64> = (0..places.len()).step_by(step).map(nearest).collect();
    squared.sort_by(f64::total_cmp);
    let median = squared.get(squared.len() / 2).copied().unwrap_or(1.0).sqrt();
    if median.is_finite() && median > 0.0 { median } else { 1.0 }
}

/// Half of the 26 cubes around a cube, so that each pair occurs once.
fn neighbours(cube: [i64; 3]) -> impl Iterator<Item = [i64; 3]> {
    // The first 13 of the 27 cubes around and including this one. The last 13 have it among their first.
    (0..13).map(move |index| {
        let step = I64Vec3::new(index / 9 - 1, index / 3 % 3 - 1, index % 3 - 1);
        (I64Vec3::from_array(cube).saturating_add(step)).to_array()
    })
}

/// Disjoint sets (union-find).
#[derive(Debug)]
struct Things {
    /// Another member of the same set, nearer to its root. A root points to itself.
    above: Vec<usize>,
}

impl Things {
    fn root(&mut self, mut member: usize) -> usize {
        while self.above[member] != member {
            // Halves the path for the next time.
            self.above[member] = self.above[self.above[member]];
            member = self.above[member];
        }
        member
    }

    fn join(&mut self, a: usize, b: usize) {
        let (a, b) = (self.root(a), self.root(b));
        self.above[a.max(b)] = a.min(b);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn places_side_by_side_are_one_thing_and_distant_ones_others() {
        let line = |start: f64, count: usize| (0..count).map(move |i| DVec3::new(start, 0.1 * i as f64, -start));
        let places: Vec<DVec3> = line(0.0, 20).chain(line(5.0, 4)).chain(line(-9.0, 1)).collect();
        let sizes = sizes_of_things(&places);
        assert_eq!(sizes[..20], [20; 20]);
        assert_eq!(sizes[20..], [4, 4, 4, 4, 1]);
        assert_eq!(sizes_of_things(&places[..1]), [1]);
        assert_eq!(sizes_of_things(&[DVec3::ONE; 3]), [3; 3]);
        assert!(sizes_of_things(&[]).is_empty());
    }
}
