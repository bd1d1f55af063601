//! Problems with poses.

use glam::{DMat3, DVec3};
use image::imageops;

use super::*;
use crate::inspect::sight::Warp;

const TURNED: DMat3 = DMat3::from_diagonal(DVec3::new(1.0, -1.0, -1.0));

/// The scene with the mistake in all poses.
fn warped(kind: BuiltinKind, warp: Warp) -> Scene {
    let mut scene = sound(kind);
    all_mut(&mut scene).for_each(|view| view.camera = warp.of(&view.camera));
    scene
}

fn poses_problem(scene: &Scene, format: Format) -> Problem {
    let mut problems = problems_in(scene, format);
    problems.retain(|problem| problem.subject == Subject::Poses);
    assert_eq!(problems.len(), 1, "{problems:#?}");
    assert_eq!(problems[0].severity, Severity::Warning);
    problems.remove(0)
}

#[test]
fn opengl_cameras_are_named() {
    for kind in [BuiltinKind::Video, BuiltinKind::Casual] {
        let problem = poses_problem(&warped(kind, Warp { axes: TURNED, ..Warp::NONE }), Format::NERFSTUDIO);
        assert!(problem.what.contains("with the y and z axes of the cameras turned"), "{problem:?}");
        assert!(problem.remedy.contains("OpenGL") && problem.remedy.contains("transform_matrix"), "{problem:?}");
    }
}

#[test]
fn inverted_poses_are_named() {
    let problem = poses_problem(&warped(BuiltinKind::Casual, Warp { inverted: true, ..Warp::NONE }), Format::COLMAP);
    assert!(problem.what.contains("with the poses inverted, "), "{problem:?}");
    let both = Warp { axes: TURNED, inverted: true, ..Warp::NONE };
    let problem = poses_problem(&warped(BuiltinKind::Casual, both), Format::COLMAP);
    assert!(problem.what.contains("y and z turned and then the poses inverted"), "{problem:?}");
}

#[test]
fn axes_in_another_order_are_named() {
    let quarter = DMat3::from_cols(DVec3::Y, DVec3::NEG_X, DVec3::Z);
    let problem = poses_problem(&warped(BuiltinKind::Video, Warp { axes: quarter, ..Warp::NONE }), Format::NEU3D);
    assert!(problem.what.contains("the cameras' axes x, y, z taken as y, -x, z"), "{problem:?}");
    assert!(problem.remedy.contains("down, right and backward"), "{problem:?}");
}

#[test]
fn points_that_were_turned_without_the_cameras_are_named() {
    let up = DMat3::from_cols(DVec3::X, DVec3::Z, DVec3::NEG_Y);
    let problem = poses_problem(&warped(BuiltinKind::Video, Warp { world: up, ..Warp::NONE }), Format::NEU3D);
    assert!(problem.what.contains("the points' axes x, y, z taken as x, z, -y"), "{problem:?}");
}

#[test]
fn another_unit_is_named() {
    let problem = poses_problem(&warped(BuiltinKind::Video, Warp { scale: 1000.0, ..Warp::NONE }), Format::NEU3D);
    assert!(problem.what.contains("positions multiplied by 0.001"), "{problem:?}");
}

#[test]
fn mirrored_pictures_are_named() {
    let mut scene = video();
    for view in all_mut(&mut scene) {
        view.image = in_memory(imageops::flip_horizontal(&*view.image.rgb().expect("in memory")));
    }
    let problem = only_problem(&scene);
    assert!(problem.what.contains("left and right of the images exchanged"), "{problem:?}");
}

#[test]
fn two_cameras_that_were_exchanged_are_named() {
    // The held-out camera is the first: a surplus row would misplace it, too.
    for (one, other, names) in [(0, 8, ["cam01", "cam02"]), (16, 24, ["cam03", "cam04"])] {
        let mut scene = video();
        let cameras = [scene.train[one].camera, scene.train[other].camera];
        for frame in 0..8 {
            scene.train[one + frame].camera = cameras[1];
            scene.train[other + frame].camera = cameras[0];
        }
        let problem = only_problem(&scene);
        assert!(names.iter().all(|name| problem.what.contains(name)), "{problem:?}");
        assert!(problem.what.contains("for 2 of 8 cameras"), "{problem:?}");
    }
}

