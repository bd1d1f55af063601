//! NeRF On-the-go as published: `images/`, `transforms.json` and `split.json`.

use serde::Serialize;

use super::error::Misfit;
use super::package::{Package, PictureEntry};
use super::transforms::Transforms;
use super::{encode, photos};
use crate::scene::Scene;

/// `split.json`: indices into the sorted names of the photos.
#[derive(Serialize)]
struct Split {
    clutter: Vec<usize>,
    extra: Vec<usize>,
    clean: Vec<usize>,
}

pub(super) fn package(scene: &Scene) -> Result<Package<'_>, Misfit> {
    // The reader names views by the paths in `transforms.json`.
    let mut pictures = photos::entries(scene, "");
    for entry in &mut pictures {
        entry.name = format!("images/{}", entry.name);
    }
    let mut sorted: Vec<&str> = pictures.iter().map(|entry| entry.file.as_str()).collect();
    sorted.sort();
    let places = |part: &[PictureEntry<'_>]| -> Vec<usize> {
        part.iter().map(|entry| sorted.partition_point(|file| *file < entry.file.as_str())).collect()
    };
    let (train, test) = pictures.split_at(scene.train.len());
    let split = Split { clutter: places(train), extra: places(test), clean: Vec::new() };
    let files = vec![
        ("transforms.json".into(), encode::json(&Transforms::of(&pictures))?),
        ("split.json".into(), encode::json(&split)?),
        ("points3D.ply".into(), encode::ply(&scene.points)),
    ];
    Ok(Package { pictures, files })
}
