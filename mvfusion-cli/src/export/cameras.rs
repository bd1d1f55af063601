//! `cameras.json` as 3DGS writes it.

use std::path::Path;

use mvfusion_data::files::read_text;
use mvfusion_data::{Camera, Scene, View};
use serde::Serialize;

use crate::atomic;
use crate::run::MOST_OF_RECORDS;

/// The cameras of all views.
pub const CAMERAS: &str = "cameras.json";

/// A camera of 3DGS, with its principal point. 3DGS has none, and its viewers assume the centre of the image.
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
    cx: f64,
    cy: f64,
}

impl<'a> Entry<'a> {
    fn new(id: usize, view: &'a View) -> Self {
        let Camera { width, height, fx, fy, cx, cy, rotation, .. } = view.camera;
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
            cx,
            cy,
        }
    }
}

/// The keys of an entry, in the order in which they are written.
const KEYS: [&str; 10] = ["id", "img_name", "width", "height", "position", "rotation", "fx", "fy", "cx", "cy"];
/// How many of them former versions wrote.
const FORMER: usize = 8;

/// Whether the cameras in a folder were written here: each key on a line of its own, in our order. 3DGS writes one line,
/// with `fy` before `fx`. A field that names the program would be known as well, but others read this file.
pub(super) fn is_ours(folder: &Path) -> bool {
    read_text(&folder.join(CAMERAS), MOST_OF_RECORDS).is_ok_and(|text| is_own_text(&text))
}

fn is_own_text(text: &str) -> bool {
    let Some(entries) = text.strip_prefix("[\n  {\n") else { return false };
    let Some((first, _)) = entries.split_once("\n  }") else { return false };
    // Deeper lines are numbers, and shallower ones end a list.
    let keys = first.lines().filter_map(|line| line.strip_prefix("    \"")?.split_once("\": ")).map(|(key, _)| key);
    let keys: Vec<&str> = keys.collect();
    keys == KEYS || keys == KEYS[..FORMER]
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

#[cfg(test)]
mod tests {
    use std::fs;

    use super::*;

    #[test]
    fn cameras_are_known_as_ours_and_those_of_other_programs_are_not() {
        let entry = Entry {
            id: 0,
            img_name: "a \"b\"",
            width: 4,
            height: 3,
            position: [0.5, 1.0, 2.0],
            rotation: [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]],
            fx: 7.0,
            fy: 8.0,
            cx: 2.5,
            cy: 1.5,
        };
        let folder = tempfile::tempdir().expect("folder");
        assert!(!is_ours(folder.path()), "there is none");
        let path = folder.path().join(CAMERAS);
        for count in [1, 2] {
            atomic::write_json(&path, &vec![entry.clone(); count]).expect("written");
            assert!(is_ours(folder.path()), "{}", fs::read_to_string(&path).expect("read"));
        }
        let own = fs::read_to_string(&path).expect("read");
        fs::write(&path, own.replace(",\n    \"cx\": 2.5,\n    \"cy\": 1.5", "")).expect("written");
        assert!(is_ours(folder.path()), "of a former version");
        for other in [
            // Cameras of another program, with the same names in the same order.
            serde_json::to_string(&[&entry]).expect("JSON"),
            own.replace("    \"id\"", "    \"camera\": 1,\n    \"id\""),
            own.replace("\"img_name\"", "\"name\""),
            own.replace("  ", "    "),
            "{ \"fx\": 1, \"fy\": 1 }".to_owned(),
            String::new(),
        ] {
            fs::write(&path, &other).expect("written");
            assert!(!is_ours(folder.path()), "{other}");
        }
    }
}
