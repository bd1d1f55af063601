//! The contact sheet.

use super::*;
use crate::inspect::sight::pixel;

#[test]
fn the_sheet_shows_first_middle_and_last_and_a_held_out_view() {
    let scene = video();
    let sheet = points_over_photos(&scene, 4, 700).expect("drawn");
    assert_eq!(sheet.names, ["cam01/0000", "cam04/0003", "cam07/0007", "cam00/0004"]);
    assert_eq!(sheet.columns, 2);
    assert!(sheet.image.width() <= 700 && sheet.image.height() <= 700, "{:?}", sheet.image.dimensions());
    assert!(sheet.image.width() > 560, "photos are enlarged up to three times");
}

#[test]
fn points_are_drawn_where_they_fall() {
    let mut scene = video();
    scene.points.positions.truncate(1);
    scene.points.colours.truncate(1);
    let view = &scene.train[0];
    let at = pixel(&view.camera, scene.points.positions[0].as_dvec3()).expect("inside");
    // At its own size, inside a border.
    let border = 6.0;
    let sheet = points_over_photos(&scene, 1, 96 + 12).expect("drawn").image;
    let drawn = sheet.get_pixel((at.x + border) as u32, (at.y + border) as u32).0;
    assert!(drawn[0] > 200 && drawn[1] < 80 && drawn[2] < 80, "the nearest point is red, not {drawn:?}");
}

#[test]
fn a_sheet_without_points_still_shows_photos() {
    let mut scene = sound(BuiltinKind::Casual);
    scene.points = Default::default();
    scene.test.clear();
    let sheet = points_over_photos(&scene, 100, 800).expect("drawn");
    assert_eq!(sheet.names.len(), 20);
    assert!(sheet.image.width() <= 800 && sheet.image.height() <= 800);
}
