//! Masks of valid pixels, and of what moves.

use super::*;
use crate::inspect::{Pictures, Severity, Subject, inspect};
use crate::readers::attach_masks;

#[test]
fn masks_that_are_named_like_no_photo_are_told() {
    let fixture = Fixture::new(&NAMES);
    let told = || {
        let (inspection, scene) = inspect(fixture.0.path(), &ReadOptions::default(), Pictures::Headers);
        assert!(scene.is_some());
        inspection.problems.into_iter().filter(|problem| problem.subject == Subject::Masks).collect::<Vec<_>>()
    };
    assert_eq!(told(), []);
    // Hidden files and empty folders are no masks.
    fixture.write("masks/.DS_Store", "");
    fs::create_dir(fixture.at("masks/empty")).expect("made");
    assert_eq!(told(), []);
    fixture.write_photo("masks/mask_0.png", SIZE, [255; 3]);
    let [problem] = &told()[..] else { panic!("one problem") };
    assert_eq!(problem.severity, Severity::Warning);
    let parts = ["masks/ contains 1 file, but none is named like an image", "2clutter002.png or 2clutter002.png.png"];
    assert_says(&problem.what, &parts);
    fixture.write_photo("masks/images/mask_1.png", SIZE, [255; 3]);
    assert_says(&told()[0].what, &["masks/ contains 2 files"]);
    fixture.write_photo("masks/2clutter002.png", SIZE, [255; 3]);
    assert_eq!(told(), []);
}

#[test]
fn masks_are_found_by_the_names_of_the_photos() {
    let fixture = Fixture::new(&NAMES);
    let mut scene = fixture.read().expect("read");
    fixture.write_photo("masks/2clutter002.png", SIZE, [255; 3]);
    fixture.write_photo("masks/1extra000.png", SIZE, [0; 3]);
    fs::rename(fixture.at("masks/1extra000.png"), fixture.at("masks/1extra000.PNG")).expect("renamed");
    assert_eq!(attach_masks(&mut scene, &fixture.at("masks")).expect("attached"), 2);
    let mask = scene.train[0].truth.dynamic_mask.as_ref().expect("attached").mask().expect("mask");
    assert_eq!((mask.dimensions(), mask.get_pixel(40, 20).0), (SIZE, [255]));
    assert!(scene.train[1].truth.dynamic_mask.is_none());
}
