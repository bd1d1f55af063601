//! The distinct cameras of a scene, and those of them that stand for all.

use std::collections::BTreeMap;

use crate::{Camera, Scene, View};

/// Cameras that are looked at closely: enough for a median, few enough for all mistakes to be tried within a second.
const WITNESSES: usize = 24;

/// The training views, then the held-out ones: pictures are numbered in this order.
pub(super) fn all_views(scene: &Scene) -> impl Iterator<Item = &View> {
    scene.train.iter().chain(&scene.test)
}

/// The views of each distinct camera (one pose and one lens), in the order in which the cameras first appear.
pub(crate) fn by_camera<'a>(views: impl Iterator<Item = &'a View>) -> Vec<Vec<usize>> {
    let mut places = BTreeMap::new();
    let mut cameras: Vec<Vec<usize>> = Vec::new();
    for (index, view) in views.enumerate() {
        let place = *places.entry(identity(&view.camera)).or_insert_with(|| {
            cameras.push(Vec::new());
            cameras.len() - 1
        });
        cameras[place].push(index);
    }
    cameras
}

/// The numbers of a camera; equal for equal cameras only.
fn identity(camera: &Camera) -> [u64; 18] {
    let size = [camera.width as f64, camera.height as f64];
    let lens = [camera.fx, camera.fy, camera.cx, camera.cy];
    let pose = camera.rotation.to_cols_array().into_iter().chain(camera.translation.to_array());
    let mut numbers = size.into_iter().chain(lens).chain(pose);
    std::array::from_fn(|_| numbers.next().unwrap_or_default().to_bits())
}

/// The numbers of views, one in the middle of its time of each of some cameras that are spread evenly over all. Held-out ones
/// are among them: in Neu3D's layout a row too many puts them, too, in another's place.
pub(super) fn witnesses(scene: &Scene) -> Vec<usize> {
    let cameras = by_camera(all_views(scene));
    spread(cameras.len(), WITNESSES).into_iter().map(|c| cameras[c][cameras[c].len() / 2]).collect()
}

/// Whether the scene was filmed by cameras that stand still, or do so for several views at least.
pub(super) fn stands_still(scene: &Scene) -> bool {
    2 * by_camera(all_views(scene)).len() <= scene.train.len() + scene.test.len()
}

/// At most `most` of the numbers below `count`, evenly spread, the first and the last among them.
pub(super) fn spread(count: usize, most: usize) -> Vec<usize> {
    match count.min(most) {
        0 => Vec::new(),
        1 => vec![0],
        picks => (0..picks).map(|pick| pick * (count - 1) / (picks - 1)).collect(),
    }
}
