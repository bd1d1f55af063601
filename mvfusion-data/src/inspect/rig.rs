//! The views of a scene in a common order, and the witnesses that represent its cameras.

use crate::scene::{Scene, View, by_camera};

/// Maximum number of cameras to inspect closely. It is enough for a median, and few enough to try all mistakes within a
/// second.
const WITNESSES: usize = 24;

/// The training views, then the held-out ones. Views are indexed in this order.
pub(super) fn all_views(scene: &Scene) -> impl Iterator<Item = &View> {
    scene.train.iter().chain(&scene.test)
}

/// Indices of views that represent the scene: for evenly spaced cameras, the view in the middle of the sequence.
/// Held-out views are included, because a surplus row of poses in Neu3D's layout also misplaces them.
pub(super) fn witnesses(scene: &Scene) -> Vec<usize> {
    let cameras = by_camera(all_views(scene));
    spread(cameras.len(), WITNESSES).into_iter().map(|c| cameras[c][cameras[c].len() / 2]).collect()
}

/// Whether cameras are fixed, at least for several views each.
pub(super) fn stands_still(scene: &Scene) -> bool {
    2 * by_camera(all_views(scene)).len() <= scene.train.len() + scene.test.len()
}

/// At most `most` of the numbers below `count`, evenly spaced, including the first and the last.
pub(super) fn spread(count: usize, most: usize) -> Vec<usize> {
    match count.min(most) {
        0 => Vec::new(),
        1 => vec![0],
        picks => (0..picks).map(|pick| pick * (count - 1) / (picks - 1)).collect(),
    }
}
