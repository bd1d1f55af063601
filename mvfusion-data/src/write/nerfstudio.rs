//! nerfstudio: `transforms.json`, `images/` and a point cloud.

use std::collections::BTreeSet;
use std::path::{Component, Path};

use super::encode;
use super::error::Misfit;
use super::package::{Package, PictureEntry};
use super::transforms::{SplitRecord, Transforms};
use crate::scene::{Scene, View};

const POINTS: &str = "points3D.ply";

pub(super) fn package(scene: &Scene) -> Result<Package<'_>, Misfit> {
    check_names(scene)?;
    let pictures: Vec<PictureEntry> = scene.train.iter().chain(&scene.test).map(entry).collect();
    let mut transforms = Transforms::of(&pictures);
    for (frame, picture) in transforms.frames.iter_mut().zip(&pictures) {
        frame.time = Some(picture.view.time);
    }
    let (train, test) = pictures.split_at(scene.train.len());
    let files = |part: &[PictureEntry]| -> Vec<String> { part.iter().map(|entry| entry.file.clone()).collect() };
    transforms.split =
        Some(SplitRecord { train_filenames: files(train), val_filenames: files(test), test_filenames: files(test) });
    transforms.ply_file_path = Some(POINTS.into());
    let files =
        vec![("transforms.json".into(), encode::json(&transforms)?), (POINTS.into(), encode::ply(&scene.points))];
    Ok(Package { pictures, files })
}

fn entry(view: &View) -> PictureEntry<'_> {
    let name = format!("images/{}", view.name);
    let mask = view.mask.as_ref().map(|_| format!("masks/{}.png", view.name));
    PictureEntry { view, file: format!("{name}.png"), name, mask }
}

/// Checks the names of views, because files are named after them. They must be unique paths that stay inside the
/// folder.
fn check_names(scene: &Scene) -> Result<(), Misfit> {
    let mut names = BTreeSet::new();
    for view in scene.train.iter().chain(&scene.test) {
        let path = Path::new(&view.name);
        let inside = path.components().all(|part| matches!(part, Component::Normal(_)));
        // Compared as paths, because `a/b` and `a//b` are one file.
        if !inside || path.file_name().is_none() || !names.insert(path) {
            return Err(format!("the name of its view `{}` cannot be that of a file, or two views have it", view.name));
        }
    }
    Ok(())
}
