//! The distinct cameras among some views.

use std::collections::BTreeMap;

use super::camera::Camera;
use super::view::View;

/// The indices of the views of each distinct camera (one pose and one lens), in order of first appearance.
pub fn by_camera<'a>(views: impl Iterator<Item = &'a View>) -> Vec<Vec<usize>> {
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

/// The first view of each distinct camera (one pose and one lens), in order of first appearance.
pub fn distinct_cameras<'a>(views: impl IntoIterator<Item = &'a View>) -> Vec<&'a View> {
    let views: Vec<&View> = views.into_iter().collect();
    by_camera(views.iter().copied()).into_iter().map(|group| views[group[0]]).collect()
}

/// The bits of a camera's values. Only equal cameras have equal bits.
fn identity(camera: &Camera) -> [u64; 18] {
    let size = [camera.width as f64, camera.height as f64];
    let lens = [camera.fx, camera.fy, camera.cx, camera.cy];
    let pose = camera.rotation.to_cols_array().into_iter().chain(camera.translation.to_array());
    let mut numbers = size.into_iter().chain(lens).chain(pose);
    std::array::from_fn(|_| numbers.next().unwrap_or_default().to_bits())
}
