//! Problems with images and masks.

use std::fs;
use std::path::Path;

use image::{GrayImage, Luma, Rgb};

use super::*;
use crate::scene::Mask;

const SIZE: (u32, u32) = (96, 72);

/// The sound video with its images in files.
fn on_disk(folder: &Path, extension: &str) -> Scene {
    let mut scene = video();
    for view in all_mut(&mut scene) {
        let path = folder.join(format!("{}.{extension}", view.name.replace('/', "_")));
        view.image.rgb().expect("in memory").save(&path).expect("written");
        view.image = Picture::file(path, SIZE);
    }
    scene
}

fn cut(path: &Path, share: f64) {
    let bytes = fs::read(path).expect("read");
    fs::write(path, &bytes[..(share * bytes.len() as f64) as usize]).expect("written");
}

#[test]
fn whole_files_raise_no_problem() {
    for extension in ["png", "jpg"] {
        let folder = tempfile::tempdir().expect("folder");
        assert_eq!(problems_in(&on_disk(folder.path(), extension), Format::NEU3D), [], "{extension}");
    }
}

#[test]
fn files_that_end_early_are_named() {
    for (extension, share) in [("png", 0.6), ("jpg", 0.6), ("jpg", 0.99)] {
        let folder = tempfile::tempdir().expect("folder");
        let scene = on_disk(folder.path(), extension);
        for name in ["cam02_0003", "cam00_0001"] {
            cut(&folder.path().join(format!("{name}.{extension}")), share);
        }
        let problem = only_problem(&scene);
        assert_eq!((problem.severity, problem.subject), (Severity::Error, Subject::Pictures));
        assert!(problem.what.starts_with("cannot decode 2 files\n"), "{problem:?}");
        assert!(problem.what.contains("cam02_0003") && problem.what.contains("cam00_0001"), "{problem:?}");
    }
}

#[test]
fn a_long_list_of_broken_files_is_cut_and_counted() {
    let folder = tempfile::tempdir().expect("folder");
    let scene = on_disk(folder.path(), "png");
    for view in &scene.train[..30] {
        cut(&folder.path().join(format!("{}.png", view.name.replace('/', "_"))), 0.3);
    }
    let inspection = inspect_scene(&scene, &Origin::default(), Pictures::Decoded);
    let what = &inspection.problems[0].what;
    assert!(what.starts_with("cannot decode 30 files\n") && what.ends_with("\nand 10 more"), "{what}");
    assert_eq!(what.lines().count(), 22);
    assert!(!inspection.can_train());
}

#[test]
fn pictures_of_one_colour_are_named() {
    let mut scene = video();
    scene.train[5].image = in_memory(RgbImage::from_pixel(SIZE.0, SIZE.1, Rgb([7, 8, 9])));
    scene.test[1].image = in_memory(RgbImage::from_pixel(SIZE.0, SIZE.1, Rgb([7, 8, 9])));
    let problem = only_problem(&scene);
    assert_eq!(problem.severity, Severity::Warning);
    assert!(problem.what.contains("2 images of one colour") && problem.what.contains("cam01/0005"), "{problem:?}");
}

#[test]
fn repeated_pictures_are_named_and_held_out_ones_counted() {
    let mut scene = video();
    scene.train[6].image = scene.train[5].image.clone();
    let problem = only_problem(&scene);
    assert!(problem.what.contains("1 repeated image,") && !problem.what.contains("held out"), "{problem:?}");
    assert!(problem.what.contains("cam01/0006, equal to cam01/0005"), "{problem:?}");
    scene.test[0].image = scene.train[11].image.clone();
    let problem = only_problem(&scene);
    assert!(problem.what.contains("2 repeated images,") && problem.what.contains("held out are 1"), "{problem:?}");
}

#[test]
fn masks_of_what_moves_that_training_would_stop_at_are_errors() {
    let masks = tempfile::tempdir().expect("folder");
    let problems = |scene: &mut Scene| {
        let mut inspection = inspect_scene(scene, &Origin::default(), Pictures::Headers);
        inspection.attach_masks(scene, masks.path());
        assert_eq!(inspection.can_train(), inspection.problems.is_empty());
        inspection.problems
    };
    let mut scene = video();
    assert!(problems(&mut scene)[0].what.contains("no mask of any view"));
    fs::create_dir(masks.path().join("cam00")).expect("folder");
    let file = masks.path().join("cam00/0003.png");
    GrayImage::new(SIZE.0, SIZE.1).save(&file).expect("written");
    assert_eq!(problems(&mut scene), []);
    cut(&file, 0.7);
    assert!(problems(&mut scene)[0].what.contains("0003.png"));
}

#[test]
fn masks_that_leave_little_are_told() {
    let masked = |width: u32| {
        let mut scene = video();
        let mask = GrayImage::from_fn(SIZE.0, SIZE.1, |x, _| Luma([if x < width { 255 } else { 0 }]));
        let picture = in_memory(image::DynamicImage::from(mask).into_rgb8());
        scene.train[3].mask = Some(Mask { picture, inverted: false });
        problems_in(&scene, Format::NEU3D)
    };
    assert_eq!(masked(90), []);
    let few = masked(24);
    assert!(few.len() == 1 && few[0].severity == Severity::Note && few[0].what.contains("leave 25 %"), "{few:?}");
    let none = masked(0);
    assert!(none[0].severity == Severity::Warning && none[0].what.contains("next to nothing"), "{none:?}");
}
