//! The built-in scenes have the properties that other tests and the quick start rely on.

use std::sync::LazyLock;

use glam::{DVec2, DVec3};

use super::*;

/// A one-colour image must have a lower PSNR than this, so that a higher PSNR is meaningful.
const FLAT_PSNR: f64 = 16.0;
/// Fraction of the pixels that moving objects cover.
const COVERAGE: std::ops::RangeInclusive<f64> = 0.04..=0.15;
/// Depths are stored in single precision and are below ten metres.
const DEPTH_ROUNDING: f64 = 1e-5;
/// Width in pixels of the mask's edge where coverage may be less than half: one, and one more for corners.
const EDGE: i64 = 2;

/// The default scene of each kind, made once for all tests of this file.
fn scene(kind: BuiltinKind) -> &'static Scene {
    static VIDEO: LazyLock<Scene> = LazyLock::new(|| builtin(&BuiltinOptions::of_kind(BuiltinKind::Video)));
    static MOTION: LazyLock<Scene> = LazyLock::new(|| builtin(&BuiltinOptions::of_kind(BuiltinKind::Motion)));
    static CASUAL: LazyLock<Scene> = LazyLock::new(|| builtin(&BuiltinOptions::of_kind(BuiltinKind::Casual)));
    match kind {
        BuiltinKind::Video => &VIDEO,
        BuiltinKind::Motion => &MOTION,
        BuiltinKind::Casual => &CASUAL,
    }
}

fn rgb(picture: &Picture) -> Arc<RgbImage> {
    picture.rgb().expect("in memory")
}

fn background(view: &View) -> Arc<RgbImage> {
    rgb(view.truth.background.as_ref().expect("known"))
}

fn mask(view: &View) -> GrayImage {
    view.truth.dynamic_mask.as_ref().expect("known").mask().expect("in memory")
}

fn movers_mask(view: &View) -> GrayImage {
    view.truth.movers_mask.as_ref().expect("known").mask().expect("in memory")
}

/// PSNR of an image of the mean colour, in decibels.
fn flat_psnr(image: &RgbImage) -> f64 {
    let count = f64::from(image.width() * image.height());
    let variance = |channel: usize| {
        let values = || image.pixels().map(|p| f64::from(p.0[channel]) / 255.0);
        let mean = values().sum::<f64>() / count;
        values().map(|v| (v - mean).powi(2)).sum::<f64>() / count
    };
    -10.0 * ((0..3).map(variance).sum::<f64>() / 3.0).log10()
}

fn mean(values: impl ExactSizeIterator<Item = f64>) -> f64 {
    let count = values.len() as f64;
    values.sum::<f64>() / count
}

fn small(kind: BuiltinKind) -> BuiltinOptions {
    BuiltinOptions { width: 40, height: 30, frames: 3, photos: 5, test_photos: 2, seed: 7, kind }
}

fn assert_equal(a: &Scene, b: &Scene) {
    assert_eq!((&a.points, a.train.len(), a.test.len()), (&b.points, b.train.len(), b.test.len()));
    for (a, b) in a.train.iter().chain(&a.test).zip(b.train.iter().chain(&b.test)) {
        assert_eq!((&a.name, a.camera, a.time, &a.truth.depth), (&b.name, b.camera, b.time, &b.truth.depth));
        assert_eq!((rgb(&a.image), background(a)), (rgb(&b.image), background(b)));
    }
}

#[test]
fn the_video_has_eight_cameras_and_holds_out_the_first() {
    let scene = scene(BuiltinKind::Video);
    assert_eq!((scene.train.len(), scene.test.len(), scene.capture), (7 * 24, 24, Capture::Video));
    assert_eq!((scene.test[3].name.as_str(), scene.test[3].time), ("cam00/0003", 3.0 / 24.0));
    assert_eq!(scene.train[24 + 7].name, "cam02/0007");
    assert_eq!(scene.training_times().len(), 24);
    assert_eq!((scene.train[0].camera.width, scene.train[0].camera.height), (160, 120));
}

#[test]
fn the_photos_are_single_and_the_held_out_ones_are_empty() {
    let scene = scene(BuiltinKind::Casual);
    assert_eq!((scene.train.len(), scene.test.len(), scene.capture), (60, 10, Capture::Photos));
    assert_eq!((scene.train[0].time, scene.train[59].time), (0.0, 1.0));
    assert_eq!(scene.training_times().len(), 60);
    for view in &scene.test {
        assert!(view.truth.dynamic_mask.is_none() && rgb(&view.image) == background(view));
        let near = scene.train.iter().map(|v| v.camera.centre().distance(view.camera.centre()));
        assert!(near.fold(f64::INFINITY, f64::min) < 0.3, "held-out poses lie between training poses");
    }
}

#[test]
fn a_flat_picture_scores_badly_on_the_held_out_views() {
    for kind in BuiltinKind::ALL {
        let psnr = mean(scene(kind).test.iter().map(|v| flat_psnr(&rgb(&v.image))));
        assert!(psnr < FLAT_PSNR, "{kind:?}: {psnr}");
    }
}

