//! Which places belong to one thing: those that chains of neighbours join.

use glam::{DVec3, I64Vec3};

/// For each place, how many places its thing has: those in cubes of side `side` that touch each other, at least in a corner,
/// count as one thing.
pub(super) fn sizes_of_things(places: &[DVec3], side: f64) -> Vec<usize> {
    let cubes: Vec<[i64; 3]> = places.iter().map(|place| (place / side).floor().as_i64vec3().to_array()).collect();
    let mut distinct = cubes.clone();
    distinct.sort_unstable();
    distinct.dedup();
    let number = |cube: &[i64; 3]| distinct.binary_search(cube);
    let mut things = Things { above: (0..distinct.len()).collect() };
    for (index, &cube) in distinct.iter().enumerate() {
        for neighbour in neighbours(cube) {
            if let Ok(other) = number(&neighbour) {
                things.join(index, other);
            }
        }
    }
    let mut sizes = vec![0; distinct.len()];
    let roots: Vec<usize> = cubes.iter().map(|cube| things.root(number(cube).unwrap_or(0))).collect();
    for &root in &roots {
        sizes[root] += 1;
    }
    roots.iter().map(|&root| sizes[root]).collect()
}

/// The cubes around a cube, of those pairs each once.
fn neighbours(cube: [i64; 3]) -> impl Iterator<Item = [i64; 3]> {
    // The first 13 of the 27 cubes around and including this one; the last 13 are those that have it among their first.
    (0..13).map(move |index| {
        let step = I64Vec3::new(index / 9 - 1, index / 3 % 3 - 1, index % 3 - 1);
        (I64Vec3::from_array(cube).saturating_add(step)).to_array()
    })
}

/// Sets that are joined step by step.
#[derive(Debug)]
struct Things {
    /// Another member of the same set, nearer to its root; a root is its own.
    above: Vec<usize>,
}

impl Things {
    fn root(&mut self, mut member: usize) -> usize {
        while self.above[member] != member {
            // Halves the way for the next time.
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
