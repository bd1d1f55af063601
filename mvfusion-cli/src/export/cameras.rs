//! `cameras.json` as 3DGS writes it.

use std::path::Path;

use mvfusion_data::files::read_text;
use mvfusion_data::{Camera, Scene, View};
use serde::Serialize;

use crate::atomic;
use crate::run::MOST_OF_RECORDS;

/// The cameras of all views.
pub const CAMERAS: &str = "cameras.json";

/// A camera of 3DGS. It has no principal point; viewers assume the centre of the image.
#[derive(Clone, Debug, PartialEq, Serialize)]
struct Entry<'a> {
    id: usize,
    img_name: &'a str,
    width: usize,
    height: usize,
    /// Centre in the world.
    position: [f64; 3],
    /// Camera to world, row by row; columns are right, down, forward.
    rotation: [[f64; 3]; 3],
    fx: f64,
    fy: f64,
}

impl<'a> Entry<'a> {
    fn new(id: usize, view: &'a View) -> Self {
        let Camera { width, height, fx, fy, rotation, .. } = view.camera;
        let to_world = rotation.transpose();
        Self {
            id,
            img_name: &view.name,
            width,
            height,
            position: view.camera.centre().to_array(),
            rotation: [0, 1, 2].map(|row| to_world.row(row).to_array()),
            fx,
            fy,
        }
    }
}

/// Whether the cameras in a folder were written here. 3DGS writes the same fields with `fy` before `fx`.
pub(super) fn is_ours(folder: &Path) -> bool {
    let Ok(text) = read_text(&folder.join(CAMERAS), MOST_OF_RECORDS) else { return false };
    text.find("\"fx\"").zip(text.find("\"fy\"")).is_some_and(|(x, y)| x < y)
}

/// Writes the cameras of all views: the held-out views first, then the training views, as 3DGS orders them.
///
/// # Errors
/// If the file cannot be written.
pub fn write_cameras(scene: &Scene, path: &Path) -> anyhow::Result<()> {
    let views = scene.test.iter().chain(&scene.train).enumerate();
    let entries: Vec<Entry<'_>> = views.map(|(id, view)| Entry::new(id, view)).collect();
    atomic::write_json(path, &entries)
}
