//! Cameras, points, times, sizes and the split.

use glam::{DVec3, Vec3};

use super::*;
use crate::scene::Picture;

#[test]
fn a_scene_without_held_out_views_is_told() {
    let mut scene = video();
    scene.test.clear();
    let problem = only_problem(&scene);
    assert_eq!((problem.severity, problem.subject), (Severity::Warning, Subject::Split));
    assert!(problem.what.contains("no view is held out"), "{problem:?}");
}

#[test]
fn too_few_training_views_are_told() {
    let mut scene = sound(BuiltinKind::Casual);
    scene.train.truncate(1);
    let problem = only_problem(&scene);
    assert!(problem.severity == Severity::Error && problem.what.contains("one view"), "{problem:?}");
    let mut scene = video();
    scene.train.truncate(8);
    let problem = only_problem(&scene);
    assert_eq!(problem.severity, Severity::Error);
    assert!(problem.what.contains("8 training views are from one camera"), "{problem:?}");
    scene.train.clear();
    assert!(!inspect_scene(&scene, &Origin::default(), Pictures::Decoded).can_train());
}

#[test]
fn no_points_and_few_points_are_told() {
    let mut scene = video();
    scene.points.positions.truncate(12);
    scene.points.colours.truncate(12);
    assert!(only_problem(&scene).what.contains("only 12 points"));
    scene.points = Default::default();
    assert!(only_problem(&scene).what.contains("random points"));
}

#[test]
fn a_stray_point_far_away_is_told() {
    let mut scene = video();
    scene.points.push(Vec3::new(0.0, 900.0, 0.0), Vec3::ONE);
    let problem = only_problem(&scene);
    assert!(problem.what.contains("1 of 4001 points lie far from all others"), "{problem:?}");
}

#[test]
fn a_scene_in_too_large_a_unit_is_told() {
    let mut scene = video();
    all_mut(&mut scene).for_each(|view| view.camera.translation *= 0.02);
    scene.points.positions.iter_mut().for_each(|point| *point *= 0.02);
    let problem = only_problem(&scene);
    assert!(problem.what.contains("nearer than 0.2 world units"), "{problem:?}");
}

#[test]
fn implausible_lenses_are_told() {
    let mut scene = video();
    all_mut(&mut scene).for_each(|view| (view.camera.fx, view.camera.fy) = (4000.0, 4000.0));
    let told = |scene: &Scene, what: &str| {
        problems_in(scene, Format::COLMAP).iter().any(|p| p.subject == Subject::Cameras && p.what.contains(what))
    };
    assert!(told(&scene, "field of view of 64 views"));
    let mut scene = video();
    scene.train[5].camera.cx = 300.0;
    assert!(told(&scene, "principal point of 1 view "));
}

#[test]
fn held_out_views_that_are_trained_on_are_told_once() {
    let mut scene = video();
    scene.test = scene.train[..3].to_vec();
    let problem = only_problem(&scene);
    assert_eq!((problem.severity, problem.subject), (Severity::Warning, Subject::Split));
    assert!(problem.what.contains("3 of 3 held-out views are trained on as well"), "{problem:?}");
    assert!(problem.remedy.contains("scene.test_cameras"), "{problem:?}");
}

#[test]
fn cameras_in_one_spot_are_told() {
    // The first extent is unusable; the second is only small.
    for (share, severity) in [(0.0, Severity::Error), (1e-4, Severity::Warning)] {
        let mut scene = sound(BuiltinKind::Casual);
        let spot = scene.training_centre();
        for view in all_mut(&mut scene) {
            let centre = spot + share * (view.camera.centre() - spot);
            view.camera.translation = -(view.camera.rotation * centre);
        }
        let problems = problems_in(&scene, Format::COLMAP);
        let told = |problem: &Problem| problem.severity == severity && problem.what.contains("stand in one spot");
        assert!(problems.iter().any(told), "{share}: {problems:#?}");
    }
}

#[test]
fn a_scene_far_from_the_origin_is_told() {
    let mut scene = video();
    let away = DVec3::new(4e5, 5e6, 0.0);
    for view in all_mut(&mut scene) {
        view.camera.translation -= view.camera.rotation * away;
    }
    scene.points = Default::default();
    let problems = problems_in(&scene, Format::COLMAP);
    assert!(problems.iter().any(|problem| problem.what.contains("single precision")), "{problems:#?}");
}

#[test]
fn times_that_are_all_one_are_told() {
    let mut scene = video();
    all_mut(&mut scene).for_each(|view| view.time = 0.25);
    assert!(only_problem(&scene).what.contains("all 56 training views have one time"));
    // One frame per camera may be intended.
    let still = |view: &View| view.name.ends_with("/0003");
    let mut scene = video();
    scene.train.retain(still);
    scene.test.retain(still);
    assert_eq!(only_problem(&scene).severity, Severity::Note);
}

#[test]
fn missing_frames_and_far_held_out_ones_are_told() {
    let mut scene = builtin(&BuiltinOptions { width: 32, height: 24, frames: 30, ..Default::default() });
    let within = |view: &View| !(0.4..0.6).contains(&view.time);
    scene.train.retain(within);
    let problems = inspect_scene(&scene, &Origin::default(), Pictures::Headers).problems;
    assert!(problems.iter().any(|p| p.what.contains("about 6 frames missing in 1 place")), "{problems:#?}");
    assert!(problems.iter().any(|p| p.what.contains("2 of 30 held-out views are far")), "{problems:#?}");
    scene.test.retain(within);
    assert_eq!(inspect_scene(&scene, &Origin::default(), Pictures::Headers).problems.len(), 1);
}

#[test]
fn large_pictures_come_with_the_factor_that_papers_use() {
    let factor = |format, name: &str, width: u32, downscale: f64| {
        let mut scene = sound(BuiltinKind::Casual);
        scene.name = name.into();
        for view in all_mut(&mut scene) {
            view.image = Picture::file("none.png".into(), (width, 3 * width / 4));
        }
        let origin = Origin { format: Some(format), downscale, ..Default::default() };
        let problems = inspect_scene(&scene, &origin, Pictures::Headers).problems;
        assert!(problems.iter().all(|problem| problem.severity == Severity::Note));
        problems.into_iter().next().map(|problem| problem.remedy)
    };
    for (format, name, width, downscale, expected) in [
        (Format::NEU3D, "coffee_martini", 2704, 1.0, Some("2")),
        (Format::NEU3D, "coffee_martini", 1352, 2.0, None),
        (Format::ONTHEGO, "mountain", 4032, 1.0, Some("8")),
        (Format::ONTHEGO, "mountain", 2016, 2.0, Some("8")),
        (Format::ONTHEGO, "patio", 1920, 1.0, Some("4")),
        (Format::COLMAP, "statue", 4032, 1.0, Some("8")),
        (Format::NERFSTUDIO, "garden", 3840, 1.0, Some("3")),
    ] {
        let expected = expected.map(|factor| format!("Add `--set scene.downscale={factor}`."));
        assert_eq!(factor(format, name, width, downscale), expected, "{name}");
    }
}