#[test]
fn photos_that_are_mostly_blocked_raise_no_doubt() {
    let mut scene = sound(BuiltinKind::Casual);
    for (index, view) in scene.train.iter_mut().enumerate().filter(|(index, _)| index % 3 == 0) {
        let mut photo = RgbImage::clone(&*view.image.rgb().expect("in memory"));
        for (x, y, pixel) in photo.enumerate_pixels_mut().filter(|(x, ..)| *x < 67) {
            let stripe = (x / 9 + 7 * (y / 9)) as usize + index;
            *pixel = image::Rgb([(97 * stripe) as u8, (53 * stripe) as u8, (31 * stripe) as u8]);
        }
        view.image = in_memory(photo);
    }
    assert_eq!(problems_in(&scene, Format::COLMAP), []);
}

/// The scene at the start of a street with more houses of its size.
fn street(mut scene: Scene, houses: usize) -> Scene {
    let first = scene.points.clone();
    for house in 1..=houses {
        for (position, colour) in first.positions.iter().zip(&first.colours) {
            scene.points.push(*position + 30.0 * house as f32 * glam::Vec3::X, *colour);
        }
    }
    scene
}

#[test]
fn a_long_walk_on_which_cameras_see_few_of_the_points_raises_no_doubt() {
    for houses in [10, 40] {
        let scene = street(sound(BuiltinKind::Casual), houses);
        let inspection = inspect_scene(&scene, &Origin::default(), Pictures::Decoded);
        let seen = inspection.summary.expect("read").points_seen.expect("points");
        assert!(seen < 0.1, "{seen} of the points are seen");
        let mut problems = inspection.problems;
        problems.retain(|problem| problem.subject == Subject::Poses && problem.severity != Severity::Note);
        assert_eq!(problems, [], "{houses} houses");
    }
}

#[test]
fn points_of_another_scene_are_told() {
    let mut scene = video();
    let mut other = builtin(&BuiltinOptions { seed: 9, width: 32, height: 24, frames: 1, ..Default::default() }).points;
    other.colours.rotate_left(1234);
    scene.points = other;
    let problem = only_problem(&scene);
    assert!(problem.what.contains("colours do not agree") && problem.remedy.contains("drawn over"), "{problem:?}");
}

#[test]
fn colours_that_say_nothing_raise_no_doubt() {
    let mut scene = video();
    scene.points.colours.fill(glam::Vec3::splat(0.5));
    assert_eq!(problems_in(&scene, Format::NEU3D), []);
    scene.points.colours = video().points.colours;
    scene.points.colours.rotate_left(1234);
    let random = Origin { points: PointsOrigin::Random, ..Default::default() };
    let problems = inspect_scene(&scene, &random, Pictures::Decoded).problems;
    assert!(problems.iter().all(|problem| problem.severity == Severity::Note), "{problems:?}");
}

#[test]
fn without_points_cameras_that_turn_their_backs_on_each_others_view_are_told() {
    let mut scene = warped(BuiltinKind::Casual, Warp::NONE);
    scene.points = Default::default();
    // Cameras on a ring that look inward, then outward.
    let around = |outward: f64| {
        let mut scene = scene.clone();
        let count = scene.train.len() as f64;
        for (index, view) in scene.train.iter_mut().enumerate() {
            let (sin, cos) = (std::f64::consts::TAU * index as f64 / count).sin_cos();
            let forward = -outward * DVec3::new(cos, sin, 0.0);
            let axes = DMat3::from_cols(forward.cross(DVec3::Z), DVec3::NEG_Z, forward);
            view.camera = crate::Camera::centred(96, 72, 80.0, axes, DVec3::new(3.0 * cos, 3.0 * sin, 0.4));
        }
        problems_in(&scene, Format::DNERF).into_iter().filter(|problem| problem.subject == Subject::Poses).count()
    };
    assert_eq!((around(1.0), around(-1.0)), (0, 1));
}
