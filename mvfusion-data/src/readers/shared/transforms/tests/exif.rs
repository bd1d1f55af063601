//! Photos that are stored on their side, with an EXIF orientation.

use image::{Rgb, RgbImage};

use super::*;
use crate::inspect::{Pictures, inspect};
use crate::scene::{ExifOrientation, Picture};

/// As phones ask for a photo to be turned clockwise by a quarter.
const CLOCKWISE: u8 = 6;

/// By a half.
const UPSIDE_DOWN: u8 = 3;

/// Writes a photo whose left half is white, with an EXIF segment.
fn write_photo(folder: &SceneFolder, (width, height): (u32, u32), orientation: u8) {
    let photo = RgbImage::from_fn(width, height, |x, _| Rgb([if x < width / 2 { 255 } else { 0 }; 3]));
    photo.save(folder.at("a.jpg")).expect("written");
    let bytes = fs::read(folder.at("a.jpg")).expect("read");
    // A big-endian TIFF header and a directory of one entry: the tag 0x112, a short.
    let tiff = [b"MM\0*\0\0\0\x08\0\x01\x01\x12\0\x03\0\0\0\x01\0", &[orientation][..], &[0; 6]].concat();
    let length = (tiff.len() + 8) as u16;
    let segment = [&[0xff, 0xe1][..], &length.to_be_bytes(), b"Exif\0\0", &tiff].concat();
    folder.write("a.jpg", [&bytes[..2], &segment, &bytes[2..]].concat());
}

/// A scene of that photo, whose camera is for `width` x `height`.
fn write_scene(folder: &SceneFolder, (width, height): (u32, u32)) {
    let frames = vec![frame("a.jpg", 0.0)];
    folder.write_json("transforms.json", &json!({ "fl_x": 40.0, "w": width, "h": height, "frames": frames }));
}

/// The only photo trains.
fn options() -> ReadOptions {
    ReadOptions { test_every: 0, ..ReadOptions::default() }
}

/// What becomes of the orientation, the size, and on which side the picture is white: left, top, right or below.
fn shown_as(folder: &SceneFolder) -> (ExifOrientation, (u32, u32), &'static str) {
    let view = folder.open_with(options()).expect("read").train.remove(0);
    let Picture::File(file) = &view.image else { panic!("made as a file") };
    let picture = view.image.rgb().expect("decoded");
    let (width, height) = picture.dimensions();
    assert_eq!((view.camera.width, view.camera.height), (width as usize, height as usize));
    let is_white = |x: u32, y: u32| picture.get_pixel(x, y).0[0] > 200;
    let [top_left, top_right, below_left] = [is_white(2, 2), is_white(width - 3, 2), is_white(2, height - 3)];
    let side = match (top_left, top_right, below_left) {
        (true, false, true) => "left",
        (true, true, false) => "top",
        (false, true, false) => "right",
        _ => "below",
    };
    (file.exif, (width, height), side)
}

#[test]
fn a_photo_is_turned_only_where_the_camera_is_for_the_turned_one() {
    let folder = SceneFolder::new();
    write_photo(&folder, (48, 32), CLOCKWISE);
    write_scene(&folder, (32, 48));
    assert_eq!(shown_as(&folder), (ExifOrientation::Applied, (32, 48), "top"));
    // A camera for images twice as large.
    write_scene(&folder, (64, 96));
    assert_eq!(shown_as(&folder), (ExifOrientation::Applied, (32, 48), "top"));
    write_scene(&folder, (48, 32));
    assert_eq!(shown_as(&folder), (ExifOrientation::Ignored, (48, 32), "left"));
}

#[test]
fn a_photo_that_fits_either_way_is_used_as_it_is_stored() {
    let folder = SceneFolder::new();
    for (size, orientation) in [((40, 40), CLOCKWISE), ((48, 32), UPSIDE_DOWN)] {
        write_photo(&folder, size, orientation);
        write_scene(&folder, size);
        assert_eq!(shown_as(&folder), (ExifOrientation::Ignored, size, "left"));
    }
}

#[test]
fn a_photo_that_fits_neither_way_is_refused() {
    let folder = SceneFolder::new();
    write_photo(&folder, (48, 32), CLOCKWISE);
    write_scene(&folder, (48, 48));
    let message = folder.open_with(options()).expect_err("refused").to_string();
    assert!(message.contains("48 x 32") && message.contains("48 x 48"), "{message}");
}

#[test]
fn check_tells_what_became_of_the_orientation() {
    let folder = SceneFolder::new();
    write_photo(&folder, (48, 32), CLOCKWISE);
    let said = || {
        let problems = inspect(folder.path(), &options(), Pictures::Headers).0.problems;
        let of_exif: Vec<_> = problems.into_iter().map(|problem| problem.what).filter(|w| w.contains("EXIF")).collect();
        of_exif.join("; ")
    };
    for (camera, words) in [((32, 48), "which is applied"), ((48, 32), "which is not applied")] {
        write_scene(&folder, camera);
        let said = said();
        assert!(said.contains("1 image has") && said.contains(words) && said.contains("(a)"), "{said}");
    }
}
