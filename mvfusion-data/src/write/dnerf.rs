//! D-NeRF: `transforms_{train,val,test}.json`, with one field of view for all cameras, and the images next to them.

use serde::Serialize;

use super::error::Misfit;
use super::package::{Package, PictureEntry};
use super::transforms::FrameRecord;
use super::{encode, poses};
use crate::scene::{Scene, View};

#[derive(Serialize)]
struct Transforms {
    camera_angle_x: f64,
    frames: Vec<FrameRecord>,
}

pub(super) fn package(scene: &Scene) -> Result<Package<'_>, Misfit> {
    let first = &scene.train[0].camera;
    for view in scene.train.iter().chain(&scene.test) {
        if !poses::is_plain(&view.camera) {
            let name = &view.name;
            return Err(format!("the pixels of {name} are not square, or its principal point is not in the middle"));
        }
        if !poses::same_focal(first, &view.camera) {
            return Err(format!("{} and {} have different focal lengths", scene.train[0].name, view.name));
        }
    }
    let train: Vec<PictureEntry> = scene.train.iter().enumerate().map(|at| entry("train", at)).collect();
    let test: Vec<PictureEntry> = scene.test.iter().enumerate().map(|at| entry("test", at)).collect();
    let (train_file, test_file) = (transforms(&train)?, transforms(&test)?);
    Ok(Package {
        pictures: [train, test].concat(),
        files: vec![
            ("transforms_train.json".into(), train_file),
            ("transforms_val.json".into(), test_file.clone()),
            ("transforms_test.json".into(), test_file),
            ("fused.ply".into(), encode::ply(&scene.points)),
        ],
    })
}

fn entry<'a>(part: &str, (index, view): (usize, &'a View)) -> PictureEntry<'a> {
    let name = format!("{part}/r_{index:03}");
    let mask = view.mask.as_ref().map(|_| format!("masks/{name}.png"));
    PictureEntry { view, file: format!("{name}.png"), name, mask }
}

fn transforms(entries: &[PictureEntry<'_>]) -> Result<Vec<u8>, Misfit> {
    let frame = |entry: &PictureEntry<'_>| FrameRecord {
        time: Some(entry.view.time),
        ..FrameRecord::of(entry, format!("./{}", entry.name)) // Without the extension, as in the original.
    };
    let camera_angle_x = entries.first().map_or(0.0, |entry| entry.view.camera.field_of_view().x);
    encode::json(&Transforms { camera_angle_x, frames: entries.iter().map(frame).collect() })
}