#[test]
fn moving_things_cover_a_small_part_of_the_pictures() {
    for kind in BuiltinKind::ALL {
        let share = |m: GrayImage| m.pixels().filter(|p| p.0[0] == 255).count() as f64 / m.pixels().len() as f64;
        let coverage = mean(scene(kind).train.iter().map(|v| share(mask(v))));
        assert!(COVERAGE.contains(&coverage), "{kind:?}: {coverage}");
    }
}

#[test]
fn outside_the_mask_the_picture_is_its_background() {
    for kind in BuiltinKind::ALL {
        for view in scene(kind).train.iter().step_by(5) {
            let (image, background, mask) = (rgb(&view.image), background(view), mask(view));
            let covered = |x: i64, y: i64| mask.get_pixel_checked(x as u32, y as u32).is_some_and(|p| p.0[0] == 255);
            let beside = |x: u32, y: u32| {
                let (x, y) = (i64::from(x), i64::from(y));
                // The lamp's cord is thinner than a pixel. Where it covers less than half, no mask is nearby.
                let cord = kind == BuiltinKind::Video && x > 70 && y < 40;
                cord || (-EDGE..=EDGE).any(|dx| (-EDGE..=EDGE).any(|dy| covered(x + dx, y + dy)))
            };
            for (x, y, pixel) in image.enumerate_pixels() {
                assert!(pixel == background.get_pixel(x, y) || beside(x, y), "{} at {x}, {y}", view.name);
            }
        }
    }
}

#[test]
fn a_moving_object_is_seen_where_its_trajectory_says() {
    let options = BuiltinOptions::of_kind(BuiltinKind::Video);
    let scene = scene(BuiltinKind::Video);
    for view in scene.train.iter().chain(&scene.test) {
        let objects = moving_objects(&options, view.time);
        let block = objects.iter().find(|o| o.name == "block").expect("always there");
        let pixel = view.camera.project(block.pose.position).expect("in front");
        assert_eq!(mask(view).get_pixel(pixel.x as u32, pixel.y as u32).0[0], 255, "{}", view.name);
        let index = pixel.y as usize * view.camera.width + pixel.x as usize;
        let depth = f64::from(view.truth.depth.as_ref().expect("known")[index]);
        assert!(depth < view.camera.to_camera(block.pose.position).z, "its front is nearer than its middle");
    }
}

#[test]
fn the_visitor_is_there_for_part_of_the_video() {
    let options = BuiltinOptions::of_kind(BuiltinKind::Video);
    let there = |i: usize| moving_objects(&options, i as f64 / 24.0).iter().any(|o| o.name == "visitor");
    let frames = (0..24).filter(|&i| there(i)).count();
    assert!(!there(0) && !there(23) && (6..=14).contains(&frames), "{frames}");
}

#[test]
fn the_lamp_moves_by_less_than_a_pixel() {
    let options = BuiltinOptions::of_kind(BuiltinKind::Video);
    let camera = scene(BuiltinKind::Video).test[0].camera;
    let globe = |i: usize| {
        let objects = moving_objects(&options, i as f64 / 24.0);
        let lamp = objects.iter().find(|o| o.name == "lamp").expect("always there");
        camera.project(lamp.pose.place(DVec3::new(0.0, 0.0, -1.05))).expect("in front")
    };
    let rest = globe(0);
    let sway = (0..24).map(|i| (globe(i) - rest).length()).fold(0.0, f64::max);
    assert!((0.1..1.0).contains(&sway), "{sway}");
}

#[test]
fn the_movers_of_the_video_are_block_and_visitor_and_not_the_lamp() {
    let options = BuiltinOptions::of_kind(BuiltinKind::Video);
    let scene = scene(BuiltinKind::Video);
    let (mut visitors, mut lamps) = (0, 0);
    for view in &scene.test {
        let objects = moving_objects(&options, view.time);
        let (mask, movers) = (mask(view), movers_mask(view));
        assert!(movers.pixels().zip(mask.pixels()).all(|(mover, moving)| mover.0[0] <= moving.0[0]), "{}", view.name);
        let seen = |name: &str, local: DVec3| {
            let place = objects.iter().find(|o| o.name == name).map(|o| o.pose.place(local))?;
            let pixel = view.camera.project(place).expect("in front");
            let depth = view.truth.depth.as_ref().expect("known")[pixel.y as usize * 160 + pixel.x as usize];
            // Nothing else is in front of its middle.
            let is_seen = (f64::from(depth) - view.camera.to_camera(place).z).abs() < 0.6;
            is_seen.then(|| [&mask, &movers].map(|m| m.get_pixel(pixel.x as u32, pixel.y as u32).0[0]))
        };
        assert_eq!(seen("block", DVec3::ZERO), Some([255, 255]), "{}", view.name);
        if let Some(found) = seen("visitor", DVec3::new(0.0, 0.0, 0.7)) {
            assert_eq!(found, [255, 255], "{}", view.name);
            visitors += 1;
        }
        let globe = seen("lamp", DVec3::new(0.0, 0.0, -1.05)).expect("it hangs above all");
        // The block may fly in front of it.
        lamps += usize::from(globe == [255, 0]);
    }
    assert!(visitors >= 3 && lamps >= 20, "{visitors} {lamps}");
}

