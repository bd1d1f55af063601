//! What the pictures' way into training must not change: how many are kept decoded, and what masks ignore.

use std::path::Path;
use std::sync::Arc;

use image::{Luma, RgbImage};
use mvfusion_data::{Mask, Picture, Scene};
use mvfusion_model::config::Config;
use mvfusion_model::train::Trainer;
use mvfusion_tests::backends;

use crate::training::{config, hash, scene, train};

/// The scene with its training pictures in files.
fn on_disk(scene: &Scene, folder: &Path) -> Scene {
    let mut scene = scene.clone();
    for (number, view) in scene.train.iter_mut().enumerate() {
        let path = folder.join(format!("{number}.png"));
        let image = view.image.rgb().expect("in memory");
        image.save(&path).expect("written");
        view.image = Picture::file(path, image.dimensions());
    }
    scene
}

/// A run of the given configuration to its end.
fn trained(config: &Config, scene: &Scene, image_cache: u64) -> Trainer {
    let device = (backends()[0].device)();
    let trainer = Trainer::new(config.clone(), scene, &device).expect("the run can start");
    let mut trainer = trainer.with_image_cache(image_cache).expect("the pictures can be read");
    train(&mut trainer);
    trainer
}

#[test]
fn a_run_is_the_same_however_few_pictures_are_kept() {
    let folder = tempfile::tempdir().expect("folder");
    let scene = on_disk(&scene(), folder.path());
    let (width, height) = scene.train[0].image.size();
    let picture = 3 * u64::from(width) * u64::from(height);
    let all = hash(&trained(&config(), &scene, u64::MAX));
    assert_eq!(hash(&trained(&config(), &scene, 3 * picture)), all);
    assert_eq!(hash(&trained(&config(), &scene, 0)), all);
}

/// The scene with masks that ignore the upper part of every picture, and something else in its place.
fn masked(scene: &Scene, folder: &Path, upper_part: impl Fn(u32, u32) -> [u8; 3]) -> Scene {
    let mut scene = scene.clone();
    for (number, view) in scene.train.iter_mut().enumerate() {
        let image = view.image.rgb().expect("in memory");
        let (width, height) = image.dimensions();
        let is_ignored = |y: u32| y < height / 3;
        let path = folder.join(format!("mask{number}.png"));
        let mask = image::GrayImage::from_fn(width, height, |_, y| Luma([if is_ignored(y) { 0 } else { 255 }]));
        mask.save(&path).expect("written");
        view.mask = Some(Mask { picture: Picture::file(path, (width, height)), inverted: false });
        let changed = |x, y| if is_ignored(y) { image::Rgb(upper_part(x, y)) } else { *image.get_pixel(x, y) };
        view.image = Picture::Memory(Arc::new(RgbImage::from_fn(width, height, changed)));
    }
    scene
}

#[test]
fn what_a_mask_ignores_does_not_train() {
    let folder = tempfile::tempdir().expect("folder");
    let plain = scene();
    let black = masked(&plain, folder.path(), |_, _| [0; 3]);
    let noise = masked(&plain, folder.path(), |x, y| [(37 * x + 11 * y) as u8, (x * y) as u8, 200]);
    let trainer = trained(&config(), &black, u64::MAX);
    assert_eq!(hash(&trainer), hash(&trained(&config(), &noise, u64::MAX)));
    assert_ne!(hash(&trainer), hash(&trained(&config(), &plain, u64::MAX)));
}
