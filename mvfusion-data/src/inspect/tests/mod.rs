//! Sound scenes have no problem, and each damage is named.

mod folders;
mod pictures;
mod places;
mod poses;
mod sheet;

use std::sync::{Arc, OnceLock};

use image::RgbImage;

use super::*;
use crate::builtin::{BuiltinKind, BuiltinOptions, builtin};
use crate::scene::{Picture, View};

/// A small sound scene, created once for all tests.
fn sound(kind: BuiltinKind) -> Scene {
    static VIDEO: OnceLock<Scene> = OnceLock::new();
    static MOTION: OnceLock<Scene> = OnceLock::new();
    static CASUAL: OnceLock<Scene> = OnceLock::new();
    let place = match kind {
        BuiltinKind::Video => &VIDEO,
        BuiltinKind::Motion => &MOTION,
        BuiltinKind::Casual => &CASUAL,
    };
    let make = || {
        builtin(&BuiltinOptions {
            kind,
            width: 96,
            height: 72,
            frames: 8,
            photos: 20,
            test_photos: 4,
            ..Default::default()
        })
    };
    place.get_or_init(make).clone()
}

fn video() -> Scene {
    sound(BuiltinKind::Video)
}

/// The problems of a scene in the format `format`, with all images decoded.
fn problems_in(scene: &Scene, format: Format) -> Vec<Problem> {
    inspect_scene(scene, &Origin { format: Some(format), ..Default::default() }, Pictures::Decoded).problems
}

/// The one problem of a scene.
fn only_problem(scene: &Scene) -> Problem {
    let mut problems = problems_in(scene, Format::NEU3D);
    assert_eq!(problems.len(), 1, "{problems:#?}");
    problems.remove(0)
}

fn all_mut(scene: &mut Scene) -> impl Iterator<Item = &mut View> {
    scene.train.iter_mut().chain(&mut scene.test)
}

fn in_memory(image: RgbImage) -> Picture {
    Picture::Memory(Arc::new(image))
}

#[test]
fn sound_scenes_have_no_problem_however_closely_they_are_looked_at() {
    for kind in [BuiltinKind::Video, BuiltinKind::Casual] {
        for pictures in [Pictures::Headers, Pictures::Sampled, Pictures::Decoded] {
            let inspection = inspect_scene(&sound(kind), &Origin::default(), pictures);
            assert!(inspection.problems.is_empty(), "{kind:?} {pictures:?}: {:#?}", inspection.problems);
            assert!(inspection.can_train());
        }
    }
}

#[test]
fn the_summary_counts_what_is_there() {
    let summary = inspect_scene(&video(), &Origin::default(), Pictures::Sampled).summary.expect("read");
    assert_eq!((summary.cameras, summary.views_per_camera), (8, [8, 8]));
    assert_eq!((summary.train, summary.test, summary.moments), (56, 8, 8));
    assert_eq!((summary.times, summary.decoded), ([0.0, 0.875], 8));
    assert_eq!((summary.width, summary.height, summary.decoded_bytes), (96, 72, 3 * 96 * 72 * 64));
    assert!((summary.field_of_view[0] - 62.7).abs() < 0.1, "{:?}", summary.field_of_view);
    assert!(summary.points_seen > Some(0.8) && summary.colour_agreement > Some(0.8), "{summary:?}");
}

#[test]
fn headers_alone_say_nothing_of_colours() {
    let summary = inspect_scene(&video(), &Origin::default(), Pictures::Headers).summary.expect("read");
    assert_eq!((summary.decoded, summary.colour_agreement), (0, None));
}

#[test]
fn the_worst_problem_comes_first_and_reads_as_json() {
    let mut scene = video();
    scene.test.clear();
    scene.train[3].time = 7.0;
    let inspection = inspect_scene(&scene, &Origin::default(), Pictures::Headers);
    let json = serde_json::to_value(&inspection).expect("json");
    assert_eq!(json["problems"][0]["severity"], "error");
    assert_eq!(json["problems"][0]["subject"], "times");
    assert_eq!(json["problems"][1]["severity"], "warning");
    assert_eq!(json["summary"]["capture"], "video");
    assert!(!inspection.can_train());
}