#[test]
fn in_the_photos_whatever_moves_is_a_mover() {
    for options in [BuiltinOptions::of_kind(BuiltinKind::Casual), small(BuiltinKind::Casual)] {
        for view in &builtin(&options).train {
            assert_eq!(movers_mask(view), mask(view), "{}", view.name);
        }
    }
    assert!(scene(BuiltinKind::Casual).test.iter().all(|view| view.truth.movers_mask.is_none()));
}

#[test]
fn some_people_linger_and_toys_never_stay() {
    let options = BuiltinOptions::of_kind(BuiltinKind::Casual);
    let at = |i: usize| moving_objects(&options, i as f64 / 59.0);
    let (mut lingering, mut resting) = (0, 0);
    for i in 1..60 {
        for object in at(i) {
            let before = at(i - 1).into_iter().find(|o| o.name == object.name);
            let moved = before.map_or(f64::INFINITY, |o| o.pose.position.distance(object.pose.position));
            lingering += usize::from(object.name.starts_with("lingerer") && moved < 0.1);
            resting += usize::from(object.name.starts_with("toy") && moved < 0.02);
        }
    }
    assert!(lingering >= 15 && resting == 0, "{lingering} {resting}");
}

#[test]
fn a_pixel_with_its_depth_is_the_point_that_other_cameras_see_there() {
    for kind in BuiltinKind::ALL {
        let scene = scene(kind);
        let still = stage::still_solids(BuiltinOptions::of_kind(kind).pattern_seed());
        for view in scene.train.iter().step_by(7) {
            let (camera, depth) = (view.camera, view.truth.depth.as_ref().expect("known"));
            for index in (0..depth.len()).step_by(997) {
                let pixel = DVec2::new((index % camera.width) as f64 + 0.5, (index / camera.width) as f64 + 0.5);
                let ray = shot::ray_through(&camera, pixel);
                let point = ray.origin + f64::from(depth[index]) * ray.direction;
                assert!((camera.project(point).expect("in front") - pixel).length() < 1e-9);
                assert!((camera.to_camera(point).z - f64::from(depth[index])).abs() < 1e-9);
                let front = solids_at(&BuiltinOptions::of_kind(kind), view.time, &Movers::default());
                let seen = shot::first_seen(&ray, still.iter().chain(&front)).expect("the room is closed");
                assert!((seen.depth - f64::from(depth[index])).abs() < DEPTH_ROUNDING * seen.depth.max(1.0));
            }
        }
    }
}

#[test]
fn points_lie_on_still_surfaces_near_where_two_cameras_see_them() {
    for kind in BuiltinKind::ALL {
        let scene = scene(kind);
        assert_eq!((scene.points.len(), scene.points.colours.len()), (sparse_points::WANTED, sparse_points::WANTED));
        assert!(scene.points.colours.iter().all(|c| c.cmpge(glam::Vec3::ZERO).all() && c.cmple(glam::Vec3::ONE).all()));
        // Without noise, a point would be on a surface: its depth in some view is that of the background.
        let still = stage::still_solids(BuiltinOptions::of_kind(kind).pattern_seed());
        for position in scene.points.positions.iter().step_by(40).map(|p| p.as_dvec3()) {
            let agrees = |view: &&View| {
                let Some(pixel) = view.camera.project(position) else { return false };
                let ray = shot::ray_through(&view.camera, pixel);
                let depth = shot::first_seen(&ray, &still).expect("the room is closed").depth;
                // Four times the noise, and more where a surface is seen at a slant.
                (depth - view.camera.to_camera(position).z).abs() < 0.25
            };
            assert!(
                scene.train.iter().step_by(24.min(scene.train.len() / 6)).filter(agrees).count() >= 1,
                "{position}"
            );
        }
    }
}

#[test]
fn the_same_options_make_the_same_scene_whatever_the_number_of_threads() {
    for kind in BuiltinKind::ALL {
        let with = |threads: usize| {
            let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().expect("pool");
            pool.install(|| builtin(&small(kind)))
        };
        assert_equal(&with(1), &with(3));
    }
}

#[test]
fn another_seed_makes_another_scene() {
    for kind in BuiltinKind::ALL {
        let (a, b) = (builtin(&small(kind)), builtin(&BuiltinOptions { seed: 8, ..small(kind) }));
        assert!(rgb(&a.train[0].image) != rgb(&b.train[0].image) && a.points != b.points);
    }
}

#[test]
fn options_below_their_least_value_are_raised() {
    let none = BuiltinOptions { width: 0, height: 0, frames: 0, photos: 0, test_photos: 0, ..Default::default() };
    for kind in BuiltinKind::ALL {
        let scene = builtin(&BuiltinOptions { kind, ..none });
        assert!(!scene.train.is_empty() && scene.train[0].camera.width == 16);
    }
}
